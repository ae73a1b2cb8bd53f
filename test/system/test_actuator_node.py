"""Commands of actuators over topics: from another participant to the servo in the kernel, recorded and verified."""

from __future__ import annotations

import signal
from pathlib import Path

import pytest
from rclpy.qos import QoSDurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from mbd_sim.recordings.run.reader import open_recording
from test.system.growing_recordings import verified
from test.system.nodes import running

ARM = """
mechanism: servo_arm
gravity: [0, 0, 0]
parts:
  arm: {mass: 1, center: [0, 0, -0.3], inertia: [0.02, 0.03, 0.01], points: {end: [0, 0, -0.6]}}
  wheel: {mass: 0.5, inertia: [0.001, 0.002, 0.001]}
joints:
  shoulder: {type: revolute, between: [ground, arm], axis: [0, -1, 0], position: 0.2, damping: 0.1}
  hub: {type: revolute, between: [arm.end, wheel], axis: [0, -1, 0], damping: 0.05}
actuators:
  drive:
    type: dc_motor
    joint: shoulder
    torque_constant: 0.1
    resistance: 1
    gear_ratio: 20
    voltage_limit: 24
    delay: 2 ms
    servo: {controls: position, kp: 60, kd: 1, sample_rate: 500 Hz}
  spin: {type: effort, joint: hub}
"""


def test_servos_follow_commands_by_name_and_the_recording_verifies(tmp_path: Path) -> None:
    (tmp_path / "arm.yaml").write_text(ARM, encoding="utf-8")
    options = {"mechanism": str(tmp_path / "arm.yaml"), "record": True, "record_dir": "logs", "real_time_factor": 2.0}
    with running(tmp_path, **options) as (process, listener):
        applied: list[Float64MultiArray] = []
        latched = QoSProfile(depth=10, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
        listener.node.create_subscription(Float64MultiArray, "sim_node/applied_commands", applied.append, latched)
        listener.ready_to_command()
        assert listener.states[-1].position[0] == pytest.approx(0.2, abs=1e-12)  # held
        # As ros2_control's JointStateTopicSystem: all names, and only the arrays of the interfaces of each joint.
        listener.by_name.publish(JointState(name=["shoulder", "hub"], position=[1.0], velocity=[0.0], effort=[0.3]))
        listener.until(lambda: abs(listener.states[-1].position[0] - 1.0) < 1e-3, "the position")
        assert listener.states[-1].effort[1] == 0.3  # that of the actuator
        listener.until(lambda: applied, "the applied commands")
        assert list(applied[0].data) == [1.0, 0.0, 0.3]
        assert [d.label for d in applied[0].layout.dim] == ["drive.position", "drive.velocity", "spin.effort"]
        listener.by_name.publish(JointState(name=["hub"], position=[1.0]))  # refused
        listener.until(lambda: "joint_commands: message rejected" in process.text, "the rejection")
        assert "the actuator of 'hub' takes no position. Command its effort." in process.text
        count = len(applied)
        listener.reset()
        listener.until(lambda: abs(listener.states[-1].position[0] - 0.2) < 1e-9, "the start position")
        listener.until(lambda: len(applied) > count, "the commands at the start")
        assert list(applied[-1].data) == [0.2, 0.0, 0.0]
        listener.spin(0.3)
        assert listener.states[-1].position[0] == pytest.approx(0.2, abs=1e-9)
        assert process.end(signal.SIGINT) == 0
    (path,) = (tmp_path / "logs").glob("servo_arm_*.mcap")
    verification = verified(path)
    assert verification.commands["applied_commands"] == 1
    assert sum(m.topic.endswith("applied_commands") for m in open_recording(path).messages()) == 1


def test_a_node_that_starts_elsewhere_holds_that_position(tmp_path: Path) -> None:
    (tmp_path / "arm.yaml").write_text(ARM, encoding="utf-8")
    options = {"mechanism": str(tmp_path / "arm.yaml"), "start": "shoulder = 0.8"}
    with running(tmp_path, **options) as (_, listener):
        listener.until(lambda: len(listener.states) > 20, "states")
        assert listener.states[-1].position[0] == pytest.approx(0.8, abs=1e-9)
