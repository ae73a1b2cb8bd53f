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

    def __init__(self, listener: Listener, urdf: str) -> None:
        block = ElementTree.fromstring(urdf).find("ros2_control")
        assert block is not None
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
