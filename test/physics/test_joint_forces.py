"""Forces in joints and constraints against Newton's law for the parts that they support, at random states."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from mbd_sim.dynamics.equations import derive
from mbd_sim.files.load import load_mechanism
from test.generators.mechanisms import random_state

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
