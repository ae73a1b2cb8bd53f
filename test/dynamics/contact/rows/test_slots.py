"""The rows of slots as functions of the motions of parts, against those that are written out in the state."""

import casadi as ca
import numpy as np
import pytest

from mbd_sim.dynamics.contact.one_sided_equations import one_sided_equations
from mbd_sim.dynamics.kinematics.poses import normalized_quaternions
from mbd_sim.dynamics.kinematics.tracing import trace
from mbd_sim.files.load import parse_mechanism

# Blocks on legs of a moving base, on the floor and on a driven table; blocks on blocks, also in a plane mechanism.
LEGS = """
mechanism: legs
parts:
  base: {shape: {type: block, mass: 2, size: [0.3, 0.2, 0.1]}, points: {hip: [0.2, 0.1, 0]}}
  leg_{i}: {for: {i: 1..COUNT}, shape: {type: block, mass: 1, size: [0.1, 0.08, 0.3]}, points: {hip: [0, 0, 0.2]}}
  table: {shape: {type: block, mass: 1, size: [1, 1, 0.1]}}
joints:
  base: {type: free, between: [ground, base], position: [0, 0, 1]}
  leg_{i}: {for: {i: 1..COUNT}, type: revolute, between: [base.hip, "leg_{i}.hip"], position: 0.1*i, axis: [0.6, 0.8, 0]}
  table: {type: prismatic, between: [ground, table], axis: [0, 0, 1], drive: "-2 + 0.1*sin(3*t)"}
contacts:
  floor: {parts: all, without: [table], plane: ground, friction: 0.4}
  table: {between: [base, table], friction: 0.3}
"""
PLANE = """
mechanism: plane
parts:
  lower: {shape: {type: block, mass: 2, size: [0.3, 0.2, 0.1]}}
  upper: {shape: {type: block, mass: 1, size: [0.1, 0.2, 0.3]}}
joints:
  lower: {type: planar, between: [ground, lower], axis: [0, 1, 0]}
  upper: {type: planar, between: [lower, upper], axis: [0, 1, 0], position: [0, 0.5, 0]}
contacts: {pair: {between: [lower, upper], friction: 0.3}}
"""


def random_state(traced, chance):
    """Random coordinates and speeds, with unit quaternions."""
    y = chance.normal(size=traced.y.shape[0])
    normal = ca.Function("normal", [traced.state.q], [normalized_quaternions(traced.links, traced.state.q)])
    y[: traced.layout.nq] = np.array(normal(y[: traced.layout.nq])).ravel()
    return y


def rows_of(text):
    mechanism = parse_mechanism(text)
    traced = trace(mechanism)
    return traced, one_sided_equations(traced)


@pytest.mark.parametrize("text", [LEGS.replace("COUNT", "2"), PLANE], ids=["space", "plane"])
def test_rates_of_slots_are_the_derivatives_of_their_positions(text):
    """Gradients, rates and biases against derivatives of the gaps, and of the rates, in the state."""
    traced, one_sided = rows_of(text)
    written, state = one_sided.combined.written, traced.state
    gaps = one_sided.layout.gaps
    assert all(gap.numbers is not None for gap in one_sided.gaps)
    position, velocity = written.position[:gaps], written.velocity
    slopes = ca.jacobian(position, state.q)
    rate = slopes @ state.q_rates + ca.jacobian(position, state.t)
    differences = [
        rate - velocity[:gaps],
        ca.vec(ca.jacobian(velocity, state.u) - written.gradient),
        state.rate(velocity) - written.bias,
    ]
    given = [state.t, traced.y, traced.inputs, one_sided.numbers]
    function = ca.Function("check", given, [ca.densify(each) for each in (*differences, velocity, written.bias)])
    chance = np.random.default_rng(5)
    for _ in range(5):
        y = random_state(traced, chance)
        numbers = chance.normal(size=one_sided.numbers.shape[0])
        *apart, rates, biases = (np.array(each) for each in function(0.3, y, np.zeros(traced.inputs.shape[0]), numbers))
        assert np.max(np.abs(rates)) > 0.1 and np.max(np.abs(biases)) > 0.1
        for difference, size in zip(apart, (rates, rates, biases), strict=True):
            assert np.max(np.abs(difference)) < 1e-12 * (1.0 + np.max(np.abs(size)))


def test_like_slots_have_one_function():
    """However many legs and slots there are: the code of a mechanism would grow with the number of its slots."""
    counts = []
    for legs in (1, 4):
        _, one_sided = rows_of(LEGS.replace("COUNT", str(legs)))
        calls = one_sided.combined.slots.calls
        counts.append(len({call.function.name() for call in calls}))
        assert len(calls) == one_sided.layout.gaps
    assert counts[0] == counts[1] == 2


def test_slots_that_are_not_in_use_keep_their_natural_length():
    """All numbers zero: a gap without a rate, of the length that the compiled code gives it without calling anything."""
    traced, one_sided = rows_of(LEGS.replace("COUNT", "1"))
    written, slots = one_sided.combined.written, one_sided.combined.slots
    gaps = one_sided.layout.gaps
    outputs = [
        written.position[:gaps],
        written.velocity[:gaps],
        ca.vec(written.gradient[:gaps, :]),
        written.bias[:gaps],
    ]
    given = [traced.state.t, traced.y, traced.inputs, one_sided.numbers]
    function = ca.Function("unused", given, [ca.densify(each) for each in outputs])
    y = random_state(traced, np.random.default_rng(1))
    zeros = np.zeros(traced.inputs.shape[0]), np.zeros(one_sided.numbers.shape[0])
    position, *others = (np.array(each).ravel() for each in function(0.0, y, *zeros))
    assert position == pytest.approx(slots.unused)
    assert all(np.all(each == 0.0) for each in others)


def test_rows_and_places_of_a_slot_depend_on_its_own_numbers():
    """The rows of a contact's slots are written once, with the numbers of the first one."""
    _, one_sided = rows_of(PLANE)
    written, places = one_sided.combined.written, one_sided.places
    assert len(one_sided.gaps) > 1
    for index in range(len(one_sided.gaps)):
        for other, gap in enumerate(one_sided.gaps):
            own = other == index
            assert ca.depends_on(written.position[index], gap.numbers) == own
            assert ca.depends_on(places[:3, index], gap.numbers) == own
