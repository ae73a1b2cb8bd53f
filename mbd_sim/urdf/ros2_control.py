"""The `<ros2_control>` block of a URDF, for JointStateTopicSystem of joint_state_topic_hardware_interface.

That system exchanges commands and states of joints with a node over two topics of sensor_msgs/JointState. It names all
joints of the block in each message, and each array has an entry for each joint with a command interface of that name.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from mbd_sim.mechanism.actuators import CoordinatePort
from mbd_sim.mechanism.drives import commanded_drives
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.urdf.value_reader import unique_name

PLUGIN = "joint_state_topic_hardware_interface/JointStateTopicSystem"
INTERFACES = ("position", "velocity", "effort")
ALWAYS = "-1"  # the threshold with which commands are sent in each cycle, so that they do not expire


@dataclass(frozen=True, slots=True)
class ControlTopics:
    """The absolute names of the topics of a node."""

    commands: str
    states: str


def ros2_control_block(
    mechanism: Mechanism, robot: ElementTree.Element, topics: ControlTopics
) -> ElementTree.Element | None:
    """The block for the coordinates of a mechanism that are joints of its URDF with one coordinate each.

    The URDF may have blocks already: joints that one of these has are left out. None if no joint is left.

    A joint with an actuator or a drive that follows commands has the command interfaces that this takes, other joints
    have `effort`; joints that follow the time or another joint have none. All have the states position, velocity and
    effort.

    :param robot: the URDF of the mechanism.
    """
    blocks = robot.findall("ros2_control")
    name = unique_name(mechanism.name, [block.get("name", "") for block in blocks])
    block = ElementTree.Element("ros2_control", name=name, type="system")
    hardware = ElementTree.SubElement(block, "hardware")
    ElementTree.SubElement(hardware, "plugin").text = PLUGIN
    parameters = {
        "joint_commands_topic": topics.commands,
        "joint_states_topic": topics.states,
        "trigger_joint_command_threshold": ALWAYS,
    }
    for name, value in parameters.items():
        ElementTree.SubElement(hardware, "param", name=name).text = value
    taken = _commands(mechanism)
    in_urdf = {joint.attrib["name"]: joint for joint in robot.findall("joint") if joint.find("axis") is not None}
    named = {joint.get("name", "") for other in blocks for joint in other.iter("joint")}
    for name in (*mechanism.coordinate_names, *mechanism.driven_names):
        if name not in in_urdf or name in named:
            continue
        joint = ElementTree.SubElement(block, "joint", name=name)
        follows = in_urdf[name].find("mimic") is not None or (name in mechanism.driven_names and name not in taken)
        for interface in () if follows else taken.get(name, ("effort",)):
            ElementTree.SubElement(joint, "command_interface", name=interface)
        for interface in INTERFACES:
            ElementTree.SubElement(joint, "state_interface", name=interface)
    return None if named and block.find("joint") is None else block


def _commands(mechanism: Mechanism) -> Mapping[str, Sequence[str]]:
    """The command interfaces of the joints with actuators, and of those with drives that follow commands."""
    found: dict[str, list[str]] = {name: list(drive.channels) for name, drive in commanded_drives(mechanism).items()}
    for actuator in mechanism.actuators:
        if isinstance(actuator.port, CoordinatePort):
            taken = found.setdefault(actuator.port.coordinate, [])
            taken += [channel for channel in actuator.channels if channel in INTERFACES and channel not in taken]
    return {name: [interface for interface in INTERFACES if interface in taken] for name, taken in found.items()}
