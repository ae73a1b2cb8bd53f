"""URDF out: its tree of frames places every part where the engine places it."""

import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.mechanism.rotation import about, from_rpy
from mbd_sim.mechanism.urdf import to_urdf

TURNED = """
mechanism: turned
parts:
  base:
    mass: 2
    shape: {type: block, size: [0.4, 0.3, 0.2], color: "#aa3300"}
    points: {top: {at: [0.1, 0, 0.2], rotate: {rpy: [0.3, -0.2, 0.5]}}}
  arm:
    mass: 1
    shape: {type: cylinder, radius: 0.05, length: 0.6}
    points: {end: {at: [0, 0.1, -0.3], rotate: {axis: [1, 2, 3], angle: 0.7}}}
  slide: {mass: 1, shape: {type: sphere, radius: 0.1}}
joints:
  swing: {type: revolute, between: [arm.end, base.top], axis: [1, 2, -1], position: 0.4}
  foot: {type: fixed, between: [ground, base]}
  rail:
    type: prismatic
    between: [arm, slide]
    axis: [0, 3, 4]
    position: 0.2
    limits: {lower: -1, upper: 1}
    effort_limit: 7
"""


def vector(element, name):
    return np.array([float(word) for word in element.get(name).split()])


def frames(urdf, positions):
    """Link frames by walking the URDF, as a URDF consumer does."""
    found = {"ground": (np.zeros(3), np.eye(3))}
    for joint in ElementTree.fromstring(urdf).findall("joint"):
        at, turned = found[joint.find("parent").get("link")]
        origin = joint.find("origin")
        at, turned = at + turned @ vector(origin, "xyz"), turned @ from_rpy(*vector(origin, "rpy"))
        if joint.get("type") in ("revolute", "continuous"):
            turned = turned @ about(vector(joint.find("axis"), "xyz"), positions[joint.get("name")])
        if joint.get("type") == "prismatic":
            at = at + turned @ vector(joint.find("axis"), "xyz") * positions[joint.get("name")]
        found[joint.find("child").get("link")] = (at, turned)
    return found


@pytest.mark.parametrize("source", ["double_rod", TURNED], ids=["double_rod", "turned"])
def test_the_frames_of_the_urdf_are_those_of_the_engine(source):
    simulation = Simulation.from_text(source) if "\n" in source else Simulation.from_file(source)
    found = frames(to_urdf(simulation.mechanism), dict(zip(simulation.coordinate_names, simulation.q, strict=True)))
    for name, pose in simulation.poses().items():
        assert found[name][0] == pytest.approx(pose.position, abs=1e-14)
        assert found[name][1] == pytest.approx(pose.rotation, abs=1e-14)


def test_masses_limits_and_colours_are_there():
    robot = ElementTree.fromstring(to_urdf(Simulation.from_text(TURNED).mechanism))
    assert [float(mass.get("value")) for mass in robot.iter("mass")] == [2.0, 1.0, 1.0]
    rail = robot.find("joint[@name='rail']/limit")
    assert [float(rail.get(key)) for key in ("lower", "upper", "effort")] == [-1.0, 1.0, 7.0]
    assert robot.find("link[@name='base']/visual/material/color").get("rgba").startswith("0.6666")


def test_a_free_joint_floats():
    robot = ElementTree.fromstring(to_urdf(Simulation.from_file("tumbling").mechanism))
    assert [joint.get("type") for joint in robot.iter("joint")] == ["floating"]
