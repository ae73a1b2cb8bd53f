"""Equilibria on supports, stops and ropes, found from starts at which nothing touches: closed forms, in turned axes."""

from __future__ import annotations

import json

import numpy as np
import pytest

from mbd_sim import InputError, Simulation
from mbd_sim.analysis.equilibria import equilibrium
from mbd_sim.base.geometry import rotation as rot
from mbd_sim.studies.linear_analysis import equilibria_of, loci, set_to_equilibrium

G = 9.81


@pytest.fixture(autouse=True)
def few_attempts(monkeypatch):
    """The configurations from which no equilibrium is found take most of the time."""
    monkeypatch.setattr(equilibrium, "ATTEMPTS", 2)


def simulation(turn, parts, joints, length=1.0, **more):
    """A mechanism of which the vectors of `up` and `across` are turned with gravity."""
    gravity = (-G * length * turn[:, 2]).tolist()
    data = {"mechanism": "rests", "gravity": gravity, "parts": parts, "joints": joints, **more}
    return Simulation.from_text(json.dumps(data))


def turned():
    return rot.from_quaternion(rot.unit(np.random.default_rng(7).normal(size=4)))


def test_two_weights_on_a_spring_over_a_floor():
    """The lower one rests on the floor, the upper one compresses the spring by m g / k: nothing of that was found."""
    turn, length = turned(), 1e-3
    up = turn[:, 2].tolist()
    parts = {"a": {"mass": 1.0}, "b": {"mass": 2.0}}
    joints = {
        name: {"type": "prismatic", "between": ["ground", name], "axis": up, "position": at * length}
        for name, at in (("a", 0.5), ("b", 1.5))
    }
    floor = {"type": "on_plane", "point": "a", "normal": up, "bound": "at_least", "restitution": 0.3}
    spring = {"type": "spring", "between": ["a", "b"], "stiffness": 400.0, "length": 1.0 * length}
    found = simulation(turn, parts, joints, length, constraints={"floor": floor}, forces={"spring": spring})
    near = set_to_equilibrium(found)
    assert near.q == pytest.approx([0.0, length * (1.0 - 2.0 * G / 400.0)], abs=1e-9 * length)
    assert near.stable
    found.run(until=0.02)
    assert found.q == pytest.approx(near.q, abs=1e-9 * length)


def test_an_arm_falls_on_its_stop_and_may_also_rest_upright():
    """From 30° it sinks to the stop at -20°; standing upright, against no stop, is the other equilibrium."""
    turn = turned()
    arm = {"mass": 1.0, "center": (0.5 * turn[:, 0]).tolist(), "inertia": [0.1, 0.1, 0.1]}
    limits = {"lower": "-20 deg", "upper": "95 deg", "restitution": 0.5}
    hinge = {"type": "revolute", "between": ["ground", "arm"], "axis": (-turn[:, 1]).tolist()}
    joints = {"hinge": {**hinge, "position": "30 deg", "limits": limits}}
    found = simulation(turn, {"arm": arm}, joints)
    assert np.degrees([one.q[0] for one in equilibria_of(found)]) == pytest.approx([-20.0, 90.0])
    assert np.degrees(set_to_equilibrium(found).q) == pytest.approx([-20.0])


def test_a_weight_on_a_rope_hangs_at_its_end():
    turn = turned()
    axis = turn[:, 2].tolist()
    joints = {"z": {"type": "prismatic", "between": ["ground", "b"], "axis": axis, "position": -0.1}}
    rope = {"type": "distance", "between": ["ground", "b"], "length": 0.7, "bound": "at_most"}
    found = simulation(turn, {"b": {"mass": 3.0}}, joints, constraints={"rope": rope})
    near = set_to_equilibrium(found)
    assert near.q == pytest.approx([-0.7])
    assert near.distance == pytest.approx(0.6)


def test_what_nothing_supports_has_no_equilibrium(monkeypatch):
    """A weight over a ceiling that holds it only from above: it falls for ever, and the simulation stays as it was."""
    joints = {"z": {"type": "prismatic", "between": ["ground", "b"], "axis": [0, 0, 1], "position": -0.1}}
    ceiling = {"type": "on_plane", "point": "b", "normal": [0, 0, 1], "bound": "at_most"}
    found = simulation(np.eye(3), {"b": {"mass": 3.0}}, joints, constraints={"ceiling": ceiling})
    monkeypatch.setattr(loci, "FALLING", 1000)
    with pytest.raises(InputError, match="no equilibrium"):
        set_to_equilibrium(found)
    assert found.q == pytest.approx([-0.1])
