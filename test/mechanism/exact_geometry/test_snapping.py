"""Linkages written with the digits that people write move as the exact ones; what is meant otherwise stays."""

from __future__ import annotations

import json

import numpy as np
import pytest

from mbd_sim import load_mechanism
from mbd_sim.analysis.mechanics.kinematics import Kinematics
from mbd_sim.base.errors import MechanismError
from mbd_sim.base.geometry import rotation as rot
from mbd_sim.dynamics.equations import derive
from mbd_sim.dynamics.math.expressions import evaluated
from mbd_sim.files.load import parse_mechanism
from test.mechanism.exact_geometry.linkages import FAMILIES, mechanism_file, sdf_text, urdf_and_loops
from test.physics.test_cut_joints import LOOPS, random_loop


def written(name, seed, digits, **more):
    """A random linkage of a family with this many digits, and the degrees of freedom of the exact one."""
    rng = np.random.default_rng(seed)
    linkage = FAMILIES[name](rng)
    return mechanism_file(linkage, rng, digits, **more), linkage.freedoms


def freedoms_of(mechanism):
    kinematics = Kinematics(mechanism)
    return len(kinematics.assembled.u) - kinematics.assembled.rank


def frames_of(mechanism):
    """The numbers of all joint frames."""
    poses = [pose for joint in mechanism.all_joints.values() for pose in (joint.parent_pose, joint.child_pose)]
    return np.concatenate([[*pose.position, *pose.rotation.ravel()] for pose in poses])


def rates_at_start(mechanism):
    """The rates of the state, which contain the accelerations."""
    equations = derive(mechanism)
    return evaluated(equations.rates, 0.0, equations.start_state, equations.inputs_without_commands).ravel()


@pytest.mark.parametrize(
    ("name", "seed", "digits"),
    [
        ("six-bar", 2, 12), ("spherical five-bar", 0, 4), ("door", 0, 4), ("sarrus", 0, 4), ("two bearings", 2, 12),
        ("three rails", 0, 4),
    ],
)  # fmt: skip
def test_a_linkage_written_with_few_digits_has_the_freedoms_of_the_exact_one(name, seed, digits):
    found, freedoms = written(name, seed, digits)
    assert found.moved or digits > 9
    assert freedoms_of(found) == freedoms
    limit = 20.0 * 10.0 ** (1 - digits)
    assert max(max(move.angle, move.distance) for move in found.moved.values()) < limit


def test_it_moves_as_the_exact_one_within_the_digits():
    mechanisms = [written("slider-crank", 5, digits)[0] for digits in (17, 6)]
    exact, found = map(frames_of, mechanisms)
    assert found == pytest.approx(exact, abs=1e-4)
    exact, found = map(rates_at_start, mechanisms)
    assert found == pytest.approx(exact, abs=3e-4 * np.max(np.abs(exact)))


@pytest.mark.parametrize("name", ["five-bar", "spherical four-bar", "two telescopes"])
def test_an_exact_linkage_keeps_its_bits(name):
    found, _ = written(name, 1, 17)
    assert not found.moved
    assert np.array_equal(frames_of(found), frames_of(written(name, 1, 17, tolerance=0)[0]))


@pytest.mark.parametrize("kinds", list(LOOPS)[:2], ids="-".join)
def test_a_loop_that_is_special_in_nothing_stays_as_written(kinds):
    """Few digits do not matter to it: it closes, and moves, as it is."""
    data = random_loop(kinds, np.random.default_rng(2))
    for points in [data["ground"]["points"], *(part["points"] for part in data["parts"].values())]:
        for point in points.values():
            point["at"] = [round(value, 5) for value in point["at"]]
    assert not parse_mechanism(json.dumps(data)).moved


def test_an_axis_that_is_meant_to_be_oblique_stays_so():
    """A hinge a fifth of a degree off locks a four-bar linkage, and the error says so."""
    found, _ = written("four-bar", 1, 17)
    data = json.loads(found.source.text)
    data["joints"]["j1"]["axis"] = [np.sin(np.radians(0.2)), 0.0, np.cos(np.radians(0.2))]
    oblique = parse_mechanism(json.dumps(data))
    assert not oblique.moved
    with pytest.raises(MechanismError):
        Kinematics(oblique)


def test_tolerance_0_keeps_everything_as_written_and_the_error_says_why_it_is_locked():
    found, _ = written("three rails", 1, 5, tolerance=0)
    assert not found.moved
    with pytest.raises(MechanismError, match=r"(?s)only just.*parallel.*more digits"):
        Kinematics(found)


def test_a_small_eccentricity_is_no_slip_of_digits():
    """A crank of 0.3 mm in a machine of 1 m: its two hinges do not coincide."""
    text = """
mechanism: eccentric
ground: {points: {a: [0, 0, 0], d: [1, 0, 0]}}
parts:
  crank: {mass: 1, inertia: [1, 1, 1], points: {b: [0.0003, 0, 0.1]}}
  coupler: {mass: 1, inertia: [1, 1, 1], points: {c: [1, 0.5, 0]}}
  rocker: {mass: 1, inertia: [1, 1, 1], points: {c: [0, 0.5, 0.1]}}
joints:
  a: {type: revolute, between: [ground.a, crank], axis: [0, 0, 1]}
  b: {type: revolute, between: [crank.b, coupler], axis: [0, AXIS, 1]}
  d: {type: revolute, between: [ground.d, rocker], axis: [0, 0, 1]}
  c: {type: revolute, between: [coupler.c, rocker.c], axis: [0, 0, 1]}
"""
    for axis in ("0", "1e-5"):
        found = parse_mechanism(text.replace("AXIS", axis))
        assert freedoms_of(found) == 1
        crank = found.joints["b"].parent_pose.position - found.joints["a"].child_pose.position
        assert np.linalg.norm(crank[:2]) == pytest.approx(0.0003, rel=1e-3)


def test_welds_that_agree_within_the_digits():
    text = """
mechanism: welds
parts:
  a: {mass: 1, points: {p: {at: [0.5, 0, 0], rotate: {axis: [0, 1, 0], angle: 1.5708}}}}
  b: {mass: 1, points: {p: [0, 0, 0], q: [0, 0, 0.2]}}
joints:
  hinge: {type: revolute, between: [ground, a], axis: [0, 1, 0]}
  one: {type: fixed, between: [a.p, b.p]}
  two: {type: fixed, between: [a.q, b.q]}
"""
    turned = rot.about(np.array([0.0, 1.0, 0.0]), np.pi / 2)
    place = (np.array([0.5, 0.0, 0.0]) + turned @ np.array([0.0, 0.0, 0.2])).round(6).tolist()
    point = f"p: {{at: [0.5, 0, 0], rotate: {{axis: [0, 1, 0], angle: 1.5708}}}}, q: {{at: {place}, rotate: {{axis: [0, 1, 0], angle: 90 deg}}}}"
    text = text.replace("p: {at: [0.5, 0, 0], rotate: {axis: [0, 1, 0], angle: 1.5708}}", point)
    found = parse_mechanism(text)
    assert freedoms_of(found) == 1
    assert found.moved.keys() <= {"one", "two"}


def test_the_same_in_sdf_and_urdf(tmp_path):
    linkage = FAMILIES["spherical four-bar"](np.random.default_rng(1))
    (tmp_path / "linkage.sdf").write_text(sdf_text(linkage, np.random.default_rng(51), 6))
    assert freedoms_of(load_mechanism(tmp_path / "linkage.sdf")) == linkage.freedoms
    urdf, loops = urdf_and_loops(linkage, np.random.default_rng(51), 6)
    (tmp_path / "linkage.urdf").write_text(urdf)
    (tmp_path / "linkage.yaml").write_text(loops)
    assert freedoms_of(load_mechanism(tmp_path / "linkage.yaml")) == linkage.freedoms
