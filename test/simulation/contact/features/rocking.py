"""Bars that fall on round ends beside their axes, and roll, rock and slide there."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mbd_sim import Simulation

ROCKING = {"cylinder": (0.12, 0.05, 2.2, 1), "disc": (0.09, 0.03, 1.5, -1), "cone": (0.14, 0.04, 1.3, -1)}
"""Radii of the end and of the bar in m, the length of the bar over the first of them, and the order of both bodies."""


def bar_and_end(bar, kind):
    """A bar above a round end that is fixed: one mechanism for all starts of a kind."""
    rim, radius, length, order = ROCKING[kind]
    end = {"type": kind, "radius": rim, "mass": 1} | ({} if kind == "disc" else {"length": 0.1})
    end |= {"axis": [0, 0, -1]} if kind == "cone" else {}
    shape = {"type": bar, "radius": radius, "length": length * rim, "axis": [1, 0, 0], "mass": 1}
    joints = {"end": {"type": "fixed", "between": ["ground", "end"]}}
    joints["bar"] = {"type": "free", "between": ["ground", "bar"], "position": [0, 0, 1]}
    contact = {"between": ["bar", "end"][::order], "restitution": 0}
    parts = {"end": {"shape": end}, "bar": {"shape": shape}}
    return json.dumps({"mechanism": "rocking", "parts": parts, "joints": joints, "contacts": {"c": contact}})


def rocking(bar, kind, seed):
    """A `capsule` or a `cylinder` that falls on a round end beside its axis."""
    chance, (rim, radius, _, _) = np.random.default_rng([seed, 7]), ROCKING[kind]
    simulation = Simulation.from_text(bar_and_end(bar, kind), step=1e-3, live=["contacts.c.restitution"])
    simulation.set_live({"contacts.c.restitution": 0.3 * (seed % 3)})
    place = [*(rim * chance.normal(size=2) * [0.2, 0.4]), (0.0 if kind == "disc" else 0.05) + radius + 0.3 * rim + 0.02]
    x, y, z, w = Rotation.from_euler("xyz", [0.0, 0.12 * chance.normal(), chance.normal()]).as_quat()
    velocity, spin = 0.15 * chance.normal(size=3), chance.normal(size=3)
    simulation.reset([*place, w, x, y, z], [*velocity, *spin])
    return simulation


def require_energy_and_spin(simulation):
    """No force on the rim or the end has a moment about the axis, so that impacts do not change that spin either."""
    begun = simulation.momentum([0, 0, 0]).angular[2]
    while simulation.time < 0.5 and simulation.q[2] > 0.0:
        simulation.step(10)
        assert simulation.momentum([0, 0, 0]).angular[2] == pytest.approx(begun, abs=1e-12)
    assert simulation.contact_event_count > 4
    assert abs(simulation.energies.residual) < 5e-9  # by contacts that are found within 1e-9 m
