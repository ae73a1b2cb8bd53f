"""The recursion against Lagrange's equations by differentiation, and both against Kane's equations in numpy.

Coordinates are scaled to a unit diagonal of the mass matrix, so that the errors do not depend on units. Errors may grow
with the condition of that matrix.
"""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from hypothesis import given, settings

from mbd_sim.base.errors import MechanismError
from mbd_sim.compiler.lists.lowering import instruction_count
from mbd_sim.dynamics.equations import derive
from mbd_sim.dynamics.lagrange import lagrange_equations
from mbd_sim.files.load import load_mechanism, parse_mechanism
from test.generators.loops import random_mechanisms, state_near_start
from test.generators.mechanisms import (
    AUDITED,
    CART_PENDULUM,
    COLLARS,
    DISK,
    FLOATING,
    KINDS,
    PROJECTILE,
    SHIPPED,
    TRIPLE_ROD,
    accelerations,
    random_state,
    random_trees,
)
from test.oracles import kane

ROUND_OFF = 1e-13
ILL_CONDITIONED = 1e4  # condition of the constraints above which an error of 1e-10 is out of reach


def check(mechanism, rng, states=1, t=0.7, by_energies=True):
    """Compare the three derivations, or two; returns whether that was possible at this time."""
    derived, lagrange = derive(mechanism), lagrange_equations(mechanism) if by_energies else None
    for _ in range(states):
        state = random_state(mechanism, rng)
        if derived.rows and (state := state_near_start(mechanism, derived, rng, t)) is None:
            return False
        q, u, efforts = state
        oracle = kane.equations(mechanism, q, u, efforts, t)
        if oracle.constraint_condition > ILL_CONDITIONED:
            return False
        found = [value.item() for value in map(np.array, derived.energies(t, np.concatenate([q, u, np.zeros(3)])).nz)]
        assert found == pytest.approx([oracle.kinetic, oracle.potential], rel=1e-12, abs=1e-11)
        if lagrange:
            *kinetic, potential = [float(value) for value in lagrange.energies(t, q, u)]
            assert [sum(kinetic), potential] == pytest.approx(found, rel=1e-12, abs=1e-11)
        if len(u) == 0:
            continue
        exact = oracle.accelerations
        # The forces on these mechanisms are at least of order one. Where they cancel, their round-off remains.
        largest = max(np.linalg.norm(oracle.scale * exact), 1.0)
        allowed = min(1e-10, ROUND_OFF * oracle.condition * oracle.constraint_condition) * largest
        assert np.linalg.norm(oracle.scale * (accelerations(derived, q, u, efforts, t) - exact)) <= allowed
        if lagrange:
            assert np.linalg.norm(oracle.scale * (lagrange.accelerations(q, u, efforts, t) - exact)) <= allowed
        assert np.max(np.abs(oracle.errors), initial=0.0) <= 1e-12 * oracle.condition
    return True


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_mechanisms(name):
    is_kind = name in KINDS
    assert check(load_mechanism(name), np.random.default_rng(1), states=1 + is_kind, by_energies=is_kind)


@pytest.mark.parametrize(
    "text", [CART_PENDULUM, TRIPLE_ROD, COLLARS, DISK, PROJECTILE, FLOATING, AUDITED.replace(", STOP", "")]
)
def test_textbook_mechanisms(text):
    assert check(parse_mechanism(text), np.random.default_rng(2), states=2)


@settings(max_examples=5)
@given(random_trees())
def test_random_trees(drawn):
    text, rng = drawn
    assert check(parse_mechanism(text), rng)


ACTUATED = """
mechanism: actuated
ground: {points: {post: [0.4, 0.3, -1]}}
parts:
  boom: {mass: 3, center: [0.1, 0, -0.4], inertia: [0.2, 0.3, 0.1], points: {end: [0, 0.1, -0.8], eye: [0.1, 0, -0.3]}}
  arm: {mass: 2, center: [0, 0.1, -0.2], inertia: [0.1, 0.1, 0.05], points: {end: [0.1, 0, -0.5]}}
  tube: {mass: 1, center: [0.05, 0, 0.1], inertia: [0.03, 0.02, 0.01]}
  load: {mass: 1.5, center: [0, 0, 0.1], inertia: [0.02, 0.02, 0.01]}
joints:
  base: {type: revolute, between: [ground, boom], axis: [0, -1, 0.2]}
  elbow: {type: universal, between: [boom.end, arm], axes: [[1, 0, 0], [0, 1, 0]]}
  sleeve: {type: cylindrical, between: [arm.end, tube], axis: [0, 1, 1]}
  rail: {type: prismatic, between: [ground, load], axis: [1, 0, 0]}
actuators:
  swing: {type: dc_motor, joint: base, torque_constant: 0.1, resistance: 1, gear_ratio: 20, rotor_inertia: 1e-3,
    voltage_limit: 30, current_limit: 8, efficiency: 0.8, friction: 0.02, damping: 1e-3}
  first: {type: dc_motor, joint: elbow.first, torque_constant: 0.1, resistance: 1, inductance: 1 mH, gear_ratio: 9, efficiency: 0.9}
  second: {type: effort, joint: elbow.second, gear_ratio: 5, rotor_inertia: 2e-3, servo: {controls: position, kp: 9, ki: 3, kd: 2}}
  slide: {type: dc_motor, joint: sleeve.displacement, lead: 0.2, torque_constant: 0.1, resistance: 2, control: effort,
    current_limit: 3, voltage_limit: 12, rotor_inertia: 1e-4}
  spin: {type: effort, joint: sleeve.angle, torque_speed: [[0, 5], [1, 2], [2, 0.5]], effort_limit: 3}
  draw: {type: effort, between: [ground.post, arm.end], effort_limit: 4,
    servo: {controls: velocity, kp: 3, velocity_feedforward: 1, limit: 6}}
  lift: {type: hydraulic_cylinder, between: [ground.post, boom.eye], areas: [2 cm^2, 1 cm^2], retracted: 0.1, stroke: 2,
    dead_volumes: [1e-4, 1e-4], rated_flow: 20 L/min, supply: 150 bar}
  push: {type: pneumatic_cylinder, joint: rail, areas: [8 cm^2, 6 cm^2], stroke: 1, dead_volumes: [1e-5, 1e-5],
    conductance: 2e-8, supply: 7 bar}
"""


# Sums of coordinates, wrenches, coordinates of balls and free joints; gains, biases and ranges.
PLACES = """
mechanism: places
parts:
  arm: {mass: 2, center: [0.1, 0, -0.3], inertia: [0.1, 0.12, 0.03]}
  hand: {mass: 1, center: [0, 0.1, 0.1], inertia: [0.03, 0.02, 0.04]}
  head: {mass: 1, center: [0.1, 0, 0.2], inertia: [0.05, 0.06, 0.04]}
  drone: {mass: 1.5, center: [0, 0.05, 0], inertia: [0.1, 0.2, 0.25], points: {rotor: {at: [0.2, 0.1, 0], rotate: {rpy: [0.3, 0.1, -0.2]}}}}
  tail: {mass: 0.7, center: [0.1, 0, 0], inertia: [0.05, 0.06, 0.07]}
  fin: {mass: 0.3, center: [0, 0.1, 0], inertia: [0.01, 0.02, 0.015]}
joints:
  a: {type: revolute, between: [ground, arm], axis: [0, 1, 0.2]}
  b: {type: revolute, between: [arm, hand], axis: [1, 0, 0]}
  c: {type: spherical, between: [hand, head]}
  d: {type: free, between: [ground, drone]}
  e: {type: free, between: [hand, tail]}
  f: {type: revolute, between: [tail, fin], axis: [1, 2, 0]}
actuators:
  sum: {type: effort, terms: {a: 1.5, b: -0.4}, gain: [2, 0.5, -0.3], bias: [0.2, -3, -0.7], effort_range: [-4, 20]}
  held: {type: effort, terms: {a: 1, b: 1}, servo: {controls: position, kp: 9, kd: 2}, command_range: [0.2, 0.9]}
  turn: {type: effort, terms: {c.rx: 1, c.rz: -2, d.z: 0.5}, effort_range: [-1, 3]}
  thrust: {type: effort, at: drone.rotor, wrench: [0, 0.1, 1, 0, 0.02, -0.05], command_range: [0, 5], bias: [0, 0, -0.2]}
  x: {type: effort, joint: c.rx, rotor_inertia: 0.05}
  y: {type: effort, joint: c.ry, rotor_inertia: 0.05}
  z: {type: effort, joint: c.rz, rotor_inertia: 0.05}
  dz: {type: effort, joint: d.z, lead: 1, rotor_inertia: 0.01}
  ex: {type: effort, joint: e.x, lead: 1, rotor_inertia: 0.02}
  ez: {type: effort, joint: e.z, lead: 1, rotor_inertia: 0.03}
  erx: {type: effort, joint: e.rx, rotor_inertia: 0.04}
  ery: {type: effort, joint: e.ry, rotor_inertia: 0.04}
  erz: {type: effort, joint: e.rz, rotor_inertia: 0.04}
"""


def test_rotors_on_the_coordinates_of_balls_and_free_joints():
    """By Lagrange's equations too, in which the spin of the ball is not the rate of a coordinate."""
    text = "\n".join(
        line for line in PLACES.splitlines() if not line.strip().startswith(("sum", "held", "turn", "thrust"))
    )
    mechanism, rng = parse_mechanism(text), np.random.default_rng(6)
    derived, lagrange = derive(mechanism), lagrange_equations(mechanism)
    for _ in range(3):
        q, u, efforts = random_state(mechanism, rng)
        exact = lagrange.accelerations(q, u, efforts, 0.0)
        y, inputs = derived.start_state.copy(), derived.inputs_without_commands.copy()
        y[: len(q) + len(u)], inputs[derived.inputs.efforts] = np.concatenate([q, u]), efforts
        found = np.array(derived.rates.call([0.0, y, inputs])[0]).ravel()[len(q) : len(q) + len(u)]
        assert found == pytest.approx(np.array(exact).ravel(), rel=1e-10, abs=1e-9)


@pytest.mark.parametrize("text", [ACTUATED, PLACES], ids=["actuated", "places"])
def test_efforts_and_rotors_of_actuators(text):
    rng, mechanism = np.random.default_rng(5), parse_mechanism(text)
    derived = derive(mechanism)
    layout = derived.layout
    for _ in range(4):
        q, u, efforts = random_state(mechanism, rng, reach=0.9)
        y, inputs = derived.start_state.copy(), derived.inputs_without_commands
        y[: len(q) + len(u)], inputs[derived.inputs.efforts] = np.concatenate([q, u]), efforts
        driving = {}
        for actuator, slots in zip(mechanism.actuators, derived.actuator_layout.slots, strict=True):
            scale = {"pressure_a": 1e6, "pressure_b": 1e6, "voltage": 40.0, "effort": 8.0, "current": 9.0}
            states = {name: index for name, index in slots.states.items() if index in derived.actuator_layout.core}
            for index, name in ((index, name) for name, index in states.items()):
                y[index] = scale.get(name, 1.0) * rng.uniform(0.2, 1.0)
            for channel, index in slots.commands.items():
                inputs[index] = scale.get(channel, 2.0) * rng.uniform(-1.0, 1.0)
            commands = {channel: inputs[index] for channel, index in slots.commands.items()}
            driving[actuator.name] = commands, {name: y[index] for name, index in states.items()}
        oracle = kane.equations(mechanism, q, u, efforts, 0.3, driving)
        found = np.array(derived.rates.call([0.3, y, inputs])[0]).ravel()[layout.nq : layout.nq + layout.nv]
        kinetic, potential = map(float, np.array(derived.energies(0.3, y)).ravel())
        assert [kinetic, potential] == pytest.approx([oracle.kinetic, oracle.potential], rel=1e-12)
        exact = oracle.accelerations
        allowed = ROUND_OFF * oracle.condition * np.linalg.norm(oracle.scale * exact)
        assert np.linalg.norm(oracle.scale * (found - exact)) <= allowed


def test_random_mechanisms_with_loops_and_constraints():
    """A few contradict their drives, are rigid, or cannot be closed a little later."""
    outcomes = Counter()

    @settings(max_examples=6)
    @given(random_mechanisms())
    def compare(drawn):
        text, rng = drawn
        mechanism = parse_mechanism(text)
        if not (mechanism.closing or mechanism.constraints):
            outcomes["open"] += 1
            return
        try:
            outcomes["compared" if check(mechanism, rng, t=0.05) else "not comparable"] += 1
        except MechanismError:
            outcomes["refused"] += 1

    compare()
    assert outcomes["compared"] >= 4
    assert outcomes["refused"] + outcomes["not comparable"] <= 1


def long_chain(number):
    parts = {f"p{i}": "{mass: 0.5, shape: {type: rod, to: [0.1, 0.05, -0.3]}}" for i in range(number)}
    axes = ([0, 1, 0], [1, 2, 3], [1, 0, 0])
    lines = ["mechanism: long_chain", "parts:"]
    lines += [f"  {name}: {body[:-1]}, points: {{tip: [0.1, 0.05, -0.3]}}}}" for name, body in parts.items()]
    lines.append("joints:")
    for i in range(number):
        inboard = f"p{i - 1}.tip" if i else "ground"
        ends = f"[{inboard}, p{i}]" if i % 2 else f"[p{i}, {inboard}]"
        lines.append(f"  j{i}: {{type: revolute, between: {ends}, axis: {axes[i % 3]}, stiffness: 1}}")
    return "\n".join(lines)


def test_long_chain():
    mechanism, rng = parse_mechanism(long_chain(15)), np.random.default_rng(3)
    derived = derive(mechanism)
    for _ in range(3):
        q, u, efforts = random_state(mechanism, rng)
        oracle = kane.equations(mechanism, q, u, efforts)
        error = oracle.scale * (accelerations(derived, q, u, efforts) - oracle.accelerations)
        largest = np.linalg.norm(oracle.scale * oracle.accelerations)
        assert np.linalg.norm(error) <= min(1e-10, ROUND_OFF * oracle.condition) * largest


def test_order_of_parts_and_declaration_do_not_matter():
    """The same mechanism with its joints declared in another order has the same motion, with its coordinates in another order."""
    text = FLOATING.replace("  a: {type: revolute", "  z: {type: revolute")
    lines = text.strip().splitlines()
    moved = next(line for line in lines if line.strip().startswith("z:"))
    other = "\n".join([*(line for line in lines if line is not moved), moved])
    first, second = parse_mechanism(text), parse_mechanism(other)
    q, u, efforts = random_state(first, np.random.default_rng(4))
    swap_q, swap_u = [*range(7), 8, 9, 7], [*range(6), 7, 8, 6]
    a = accelerations(derive(first), q, u, efforts)
    b = accelerations(derive(second), q[swap_q], u[swap_u], efforts[swap_u])
    assert second.coordinate_names == tuple(first.coordinate_names[i] for i in swap_u)
    assert b == pytest.approx(a[swap_u], rel=1e-12)


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_a_joint_with_its_parts_exchanged_has_the_opposite_coordinate(kind):
    """[ground, body] with axis a and [body, ground] with axis -a are one joint: same coordinate, effort and motion."""
    text = f"""
mechanism: one
parts: {{body: {{mass: 2, center: [0.3, 0.1, 0], inertia: [1, 2, 2.5], points: {{p: [0.1, 0.2, 0.3]}}}}}}
joints: {{j: {{type: {kind}, between: [ENDS], axis: AXIS, stiffness: 3, rest: 0.2, damping: 0.5}}}}
"""
    forward = derive(parse_mechanism(text.replace("ENDS", "ground, body.p").replace("AXIS", "[1, 2, 3]")))
    backward = derive(parse_mechanism(text.replace("ENDS", "body.p, ground").replace("AXIS", "[-1, -2, -3]")))
    q, u, effort = np.array([0.7]), np.array([-1.2]), np.array([4.0])
    assert accelerations(backward, q, u, effort) == pytest.approx(accelerations(forward, q, u, effort), rel=1e-13)
    y = np.concatenate([q, u, np.zeros(3)])
    assert np.array(backward.poses(0.0, y)) == pytest.approx(np.array(forward.poses(0.0, y)), abs=1e-14)


def test_a_positive_effort_accelerates_its_coordinate_in_either_order_of_the_parts():
    text = """
mechanism: one
gravity: [0, 0, 0]
parts: {body: {mass: 2, inertia: [1, 1, 1]}}
joints: {j: {type: revolute, between: [ENDS], axis: [0, 0, 1]}}
"""
    for ends in ("ground, body", "body, ground"):
        found = accelerations(derive(parse_mechanism(text.replace("ENDS", ends))), np.zeros(1), np.zeros(1), [3.0])
        assert found == pytest.approx([3.0], rel=1e-15)


def test_an_oblique_axis_costs_no_more_than_a_rotated_frame():
    """A link's frame is rotated so that its axis is exactly z. Round-off in the axis would triple the instructions."""
    text = """
mechanism: one
parts:
  body: {mass: 1, inertia: {xx: 1, yy: 2, zz: 2.5, xy: 0.1, xz: 0.2, yz: 0.3}, center: [0.1, 0.2, 0.3]}
  other: {mass: 1, inertia: {xx: 1, yy: 2, zz: 2.5, xy: 0.1, xz: 0.2, yz: 0.3}, center: [0.1, 0.2, 0.3]}
ground: {points: {turned: {rotate: {axis: [1, -2, 1], angle: 0.7}}}}
joints:
  j: {type: revolute, between: [ground.turned, body], axis: AXIS}
  k: {type: revolute, between: [body, other.turned], axis: AXIS}
"""
    text = text.replace("  other: {", "  other: {points: {turned: {rotate: {axis: [1, -2, 1], angle: 0.7}}}, ")
    straight, *oblique = (
        instruction_count(derive(parse_mechanism(text.replace("AXIS", axis))).rates)
        for axis in ("[0, 0, 1]", "[1, 2, 3]", "[-1, 2, 0.5]", "[0.3, 0, -0.7]")
    )
    assert max(oblique) <= 1.1 * straight
