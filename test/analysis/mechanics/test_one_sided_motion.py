"""Linearization and inverse dynamics while contacts are closed, stick and slide."""

import math

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.analysis.linear.linearization import modes
from mbd_sim.base.errors import MbdSimError

G = 9.81


def frequencies(sim):
    return [mode.frequency for mode in modes(sim.linearize())]


def test_a_ball_that_rolls_at_the_bottom_of_a_cylinder_swings_as_a_pendulum():
    sim = Simulation.from_file("ball_in_cylinder", set={"start": 0.0})
    linear = sim.linearize()
    assert linear.displacements.shape == (3, 2)  # the ball can be placed turned, but it rolls
    assert linear.speeds.shape == (3, 1)
    assert frequencies(sim) == pytest.approx([0.0, math.sqrt(G / (1.4 * 0.42)) / (2.0 * math.pi)], abs=1e-12)


ARM = """
mechanism: arm
parts:
  upper: {shape: {type: rod, mass: 1, to: [0, 0, -1]}, points: {tip: [0, 0, -1]}}
  lower: {shape: {type: rod, mass: 1, to: [0, 0, -1]}, points: {tip: [0, 0, -1]}}
joints:
  shoulder: {type: revolute, between: [ground, upper], axis: [0, 1, 0], position: 0.3, velocity: 0.2}
  elbow: {type: revolute, between: [upper.tip, lower], axis: [0, 1, 0], position: 0, LIMITS}
"""


def test_an_arm_on_its_stop_is_linearized_as_one_with_a_welded_elbow():
    """The stop is closed by a spring that presses on it; two rods in line are one of 2 m."""
    stop = "stiffness: 10, rest: 1, limits: {lower: -1, upper: 0, restitution: 0}"
    sim = Simulation.from_text(ARM.replace("LIMITS", stop))
    assert sim.contacts()["elbow.upper_limit"].state == "closed"
    rod = """
mechanism: rod
parts: {rod: {shape: {type: rod, mass: 2, to: [0, 0, -2]}}}
joints: {shoulder: {type: revolute, between: [ground, rod], axis: [0, 1, 0], position: 0.3, velocity: 0.2}}
"""
    one, linear = Simulation.from_text(rod).linearize(), sim.linearize()
    assert linear.a == pytest.approx(one.a, abs=1e-12)
    assert linear.b[:, 0] == pytest.approx(one.b[:, 0], abs=1e-12)
    assert linear.b[:, 1] == pytest.approx([0.0, 0.0], abs=1e-12)


def test_a_pendulum_on_feet_that_stick_in_space_is_linearized():
    """An inverted pendulum on a spring; friction of the feet has two directions."""
    sim = Simulation.from_text("""
mechanism: metronome
parts:
  base: {mass: 3, inertia: [0.1, 0.1, 0.1], points: {a: [0.3, 0, -0.1], b: [-0.2, 0.2, -0.1], c: [-0.2, -0.2, -0.1]}}
  rod: {mass: 0.5, center: [0, 0, 0.3], inertia: [0.01, 0.01, 0.01]}
joints:
  base: {type: free, between: [ground, base], position: [0, 0, 0.1]}
  pin: {type: revolute, between: [base, rod], axis: [0, 1, 0], stiffness: 20, position: 0.1}
contacts: {floor: {parts: [base.a, base.b, base.c], plane: ground, friction: 0.5}}
""")
    assert {state.state for state in sim.contacts().values()} == {"sticks"}
    linear = sim.linearize()
    assert linear.speeds.shape == (7, 1)
    stiffness = 20.0 - 0.5 * G * 0.3 * math.cos(0.1)
    assert linear.a[-1, -2:] == pytest.approx([-stiffness / (0.01 + 0.5 * 0.3**2), 0.0], rel=1e-12)


def admissible(sim, y, inputs):
    """The state with the smallest change of speeds with which closed contacts stay closed and sticking ones stick."""

    def rates(y):
        sim.restore(y, 0, inputs)
        found = [state for state in sim.contacts().values() if state.state in ("closed", "sticks", "slides")]
        held = [rate for state in found for rate in (state.slip if state.state == "sticks" else [])]
        two_sided = np.array(sim.model.equations.violation(0.0, y))[:, 1]
        return np.array([*two_sided, *held, *(state.rate for state in found)])

    u, unit = slice(sim.q.size, sim.q.size + sim.u.size), np.eye(sim.y.size)
    slopes = np.array([rates(y + unit[index]) - rates(y) for index in range(u.start, u.stop)]).T
    moved = y.copy()
    moved[u] -= np.linalg.lstsq(slopes, rates(y), rcond=None)[0]
    return moved


def accelerations(sim, y, inputs):
    """u' (nv,) by finite differences of a run from a state, with contacts as they are found there."""
    sim.restore(admissible(sim, y, inputs), 0, inputs)
    start, speeds = sim.u.copy(), []
    for _ in range(4):
        sim.step(1)
        speeds.append(sim.u.copy())
    one, two, three, four = speeds
    return (-25.0 * start + 48.0 * one - 36.0 * two + 16.0 * three - 3.0 * four) / (12.0 * sim.step_size)


SPRUNG_BALL = """
mechanism: sprung_ball
parts:
  ball: {shape: {type: sphere, mass: 1, radius: 0.1}}
joints:
  ball: {type: planar, between: [ground, ball], axis: [0, 1, 0], x_axis: [1, 0, 0], position: [0.1, -0.1, 0.2],
    velocity: [1, 0, -3]}
constraints:
  floor: {type: rolling, wheel: ball, radius: 0.1, friction: 0.3}
ground: {points: {hook: [0.4, 0, 0.6]}}
forces: {spring: {type: spring, between: [ground.hook, ball], stiffness: 4, length: 0.3, damping: 0.5}}
"""


@pytest.mark.parametrize(
    ("name", "time"),
    [("slider_crank_friction", 0.1), ("rocking", 0.2), (SPRUNG_BALL, 0.0)],
    ids=["load of a joint", "sticking corner", "sliding ball"],
)
def test_linearized_accelerations_are_finite_differences_of_runs(name, time):
    """In all free directions, and by all efforts."""
    options = {"step": 1e-4}
    sim = Simulation.from_text(name, **options) if "\n" in name else Simulation.from_file(name, **options)
    sim.run(until=time)
    linear, nq = sim.linearize(), sim.q.size
    y, inputs, contacts = sim.state, sim.inputs.copy(), {key: state.state for key, state in sim.contacts().items()}
    k, delta = linear.displacements.shape[1], 1e-5
    to_w = np.linalg.pinv(linear.speeds)
    for column in range(k + linear.speeds.shape[1]):
        moved = []
        for sign in (1.0, -1.0):
            state = y.copy()
            if column < k:
                state[:nq] += sign * delta * linear.displacements[:, column]
            else:
                state[nq : 2 * nq] += sign * delta * linear.speeds[:, column - k]
            moved.append(to_w @ accelerations(sim, state, inputs))
            assert {key: found.state for key, found in sim.contacts().items()} == contacts
        assert (moved[0] - moved[1]) / (2.0 * delta) == pytest.approx(linear.a[k:, column], rel=1e-4, abs=1e-4)
    for column in range(nq):
        moved = []
        for sign in (1.0, -1.0):
            given = inputs.copy()
            given[column] += sign * delta
            moved.append(to_w @ accelerations(sim, y, given))
        assert (moved[0] - moved[1]) / (2.0 * delta) == pytest.approx(linear.b[k:, column], rel=1e-4, abs=1e-4)


@pytest.mark.parametrize(
    ("name", "time", "element"),
    [("bounce", 4.5, None), ("belt", 0.0, None), ("disc_brake", 0.1, "'lining: coordinates' touches without a force")],
)
def test_states_between_two_motions_are_refused_by_name(name, time, element):
    sim = Simulation.from_file(name)
    sim.run(until=time)
    if element is None:
        sim.linearize()
        return
    with pytest.raises(MbdSimError, match=element):
        sim.linearize()


def test_friction_at_its_limit_has_no_linearization():
    text = """
mechanism: block
parts: {block: {shape: {type: block, mass: 1, size: [1, 1, 1]}}}
joints: {slide: {type: prismatic, between: [ground, block], axis: [1, 0, 0], friction: {coulomb: 2, sticking: true}}}
"""
    sim = Simulation.from_text(text)
    sim.set_efforts([2.0])
    with pytest.raises(MbdSimError, match="'slide: friction' carries as much friction as it can at rest"):
        sim.linearize()
    sim.set_efforts([1.5])
    assert sim.linearize().speeds.shape == (1, 0)


BLOCK = """
mechanism: block
parts: {block: {shape: {type: block, mass: 2, size: [0.2, 0.2, 0.2]}}}
joints:
  block: {type: planar, between: [ground, block], axis: [0, -1, 0], x_axis: [1, 0, 0], position: [0, 0.1, 0]}
contacts: {floor: {parts: [block], plane: ground, friction: 0.4}}
"""


def test_a_standing_block_needs_no_efforts_and_can_have_no_acceleration():
    sim = Simulation.from_text(BLOCK)
    assert sim.inverse_dynamics([0.0, 0.0, 0.0]) == pytest.approx([0.0, 0.0, 0.0], abs=1e-12)
    with pytest.raises(ValueError, match=r"no efforts at .* give these accelerations: block\.x would have"):
        sim.inverse_dynamics([1.0, 0.0, 0.0])
    assert sim.linearize().a.shape == (1, 1)  # it can stand elsewhere, and stays there


def test_the_efforts_of_a_sliding_motion_overcome_its_friction():
    sim = Simulation.from_text(SPRUNG_BALL, step=1e-4)
    wanted = np.array([0.7, 0.0, -2.0])
    efforts = sim.inverse_dynamics(wanted)
    sim.set_efforts(efforts)
    inputs = sim.inputs.copy()
    assert accelerations(sim, sim.state, inputs) == pytest.approx(wanted, abs=1e-8)
    assert sim.contacts()["floor"].state == "slides"
    with pytest.raises(ValueError, match=r"require 'floor: .*' to pull"):
        sim.inverse_dynamics([50.0, 0.0, 0.0])


def test_the_effort_of_a_crank_overcomes_friction_that_depends_on_it():
    sim = Simulation.from_file("slider_crank_friction", step=1e-4)
    sim.run(until=0.1)
    state = sim.state
    rates = accelerations(sim, state, sim.inputs.copy())
    sim.restore(state, 1000)
    sim.set_efforts([3.0, 0.0])
    driven = accelerations(sim, state, sim.inputs.copy())
    assert np.max(np.abs(driven - rates)) > 10.0
    sim.restore(state, 1000)
    found = sim.inverse_dynamics(driven)
    sim.set_efforts(found)
    assert accelerations(sim, state, sim.inputs.copy()) == pytest.approx(driven, rel=1e-8)


def test_the_effort_of_an_arm_on_its_stop_does_not_turn_its_elbow():
    stop = "stiffness: 10, rest: 1, limits: {lower: -1, upper: 0, restitution: 0}"
    sim = Simulation.from_text(ARM.replace("LIMITS", stop))
    sim.set_efforts(sim.inverse_dynamics([1.0, 0.0]))
    assert sim.efforts[0] == pytest.approx(2.0 * 4.0 / 3.0 + 2.0 * G * math.sin(0.3), abs=1e-12)
    assert sim.efforts[1] == 0.0
    assert accelerations(sim, sim.state, sim.inputs.copy()) == pytest.approx([1.0, 0.0], abs=1e-7)
    with pytest.raises(ValueError, match="no efforts at"):
        sim.inverse_dynamics([1.0, -0.5])
