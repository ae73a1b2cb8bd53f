"""Drives that follow commands over topics: from another participant to the kernel, recorded and verified."""

from __future__ import annotations

import signal
from pathlib import Path

import pytest
from builtin_interfaces.msg import Duration
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from test.system.growing_recordings import recorded_states, verified
from test.system.nodes import running

CRANE = """
mechanism: crane
parts:
  trolley: {mass: 5}
  reel: {mass: 1, inertia: [0.1, 0.1, 0.1]}
  load: {shape: {type: rod, to: [0, 0, -0.5], mass: 1}}
joints:
  rail:
    type: prismatic
    between: [ground, trolley]
    axis: [1, 0, 0]
    drive: {command: position, bandwidth: 20, position: 0.1, velocity_limit: 2, upper: 1.5}
  shaft: {type: revolute, between: [trolley, reel], axis: [0, 1, 0], drive: {command: velocity, bandwidth: 30}}
  pin: {type: revolute, between: [trolley, load], axis: [0, -1, 0], damping: 0.2}
"""


def test_a_drive_follows_positions_velocities_and_trajectories_and_the_recording_verifies(tmp_path: Path) -> None:
    (tmp_path / "crane.yaml").write_text(CRANE, encoding="utf-8")
    options = {
        "mechanism": str(tmp_path / "crane.yaml"),
        "record": True,
        "record_dir": "logs",
        "real_time_factor": 4.0,
        "publish_rate": 25.0,
        "ros2_control": True,
        "actuator_timeout": 0.5,
    }
    with running(tmp_path, **options) as (process, listener):
        trajectories = listener.node.create_publisher(JointTrajectory, "joint_trajectory", 10)
        listener.ready_to_command()
        listener.until(trajectories.get_subscription_count, "the subscription")
        assert list(listener.states[-1].name) == ["pin", "rail", "shaft"]
        assert listener.states[-1].position[1] == pytest.approx(0.1, abs=1e-12)
        # As ros2_control's JointStateTopicSystem: all names, and only the arrays of the interfaces of each joint.
        listener.by_name.publish(
            JointState(name=["pin", "rail", "shaft"], position=[0.6], velocity=[0.0, 2.0], effort=[float("nan")])
        )
        listener.until(lambda: abs(listener.states[-1].position[1] - 0.6) < 1e-6, "the position")
        listener.until(lambda: abs(listener.states[-1].velocity[2]) < 1e-6, "the end of the velocity, by the watchdog")
        assert listener.states[-1].position[2] > 0.5 and listener.states[-1].position[1] == pytest.approx(0.6, abs=1e-5)
        points = [
            JointTrajectoryPoint(positions=[1.0], velocities=[0.4], time_from_start=Duration(sec=1)),
            JointTrajectoryPoint(positions=[0.2], velocities=[0.0], time_from_start=Duration(sec=2)),
        ]
        trajectories.publish(JointTrajectory(joint_names=["rail"], points=points))
        listener.until(lambda: abs(listener.states[-1].position[1] - 0.2) < 1e-6, "the last point")
        listener.by_name.publish(JointState(name=["rail"], position=[9.0]))
        listener.until(lambda: abs(listener.states[-1].position[1] - 1.5) < 1e-6, "the end of the range")
        listener.by_name.publish(JointState(name=["rail"], effort=[1.0]))
        listener.until(
            lambda: "the drive of 'rail' takes no effort. Command its position" in process.text, "the refusal"
        )
        listener.reset()
        listener.until(lambda: abs(listener.states[-1].position[1] - 0.1) < 1e-12, "the start position")
        assert process.end(signal.SIGINT) == 0
    assert '<joint name="rail">' in listener.descriptions[-1].partition("<ros2_control")[2]
    verification = verified(tmp_path / "logs")
    assert verification.commands["applied_commands"] > 100  # among them the samples of the trajectory
    rail = [(state.position[1], state.velocity[1]) for state in recorded_states(tmp_path / "logs").values()]
    beyond = next(number for number, (position, _) in enumerate(rail) if position > 1.2)  # on the way to the end
    last_point = max(number for number in range(beyond) if rail[number][0] < 0.25)
    assert max(position for position, _ in rail[:last_point]) > 0.95  # at the first point of the trajectory
    assert max(position for position, _ in rail) <= 1.5 + 1e-12
    assert max(abs(speed) for _, speed in rail) <= 2.0 + 1e-6
