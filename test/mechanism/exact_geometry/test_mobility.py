"""Linkages that move only because of all their lengths together, written with the digits that people write."""

from __future__ import annotations

import json

import numpy as np
import pytest

from mbd_sim.files.load import parse_mechanism
from mbd_sim.mechanism.exact_geometry.digits import Digits, half_unit_of_angles
from test.mechanism.exact_geometry.linkages import TOGETHER, mechanism_file
from test.mechanism.exact_geometry.test_snapping import frames_of, freedoms_of, rates_at_start


def written(name, seed, digits, **more):
    rng = np.random.default_rng(seed)
    linkage = TOGETHER[name](rng)
    return mechanism_file(linkage, np.random.default_rng(seed + 100), digits, **more), linkage.freedoms


@pytest.mark.parametrize(
    ("name", "seed", "digits"),
    [
        ("bennett", 0, 4), ("spherical legs", 4, 6),
    ],
)  # fmt: skip
def test_it_has_the_freedoms_of_the_exact_linkage_and_no_number_leaves_its_digits(name, seed, digits):
    found, freedoms = written(name, seed, digits)
    assert freedoms_of(found) == freedoms
    limit = 10.0 * 10.0**-digits  # of numbers up to 2 m, in each of three directions
    assert 0.0 < max(move.distance for move in found.moved.values()) < limit


@pytest.mark.parametrize("name", ["bennett", "four cranks"])
def test_an_exact_linkage_keeps_its_bits(name):
    found, freedoms = written(name, 3, 17)
    assert not found.moved
    assert freedoms_of(found) == freedoms


def test_it_moves_as_the_exact_one_within_the_digits():
    mechanisms = [written("bennett", 1, count)[0] for count in (17, 6)]
    exact, found = map(frames_of, mechanisms)
    assert found == pytest.approx(exact, abs=5e-4)
    exact, found = map(rates_at_start, mechanisms)
    assert found == pytest.approx(exact, abs=1e-3 * np.max(np.abs(exact)))


CRANKS = """
mechanism: cranks
ground: {points: {p2: [0.7125, 0, 0], p3: [0.3017, 0, 0.4148]}}
parts:
  crank1: {mass: 0.5, shape: {type: rod, to: [0.2, 0, 0]}, points: {tip: [0.2, 0, 0]}}
  crank2: {mass: 0.4, shape: {type: rod, to: [0.2, 0, 0]}, points: {tip: [0.2, 0, 0]}}
  crank3: {mass: 0.3, shape: {type: rod, to: [0.2, 0, 0]}, points: {tip: [LENGTH, 0, 0]}}
  coupler: {mass: 1.2, center: [0.33, 0, 0.13], inertia: [0.02, 0.05, 0.03], points: {b2: [0.7125, 0, 0], b3: [0.3017, 0, HEIGHT]}}
joints:
  a1: {type: revolute, between: [ground, crank1], axis: [0, -1, 0], position: 0.6}
  a2: {type: revolute, between: [ground.p2, crank2], axis: [0, -1, 0], position: 0.6, guess: true}
  a3: {type: revolute, between: [ground.p3, crank3], axis: [0, -1, 0], position: 0.6, guess: true}
  b1: {type: revolute, between: [crank1.tip, coupler], axis: [0, -1, 0], position: -0.6, guess: true}
  b2: {type: revolute, between: [crank2.tip, coupler.b2], axis: [0, -1, 0], cut: true}
  b3: {type: revolute, between: [crank3.tip, coupler.b3], axis: [0, -1, 0], cut: true}
"""


def test_a_crank_that_is_longer_by_one_unit_of_the_last_digit_is_meant_so():
    assert not parse_mechanism(CRANKS.replace("LENGTH", "200.001 mm").replace("HEIGHT", "0.4148")).moved


def test_a_point_that_is_off_by_less_than_the_digits_of_the_others_is_moved():
    """As in a file with numbers from two programs; 0.2 stays 0.2."""
    text = CRANKS.replace("LENGTH", "0.2").replace("HEIGHT", "0.41483")
    found = parse_mechanism(text)
    assert {"a3", "b3"} <= found.moved.keys() <= {"a2", "b2", "a3", "b3"}
    assert 1e-6 < max(move.distance for move in found.moved.values()) < 5e-5
    assert all(found.joints[name].child_pose.position[0] in (0.0, 0.2) for name in ("a1", "a2", "a3"))
    assert freedoms_of(found) == 1
    kept = parse_mechanism(text + "tolerance: 0\n")
    assert not kept.moved
    assert "tolerance: 0 keeps '" in kept.source.remarks[-1]


def rods(lengths, digits):
    """Three parallel rods in a plane, with points that are rounded, in axes of their own on ground."""
    turn = np.array([[np.cos(0.7), -np.sin(0.7), 0.0], [np.sin(0.7), np.cos(0.7), 0.0], [0.0, 0.0, 1.0]])
    points = {"a": [0.1234567, 0.2345678, 0.0], "b": [1.1, 0.3, 0.0], "c": [0.4567891, 0.6543217, 0.0]}
    on_ground = {name: np.round(turn @ at, digits).tolist() for name, at in points.items()}
    on_part = {name: np.round(at, digits).tolist() for name, at in points.items()}
    part = {"mass": 2, "center": [0.5, 0, 0], "inertia": [0.1, 0.2, 0.2], "points": on_part}
    joint = {
        "type": "planar",
        "between": ["ground", "p"],
        "axis": [0, 0, 1],
        "position": [0.3, -0.4, 0.7],
        "guess": True,
    }
    return json.dumps({
        "mechanism": "rods", "ground": {"points": on_ground}, "parts": {"p": part}, "joints": {"j": joint},
        "constraints": {
            f"r{name}": {"type": "distance", "between": [f"ground.{name}", f"p.{name}"], "length": length}
            for name, length in zip(points, lengths, strict=True)
        },
    })  # fmt: skip


def test_rods_between_rounded_points():
    """The three points of the platform and of ground are the same triangle but for the digits."""
    found = parse_mechanism(rods([0.5] * 3, 4))
    assert found.moved
    assert freedoms_of(found) == 1


def test_digits():
    lengths = Digits([0.1414, 0.173, 0.25, 0.0, 1.0 / 3.0, 12.5])
    assert lengths.half_units(np.array([0.1414, 0.173, 1.25])) == pytest.approx([5e-5, 5e-5, 5e-4])
    assert not lengths.half_units(np.array([0.25, 0.0, 1.0 / 3.0, 12.0])).any()
    assert not Digits([0.2, 0.125]).half_units(np.array([0.125])).any()


def test_digits_of_angles():
    data = {
        "a": {"axis": [0, 0.7071, 0.7071]},
        "b": [{"rotate": {"axis": [1, 0, 0], "angle": "40.25 deg"}}],
        "mass": 1.23,
    }
    assert half_unit_of_angles(data) == pytest.approx(0.5 * 0.01 * np.pi / 180.0)
    assert half_unit_of_angles({"points": {"a": [0.1234, 0, 0]}}) == 0.0
