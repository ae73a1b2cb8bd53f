"""The block for ros2_control in the URDF: its hardware, and the interfaces of each joint."""

import math
import xml.etree.ElementTree as ElementTree

from mbd_sim.files.load import load_mechanism, parse_mechanism
from mbd_sim.files.urdf.writer import ControlTopics, to_urdf
from test.ros.commands.test_joint_commands import MIXED

TOPICS = ControlTopics("/lab/joint_commands", "/lab/joint_states")


def block_of(mechanism):
    (block,) = ElementTree.fromstring(to_urdf(mechanism, TOPICS)).findall("ros2_control")
    return block


def interfaces(block, kind):
    return {joint.get("name"): [one.get("name") for one in joint.findall(kind)] for joint in block.findall("joint")}


def test_joints_have_the_interfaces_that_their_actuators_take():
    block = block_of(parse_mechanism(MIXED, "mixed.yaml"))
    assert (block.get("name"), block.get("type")) == ("mixed", "system")
    hardware = block.find("hardware")
    assert hardware.findtext("plugin") == "joint_state_topic_hardware_interface/JointStateTopicSystem"
    assert {parameter.get("name"): parameter.text for parameter in hardware.findall("param")} == {
        "joint_commands_topic": "/lab/joint_commands",
        "joint_states_topic": "/lab/joint_states",
        "trigger_joint_command_threshold": "-1",
    }
    assert interfaces(block, "command_interface") == {
        "hip": ["position", "velocity", "effort"], "knee": ["velocity"], "toe": ["effort"], "hub": [],
    }  # fmt: skip
    assert set(map(tuple, interfaces(block, "state_interface").values())) == {("position", "velocity", "effort")}


def test_joints_that_mimic_or_are_driven_or_have_three_coordinates_have_no_commands():
    press = load_mechanism("rack_and_pinion")
    robot = ElementTree.fromstring(to_urdf(press))
    assert robot.find("ros2_control") is None
    mimicking = [joint.get("name") for joint in robot.findall("joint") if joint.find("mimic") is not None]
    commands = interfaces(block_of(press), "command_interface")
    assert mimicking and all(not commands[name] for name in mimicking) and any(commands.values())
    driven = load_mechanism("moving_support_pendulum")
    commands = interfaces(block_of(driven), "command_interface")
    assert all(not commands[name] for name in driven.driven_names) and any(commands.values())
    assert interfaces(block_of(load_mechanism("spherical_top")), "command_interface") == {}


def test_drives_that_follow_commands_have_their_own_range_in_the_urdf():
    """A drive without it would be `continuous`: joint_trajectory_controller then takes the shorter way round."""
    follows = "bandwidth: 50, command:"
    joints = {
        "pan": f"type: revolute, between: [ground, a], axis: [0, 0, 1], drive: {{{follows} position, lower: -170 deg, velocity_limit: 3}}",
        "slide": f"type: prismatic, between: [ground, b], axis: [1, 0, 0], drive: {{{follows} position, velocity_limit: 2}}",
        "spin": f"type: revolute, between: [ground, c], axis: [0, 0, 1], drive: {{{follows} velocity}}",
    }
    text = "mechanism: drives\nparts: {a: {mass: 1}, b: {mass: 1}, c: {mass: 1}}\njoints:\n"
    text += "".join(f"  {name}: {{{record}}}\n" for name, record in joints.items())
    robot = ElementTree.fromstring(to_urdf(parse_mechanism(text, "drives.yaml")))
    written = {one.get("name"): one for one in robot.findall("joint")}
    assert {name: one.get("type") for name, one in written.items()} == {
        "pan": "revolute", "slide": "prismatic", "spin": "continuous",
    }  # fmt: skip
    limits = {name: one.find("limit").attrib for name, one in written.items() if one.find("limit") is not None}
    found = {name: {key: float(value) for key, value in limit.items()} for name, limit in limits.items()}
    assert found == {
        "pan": {"velocity": 3.0, "effort": 1e6, "lower": math.radians(-170), "upper": 1e6},
        "slide": {"velocity": 2.0, "effort": 1e6, "lower": -1e6, "upper": 1e6},
    }
