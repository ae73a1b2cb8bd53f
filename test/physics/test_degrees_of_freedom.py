"""Degrees of freedom of everyday objects (Huston & Liu, P11.2.1): speeds less the rank of the constraints."""

from __future__ import annotations

import numpy as np
import pytest

from mbd_sim.dynamics.equations import derive
from mbd_sim.files.load import load_mechanism, parse_mechanism
from test.generators.mechanisms import consistent_state

# name: speeds of the tree, equations, and their rank. The files give the reasons.
COUNTS = {
    "eyeglasses": (8, 0, 0),
    "scissors": (7, 0, 0),
    "tricycle": (10, 9, 8),
    "arm": (7, 0, 0),
    "pencil": (6, 1, 1),
    "eraser": (6, 3, 3),
}


@pytest.mark.parametrize("name", COUNTS)
def test_count(name):
    found = derive(load_mechanism(name))
    assert (found.layout.nv, len(found.rows), found.start.rank) == COUNTS[name]
    assert set(found.start.ranks) == {found.start.rank}


def test_redundant_equation_of_the_tricycle():
    """The rear wheels forbid the same sideways slip in any direction of the front wheel."""
    found = derive(load_mechanism("tricycle"))
    dropped = [row.name for index, row in enumerate(found.rows) if index not in found.start.independent]
    assert len(dropped) == 1 and dropped[0].split(":")[0] in ("left", "right") and "slip" in dropped[0]


def heading(q):
    """The heading of the tricycle's frame in rad."""
    w, x, y, z = q[3:7]
    return np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def test_tricycle_rolls_about_the_point_where_its_axles_meet():
    """At a steering angle δ it turns at v tan δ/base, and the middle of the rear axle does not slip sideways."""
    mechanism, rng = load_mechanism("tricycle"), np.random.default_rng(90)
    p, found = mechanism.parameters, derive(mechanism)
    for _ in range(10):
        q, u, _ = consistent_state(found, rng, reach=0.3)
        c, s = np.cos(heading(q)), np.sin(heading(q))
        forward, sideways = c * u[0] + s * u[1], c * u[1] - s * u[0]
        delta = q[7]
        assert sideways == pytest.approx(0.0, abs=1e-12)
        assert u[5] == pytest.approx(forward * np.tan(delta) / p["base"], rel=1e-11)
        assert u[7] == pytest.approx(forward / np.cos(delta) / p["front"], rel=1e-11)
        left, right = forward - u[5] * p["track"] / 2, forward + u[5] * p["track"] / 2
        assert u[8:] == pytest.approx([left / p["rear"], right / p["rear"]], rel=1e-11)


def test_a_fourth_corner_of_the_eraser_is_redundant():
    text = """
mechanism: eraser
parts:
  eraser:
    {mass: 1, inertia: [1, 1, 1], points: {a: [1, 1, 0], b: [-1, 1, 0], c: [-1, -1, 0], d: [1, -1, 0]}}
joints: {hand: {type: free, between: [ground, eraser]}}
constraints:
""" + "".join(f"  {corner}: {{type: on_plane, point: eraser.{corner}}}\n" for corner in "abcd")
    found = derive(parse_mechanism(text))
    assert (len(found.rows), found.start.rank, found.layout.nv - found.start.rank) == (4, 3, 3)
