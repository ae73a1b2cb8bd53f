"""Joint reactions against the Newton–Euler equations of each part, and the power theorem."""

from __future__ import annotations

import json
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings

from mbd_sim import Simulation
from mbd_sim.base.errors import MechanismError
from mbd_sim.dynamics.equations import derive
from mbd_sim.files.load import load_mechanism, parse_mechanism
from mbd_sim.mechanism.elements import constraints as c
from test.generators.loops import FREEDOMS, random_mechanisms, state_near_start, with_same_mechanisms
from test.generators.mechanisms import accelerations, random_state
from test.oracles import kane

T = 0.05


def state_of(mechanism, derived, rng, t=T):
    return state_near_start(mechanism, derived, rng, t) if derived.rows else random_state(mechanism, rng)


def padded(q, u):
    return np.concatenate([q, u, np.zeros(3)])


def loads_on_parts(mechanism, derived, q, u, efforts, t=T):
    """(part, point (3,), force (3,), moment (3,)) of every external load on a part, in ground's frame."""
    rates = accelerations(derived, q, u, efforts, t)
    moving = kane.motions(mechanism, q, u, rates, t)

    def place(part, point):
        return point if part == kane.GROUND else moving[part].origin.d[0] + moving[part].rotation.d[0] @ point

    found = []
    reactions = np.array(derived.reactions(t, padded(q, u), efforts))
    for joint, wrench in zip(mechanism.all_joints.values(), reactions.T, strict=True):
        point = place(joint.child, joint.child_pose.position)
        found += [(joint.child, point, wrench[:3], wrench[3:]), (joint.parent, point, -wrench[:3], -wrench[3:])]
    elements = replace(mechanism, bushings=tuple(one for one in mechanism.bushings if one.name not in mechanism.joints))
    for at, couple, vector in kane.element_forces(elements, moving, t, kane.NamedValues(mechanism, q, u, t))[0]:
        none = np.zeros(3)
        found.append((at.part, place(at.part, at.point), none if couple else vector, vector if couple else none))
    multipliers = np.array(derived.multipliers(t, padded(q, u), efforts)).ravel()
    for record in mechanism.constraints:
        assert isinstance(record, c.Distance)
        (row,) = (n for n, row in enumerate(derived.rows) if row.owner == ("constraints", record.name))
        ends = [place(end.part, end.point) for end in (record.first, record.second)]
        push = multipliers[row] * (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
        found += [(record.first.part, ends[0], -push, np.zeros(3)), (record.second.part, ends[1], push, np.zeros(3))]
    for name, part in mechanism.parts.items():
        found.append((name, moving[name].center.d[0], part.mass * mechanism.gravity, np.zeros(3)))
    return moving, found


def check_newton_and_euler(mechanism, rng):
    derived = derive(mechanism)
    if (state := state_of(mechanism, derived, rng)) is None:
        return False
    q, u, efforts = state
    condition = kane.equations(mechanism, q, u, efforts, T).constraint_condition if len(u) else 1.0
    moving, loads = loads_on_parts(mechanism, derived, q, u, efforts)
    size = 1.0 + max(np.linalg.norm(force) + np.linalg.norm(moment) for _, _, force, moment in loads)
    for name, part in mechanism.parts.items():
        motion = moving[name]
        turn, center, w = motion.rotation.d[0], motion.center.d[0], motion.omega
        force = part.mass * motion.center.d[2]
        moment = turn @ (part.inertia @ motion.alpha + np.cross(w, part.inertia @ w))
        for on, point, f, m in loads:
            if on == name:
                force = force - f
                moment = moment - m - np.cross(point - center, f)
        assert np.linalg.norm([*force, *moment]) <= 1e-13 * max(condition, 10.0) * size
    return True


SPRINGS_OF_JOINTS = """
mechanism: springs_of_joints
ground: {points: {foot: {at: [0.1, 0.2, 0.3], rotate: {rpy: [0.4, -0.3, 0.7]}}}}
parts:
  arm: {mass: 1.2, center: [0.1, -0.05, 0.07], inertia: [0.1, 0.12, 0.13], points: {tip: {at: [0.3, 0.1, -0.2], rotate: {rpy: [0.5, 0, -0.7]}}}}
  hand: {mass: 0.8, center: [0.2, 0, 0], inertia: [0.1, 0.12, 0.13]}
  load: {mass: 0.5, inertia: [0.1, 0.12, 0.13]}
joints:
  ball: {type: spherical, between: [ground.foot, arm], stiffness: [2, 3, 4], rest: {rpy: [0.1, 0.2, 0.3]}, damping: 0.2}
  wrist: {type: spherical, between: [hand, arm.tip], stiffness: 5}
  mount: {type: free, between: [arm, load], stiffness: [10, 20, 30, 4, 5, 6], damping: [1, 2, 3, 4, 5, 6]}
"""


def test_reactions_contain_the_springs_of_spherical_and_free_joints():
    assert check_newton_and_euler(parse_mechanism(SPRINGS_OF_JOINTS), np.random.default_rng(3))


def test_a_sensor_measures_the_moment_of_a_spring_in_a_ball_joint():
    simulation = Simulation.from_text("""
mechanism: bent
gravity: [0, 0, 0]
parts: {rod: {mass: 1, inertia: [0.1, 0.1, 0.1]}}
joints: {ball: {type: spherical, between: [ground, rod], orientation: {axis: [1, 2, 2], angle: 0.9}, stiffness: 5}}
sensors: {gauge: {type: force_torque, joint: ball}}
""")
    moment = -5.0 * 0.9 * np.array([1.0, 2.0, 2.0]) / 3.0
    np.testing.assert_allclose(simulation.reactions()["ball"].moment, moment, rtol=0.0, atol=1e-14)
    np.testing.assert_allclose(simulation.sensors()["gauge"].values["torque"], moment, rtol=0.0, atol=1e-14)


def without_massive_springs(text):
    """Springs with mass lose it, because their inertia forces belong to no part."""
    data = json.loads(text)
    for force in data["forces"].values():
        if force["type"] == "spring":
            force.pop("mass", None)
    return parse_mechanism(json.dumps(data))


def test_every_part_of_random_mechanisms_obeys_newton_and_euler():
    done = []

    @settings(max_examples=5)
    @given(random_mechanisms([*FREEDOMS, "distance"]))
    def compare(drawn):
        text, rng = drawn
        try:
            done.append(check_newton_and_euler(without_massive_springs(text), rng))
        except MechanismError:
            done.append(False)

    compare()
    assert sum(done) >= 3


@pytest.mark.parametrize("name", ["air_spring", "quadratic_drag", "universal_pendulum", "screw_press", "four_bar"])
def test_every_part_of_shipped_mechanisms_obeys_newton_and_euler(name):
    assert check_newton_and_euler(load_mechanism(name), np.random.default_rng(2))


def power_defect(derived, q, u, efforts, t=T):
    """d(T + V)/dt less the power of forces and drives plus the dissipated power, and the size of these powers, in W."""
    time, y, e = ca.SX.sym("t"), ca.SX.sym("y", len(padded(q, u))), ca.SX.sym("e", len(efforts))
    rates, energy = derived.rates.call([time, y, e])[0], ca.sum1(derived.energies(time, y))
    change = ca.jtimes(energy, y, rates) + ca.jtimes(energy, time, ca.SX(1))
    function = ca.Function("power", [time, y, e], [change, rates[-3:]])
    total, powers = (np.array(value).ravel() for value in function(t, padded(q, u), efforts))
    return abs(total[0] - powers[0] - powers[1] + powers[2]), 1.0 + abs(total[0]) + np.abs(powers).sum()


def check_power(mechanism, rng):
    derived = derive(mechanism)
    if (state := state_of(mechanism, derived, rng)) is None:
        return False
    q, u, efforts = state
    oracle = kane.equations(mechanism, q, u, efforts, T) if len(u) else None
    defect, size = power_defect(derived, q, u, efforts)
    allowed = 1e-13
    if oracle:
        size += np.abs(oracle.forces) @ np.abs(u)  # which may cancel
        allowed *= oracle.condition * oracle.constraint_condition
    assert defect <= min(1e-10, allowed) * size or (oracle and oracle.constraint_condition > 1e4)
    return True


def test_the_power_theorem_on_random_mechanisms():
    done = []

    @with_same_mechanisms
    @given(random_mechanisms())
    def compare(drawn):
        text, rng = drawn
        try:
            done.append(check_power(parse_mechanism(text), rng))
        except MechanismError:
            done.append(False)

    compare()
    assert sum(done) >= 3
