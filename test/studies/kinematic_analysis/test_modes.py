"""The number of assembly modes against counts by another way: intersections of coupler curves with circles."""

import numpy as np
import pytest

from mbd_sim import InputError, parse_mechanism
from mbd_sim.studies.kinematic_analysis import assembly_modes
from mbd_sim.studies.kinematic_analysis.text import modes_text
from test.studies.kinematic_analysis.linkages import few_starts, four_bar, rocker_angles

SIX_BAR = """
mechanism: stephenson
ground: {points: {right: [1.9, 0, 0], far: [1.9, 1, 0]}}
parts:
  crank: {mass: 1, points: {tip: [1.1, 0, 0]}}
  coupler: {mass: 1, points: {tip: [2.4, 0, 0], side: [1.3, 0.7, 0]}}
  rocker: {mass: 1, points: {tip: [1.8, 0, 0]}}
  arm: {mass: 1, points: {tip: [1, 0, 0]}}
  link: {mass: 1, points: {tip: [1.2, 0, 0]}}
joints:
  motor: {type: revolute, between: [ground, crank], axis: [0, 0, 1], position: 60 deg, guess: true}
  pin: {type: revolute, between: [crank.tip, coupler], axis: [0, 0, 1], position: -20 deg, guess: true}
  pivot: {type: revolute, between: [ground.right, rocker], axis: [0, 0, 1], position: 70 deg, guess: true}
  rocker_pin: {type: revolute, between: [coupler.tip, rocker.tip], axis: [0, 0, 1], cut: true}
  arm_pivot: {type: revolute, between: [ground.far, arm], axis: [0, 0, 1], position: 180 deg, guess: true}
  arm_pin: {type: revolute, between: [arm.tip, link], axis: [0, 0, 1], position: -90 deg, guess: true}
  side: {type: revolute, between: [coupler.side, link.tip], axis: [0, 0, 1], cut: true}
"""
# A crank and a rocker about a slanted axis, joined by a coupler with a ball and a universal joint.
SPATIAL = """
mechanism: rsur
ground: {points: {far: [1.0, 0.4, 0]}}
parts:
  crank: {mass: 1, points: {tip: [0.3, 0, 0]}}
  coupler: {mass: 1, points: {tip: [1.1, 0, 0]}}
  rocker: {mass: 1, points: {tip: [0.2, 0.6, 0]}}
joints:
  motor: {type: revolute, between: [ground, crank], axis: [0, 0, 1]}
  pivot: {type: revolute, between: [ground.far, rocker], axis: [0, 1, 0.3], position: 10 deg, guess: true}
  pose: {type: free, between: [ground, coupler]}
  ball: {type: spherical, between: [crank.tip, coupler], cut: true}
  cross: {type: universal, between: [coupler.tip, rocker.tip], axes: [[0, 1, 0], [0, 0, 1]], cut: true}
"""
SIZES = {"a": 1.1, "b": 2.4, "c": 1.8, "d": 1.9}


def branches(theta):
    """The point `side` of the coupler in both modes of the four-bar; nan where it does not close."""
    a, b, c, d = SIZES.values()
    tip = a * np.exp(1j * theta)
    across = d - tip
    along = (b**2 - c**2 + np.abs(across) ** 2) / (2 * np.abs(across))
    with np.errstate(invalid="ignore"):
        height = np.sqrt(b**2 - along**2)
    return [tip + (1.3 + 0.7j) / b * (along + 1j * sign * height) * across / np.abs(across) for sign in (1, -1)]


def test_a_four_bar_has_two():
    modes = assembly_modes(four_bar(), {"motor": 1.0})
    assert len(modes) == 2 and sum(modes.found) <= modes.starts and min(modes.found) > 50
    assert modes.chance_of_another == 0.0
    assert np.min(np.abs(np.mod(modes.q[:, 2], 2 * np.pi) - rocker_angles(np.ones(1))[0])) < 1e-13


def test_a_six_bar_has_six_when_it_is_driven_from_the_other_loop():
    """A coupler curve of sixth order meets a circle in six further points (Hunt 1978): here all of them are real."""
    theta = np.linspace(0, 2 * np.pi, 20001)
    distances = [np.abs(point - (0.9 + 1j)) - 1.2 for point in branches(theta)]
    crossings = sum(int(np.sum(one[:-1] * one[1:] < 0)) for one in distances)
    modes = assembly_modes(parse_mechanism(SIX_BAR), {"arm_pivot": np.pi})
    assert len(modes) == crossings == 6
    angles = sorted(np.mod(modes.q[:, 0], 2 * np.pi))
    places = [theta[:-1][one[:-1] * one[1:] < 0] for one in distances]
    assert angles == pytest.approx(sorted(np.concatenate(places)), abs=4e-4)


def test_bodies_without_a_joint_to_their_neighbors_are_thrown_into_any_pose():
    """Of a body that is placed by a free joint, as of others: position, orientation, and the sign of quaternions.

    The tip of the rocker is on a sphere about that of the crank, so that A cos φ + B sin φ = C. For each of both angles
    the universal joint allows two poses of the coupler, half a turn about its axis from each other.
    """
    modes = assembly_modes(parse_mechanism(SPATIAL), {"motor": 0.5})
    axis, tip, center = np.array([0, 1, 0.3]) / np.sqrt(1.09), np.array([0.2, 0.6, 0]), np.array([1.0, 0.4, 0])
    crank = 0.3 * np.array([np.cos(0.5), np.sin(0.5), 0])
    along, across = axis * (axis @ tip), np.cross(axis, tip)
    still = center + along - crank
    a, b = 2 * still @ (tip - along), 2 * still @ across
    c = 1.1**2 - still @ still - across @ across
    angles = np.arctan2(b, a) + np.array([-1, 1]) * np.arccos(c / np.hypot(a, b))
    assert modes.q[:, 1] == pytest.approx(np.repeat(np.sort(angles), 2), abs=1e-12)
    assert np.allclose(modes.q[:, 2:5], crank, atol=1e-12)
    w, x, y, z = modes.q[:, 5:].T
    assert np.all(w >= 0) and np.allclose(w**2 + x**2 + y**2 + z**2, 1, atol=1e-12)
    ahead = 1.1 * np.array([1 - 2 * (y**2 + z**2), 2 * (x * y + w * z), 2 * (x * z - w * y)]).T
    turned = np.outer(np.cos(modes.q[:, 1]), tip - along) + np.outer(np.sin(modes.q[:, 1]), across)
    assert np.allclose(crank + ahead, center + along + turned, atol=1e-11)
    assert np.allclose(np.abs(np.sum(modes.q[::2, 5:] * modes.q[1::2, 5:], axis=1)), 0, atol=1e-11)  # half a turn


def test_no_mode_is_an_error(monkeypatch):
    few_starts(monkeypatch)
    with pytest.raises(InputError, match=r"cannot be assembled at motor = 3.14159: none of 30 starts"):
        assembly_modes(four_bar(1.0, 1.0, 1.1, 2.2, 40), {"motor": np.pi})


def test_a_joint_that_the_file_drives_is_among_the_coordinates(monkeypatch):
    few_starts(monkeypatch)
    driven = four_bar().source.text.replace("position: 60 deg}", "drive: 2*t}")
    modes = assembly_modes(parse_mechanism(driven), {"motor": np.pi / 3})
    free = assembly_modes(four_bar(), {"motor": np.pi / 3})
    assert np.array_equal(modes.q, free.q)
    assert modes_text(modes) == modes_text(free)
    assert "motor = 60 deg, pin = " in modes_text(modes)
