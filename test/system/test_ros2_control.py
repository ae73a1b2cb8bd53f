"""What ros2_control's JointStateTopicSystem sends and reads, according to its source, against a real node."""

from __future__ import annotations

import math
import signal
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
from sensor_msgs.msg import JointState

from test.system.growing_recordings import verified
from test.system.nodes import Listener, running
from test.system.test_actuator_node import ARM


class TopicSystem:
    """`write` of JointStateTopicSystem: the names of all joints, and an array for each kind of interface.

    Interfaces that no controller has claimed are NaN, and an array has an entry only for each joint that has it.
    """

    def __init__(self, listener: Listener, urdf: str, number: int = 0) -> None:
        block = ElementTree.fromstring(urdf).findall("ros2_control")[number]
        parameters = {one.get("name"): one.text for one in block.findall("hardware/param")}
        assert parameters["trigger_joint_command_threshold"] == "-1"  # each cycle
        self.publisher = listener.node.create_publisher(JointState, parameters["joint_commands_topic"], 1)
        self.states = parameters["joint_states_topic"]
        self.interfaces = [
            (str(joint.get("name")), str(one.get("name")))
            for joint in block.findall("joint")
            for one in joint.findall("command_interface")
        ]
        self.joints = [str(joint.get("name")) for joint in block.findall("joint")]
        self.commands = dict.fromkeys(self.interfaces, math.nan)
        self.timer = listener.node.create_timer(0.02, self.write)

    def write(self) -> None:
        message = JointState(name=self.joints)
        for joint, interface in self.interfaces:
            getattr(message, interface).append(self.commands[joint, interface])
        self.publisher.publish(message)


def test_the_block_and_the_messages_of_ros2_control_fit(tmp_path: Path) -> None:
    (tmp_path / "arm.yaml").write_text(ARM, encoding="utf-8")
    options = {
        "mechanism": str(tmp_path / "arm.yaml"), "ros2_control": True, "actuator_timeout": 1.0, "record": True,
        "record_dir": "logs",
    }  # fmt: skip
    with running(tmp_path, ["joint_commands:=/plant/commands"], **options) as (process, listener):
        listener.until(lambda: listener.descriptions, "the URDF")
        system = TopicSystem(listener, listener.descriptions[-1])
        assert (system.publisher.topic_name, system.states) == ("/plant/commands", "/joint_states")
        assert system.interfaces == [("shoulder", "position"), ("shoulder", "velocity"), ("hub", "effort")]
        listener.until(system.publisher.get_subscription_count, "matching")
        listener.spin(0.2)  # no controller is active
        assert listener.states[-1].position[0] == pytest.approx(0.2, abs=1e-9)
        system.commands["shoulder", "position"] = 1.0  # a trajectory controller
        system.commands["hub", "effort"] = 0.02  # an effort controller
        listener.until(lambda: abs(listener.states[-1].position[0] - 1.0) < 1e-3, "the position")
        listener.until(lambda: listener.states[-1].effort[1] == 0.02, "the effort")
        assert "rejected" not in process.text
        system.timer.cancel()  # the controller manager is gone
        listener.until(lambda: listener.states[-1].effort[1] == 0.0, "the watchdog")
        listener.until(lambda: "no more commands for spin: only positions are held" in process.text, "the warning")
        assert listener.states[-1].position[0] == pytest.approx(1.0, abs=1e-3)
        assert process.end(signal.SIGINT) == 0
    verified(tmp_path / "logs")


SEGMENT = """<link name="{0}"><inertial><origin xyz="0.2 0 0"/><mass value="1"/>
<inertia ixx="0.01" iyy="0.02" izz="0.02"/></inertial></link><joint name="{1}" type="revolute"><parent link="{2}"/>
<child link="{0}"/><origin xyz="0.4 0 0"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="20" velocity="4"/></joint>"""
SYSTEM = """<ros2_control name="{0}" type="system"><hardware><plugin>mock_components/GenericSystem</plugin></hardware>
{1}</ros2_control>"""
TWO_SYSTEMS = (
    '<robot name="two" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:arg name="start" default="0"/><link name="base"/>'
    + SEGMENT.format("upper", "shoulder", "base")
    + SEGMENT.format("lower", "elbow", "upper")
    + SYSTEM.format(
        "arm",
        '<joint name="shoulder"><command_interface name="position"><param name="max">1</param></command_interface>'
        '<state_interface name="position"><param name="initial_value">$(arg start)</param></state_interface></joint>'
        '<sensor name="wrist"><state_interface name="torque.y"/><param name="frame_id">lower</param></sensor>',
    )
    + SYSTEM.format("forearm", '<joint name="elbow"><command_interface name="effort"/></joint>')
    + "</robot>"
)


def test_the_systems_of_a_xacro_file_act_and_are_commanded_each_by_its_own_hardware(tmp_path: Path) -> None:
    """A wrong name, order or interface of a published block; blocks of which the node takes no commands."""
    pytest.importorskip("xacro")
    path = tmp_path / "two.urdf.xacro"
    path.write_text(TWO_SYSTEMS, encoding="utf-8")
    options = {
        "mechanism": f"{path} start:=-0.5", "ros2_control": True, "control": "position", "record": True,
        "record_dir": "logs",
    }  # fmt: skip
    with running(tmp_path, **options) as (process, listener):
        listener.until(lambda: listener.descriptions, "the URDF")
        arm, forearm = (TopicSystem(listener, listener.descriptions[-1], number) for number in (0, 1))
        assert arm.interfaces == [("shoulder", "position"), ("shoulder", "velocity")]
        assert forearm.interfaces == [("elbow", "effort")]
        listener.until(lambda: arm.publisher.get_subscription_count() and listener.states, "matching")
        names = list(listener.states[-1].name)
        shoulder, elbow = names.index("shoulder"), names.index("elbow")
        assert listener.states[0].position[shoulder] == pytest.approx(-0.5, abs=1e-12)
        arm.commands["shoulder", "position"] = 3.0
        forearm.commands["elbow", "effort"] = 2.5
        listener.until(lambda: abs(listener.states[-1].position[shoulder] - 1.0) < 1e-6, "the end of the range")
        listener.until(lambda: listener.states[-1].effort[elbow] == 2.5, "the effort")
        assert "rejected" not in process.text
        path.unlink()
        assert process.end(signal.SIGINT) == 0
    verified(tmp_path / "logs")
