"""Forces in joints and constraints against Newton's law for the parts that they support, at random states."""

from __future__ import annotations

import functools

import casadi as ca
import numpy as np
import pytest

from mbd_sim.dynamics.equations import derive
from mbd_sim.files.load import load_mechanism
from test.generators.mechanisms import consistent_state, random_state

G = 9.81


@functools.cache
def equations(name):
    return derive(load_mechanism(name))


@functools.cache
def reactions(name):
    return equations(name).reactions


def wrenches(name, q, u, efforts, t=0.0):
    """Force and moment (6,) on the second part of each joint by its first, in ground's axes, by name."""
    mechanism, y = load_mechanism(name), np.concatenate([q, u, np.zeros(3)])
    columns = np.array(reactions(name)(t, y, efforts)).T
    return dict(zip([*mechanism.joints, *mechanism.closing], columns, strict=True))


def free_states(name, number=20):
    """States, times and efforts of an open chain."""
    mechanism, rng = load_mechanism(name), np.random.default_rng(90)
    for _ in range(number):
        yield *random_state(mechanism, rng), rng.uniform(0.0, 5.0)


def near(expected):
    return pytest.approx(np.asarray(expected), rel=0.0, abs=1e-12 * max(np.max(np.abs(expected)), 1.0))


def test_tension_of_the_simple_pendulum():
    """Huston & Liu, sec. 8.4: T = m g cos θ + m l θ'² along the rod; an effort pushes across it."""
    p = load_mechanism("simple_pendulum").parameters
    for q, u, effort, _ in free_states("simple_pendulum"):
        (theta,), (rate,) = q, u
        toward_the_pin = np.array([-np.sin(theta), 0.0, np.cos(theta)])
        across = np.array([np.cos(theta), 0.0, np.sin(theta)])
        tension = p["m"] * G * np.cos(theta) + p["m"] * p["l"] * rate**2
        found = wrenches("simple_pendulum", q, u, effort)["pin"]
        assert found[:3] == near(tension * toward_the_pin + effort / p["l"] * across)
        assert found[3:] == near([0.0, -effort[0], 0.0])


def test_pin_of_the_rod_pendulum():
    """Huston & Liu, sec. 8.9: Ox and Oy support the rod's weight and accelerate its center of mass."""
    m, length = 1.0, 1.0
    for q, u, _, _ in free_states("rod_pendulum"):
        (theta,), (rate,) = q, u
        c, s, second = np.cos(theta), np.sin(theta), -1.5 * G * np.sin(theta)
        across, along = 0.5 * m * length * second, 0.5 * m * length * rate**2
        found = wrenches("rod_pendulum", q, u, np.zeros(1))["pin"]
        assert found == near([across * c - along * s, 0.0, m * G + across * s + along * c, 0.0, 0.0, 0.0])


def test_contact_forces_in_the_spun_tube():
    """Huston & Liu, sec. 8.5: N_r = -m g cos θ - m r θ'² - m r Ω² sin²θ outward, and N1 = 2 m r Ω θ' cos θ along the rotation.

    (The book's n1 points against the rotation.)
    """
    name = "spun_tube_particle"
    p = load_mechanism(name).parameters
    m, r, spin = p["m"], p["r"], p["omega"]
    for q, u, _, t in free_states(name):
        (theta,), (rate,) = q, u
        ahead = np.array([-np.sin(spin * t), np.cos(spin * t), 0.0])
        level = np.array([np.cos(spin * t), np.sin(spin * t), 0.0])
        outward = np.sin(theta) * level - np.cos(theta) * np.array([0.0, 0.0, 1.0])
        radial = -m * G * np.cos(theta) - m * r * rate**2 - m * r * spin**2 * np.sin(theta) ** 2
        force = radial * outward + 2.0 * m * r * spin * rate * np.cos(theta) * ahead
        found = wrenches(name, q, u, np.zeros(1), t)
        assert found["slide"][:3] == near(force)
        assert found["spin"][:3] == near(force)  # the tube has no mass
        moment = np.cross(r * outward, force)
        assert found["spin"][3:] == near(moment)
        drive = equations(name).drives(t, np.concatenate([q, u, np.zeros(3)]), np.zeros(1))
        assert np.array(drive).ravel()[2] == pytest.approx(moment[2], rel=1e-11, abs=1e-11)


def test_rod_of_the_constrained_pendulum():
    """Géradin & Rixen, p. 34-40: the multiplier times the constraint's gradient is the force of the rod."""
    derived, p = equations("constrained_pendulum"), load_mechanism("constrained_pendulum").parameters
    rng = np.random.default_rng(91)
    for _ in range(20):
        q, u, _ = consistent_state(derived, rng)
        y = np.concatenate([q, u, np.zeros(3)])
        theta = np.arctan2(q[1], p["l"] + q[0])
        tension = p["m"] * G * np.cos(theta) + p["m"] * (u @ u) / p["l"]
        gradient = derived.constraints.gradient(0.0, q)[0]
        force = float(derived.multipliers(0.0, y, np.zeros(2))) * gradient
        assert force == near(-tension * np.array([np.cos(theta), np.sin(theta)]))


def needed_wrenches(derived, mechanism, y, efforts):
    """Force and moment about the center of mass (6,) that each part needs besides its weight (Newton–Euler)."""
    state = ca.SX.sym("y", len(y))
    rates = derived.rates.call([0.0, state, efforts])[0]
    poses = derived.poses(0.0, state)
    first = ca.jtimes(poses, state, rates)
    second = ca.jtimes(first, state, rates)
    values = ca.Function("motion", [state], [poses, first, second])(y)
    pose, first, second = (np.array(value).reshape(-1, 4, 3) for value in values)
    found = {}
    for index, name in enumerate(derived.part_names):
        part, turn = mechanism.parts[name], pose[index, 1:].T
        spin = first[index, 1:].T @ turn.T
        turning = second[index, 1:].T @ turn.T - spin @ spin
        omega, alpha = ([m[2, 1], m[0, 2], m[1, 0]] for m in (spin, turning))
        tensor = turn @ part.inertia @ turn.T
        of_center = second[index, 0] + second[index, 1:].T @ part.center
        force = part.mass * (of_center - mechanism.gravity)
        found[name] = np.concatenate([force, tensor @ alpha + np.cross(omega, tensor @ omega)])
    return pose, found


@pytest.mark.parametrize("name", ["four_bar", "slider_crank", "rssr", "a04_bricard", "a02_four_bars"])
def test_joint_reactions_satisfy_newton_and_euler_for_every_part(name):
    """The reactions of all joints of a part, including cut ones, satisfy the Newton–Euler equations."""
    derived, mechanism, rng = equations(name), load_mechanism(name), np.random.default_rng(92)
    for _ in range(5):
        q, u, efforts = consistent_state(derived, rng, reach=0.3)
        poses, needed = needed_wrenches(derived, mechanism, np.concatenate([q, u, np.zeros(3)]), efforts)
        frames = {part: (pose[0], pose[1:].T) for part, pose in zip(derived.part_names, poses, strict=True)}
        frames["ground"] = np.zeros(3), np.eye(3)
        forces = wrenches(name, q, u, efforts)
        totals = {part: np.zeros(6) for part in mechanism.parts}
        for joint in mechanism.all_joints.values():
            origin, turn = frames[joint.child]
            point, force = origin + turn @ joint.child_pose.position, forces[joint.name]
            for part, sign in ((joint.child, 1.0), (joint.parent, -1.0)):
                if part != "ground":
                    arm = point - frames[part][0] - frames[part][1] @ mechanism.parts[part].center
                    totals[part][:3] += sign * force[:3]
                    totals[part][3:] += sign * (force[3:] + np.cross(arm, force[:3]))
        largest = max(np.max(np.abs(force)) for force in forces.values())
        for part, total in totals.items():
            assert total == pytest.approx(needed[part], rel=0.0, abs=1e-11 * max(largest, 1.0))
