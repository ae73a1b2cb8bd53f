"""A trajectory from another process: the arm follows the polynomials through its points, and the recording verifies."""

import signal

import numpy as np
import pytest
from builtin_interfaces.msg import Duration, Time
from std_msgs.msg import Header
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from mbd_sim.examples.arm_trajectory.arm_trajectory import HOME, POSES
from mbd_sim.recordings.messages import cdr
from mbd_sim.recordings.run.reader import open_recording
from mbd_sim.recordings.run.verification import verify
from mbd_sim.ros.commands.trajectory_player import JointCurve, JointPoint
from test.examples.programs import beside

OPTIONS = {
    "mechanism": "six_axis_servo_arm", "record": True, "record_dir": "logs", "real_time_factor": 3.0,
    "publish_rate": 50.0, "trajectory_rate": 250.0,
}  # fmt: skip


def applied(path):
    """The commanded positions and velocities of all joints by the number of steps before them."""
    messages = [message for message in open_recording(path).messages() if message.topic.endswith("applied_commands")]
    return {message.sequence: cdr.multi_array(message.payload).values.reshape(-1, 3)[:, :2] for message in messages}


def is_home(state):
    return np.abs(np.array(state.position) - HOME).max() < 1e-4


def test_the_arm_follows_a_trajectory_from_another_process(tmp_path):
    with beside(tmp_path, OPTIONS, "arm_trajectory.arm_trajectory", "duration:=0.2", "pause:=600.0") as experiment:
        listener = experiment.listener
        publisher = listener.node.create_publisher(JointTrajectory, "joint_trajectory", 10)
        listener.until(lambda: is_home(listener.states[-1]), "the end of the motion")  # the start is not that exact
        listener.pause(True)
        start = listener.until_paused() // 10**9 + 1
        point = JointTrajectoryPoint(positions=[0.5], time_from_start=Duration(nanosec=200_000_000))
        header = Header(stamp=Time(sec=start))
        publisher.publish(JointTrajectory(header=header, joint_names=["base"], points=[point]))
        # Messages of a publisher arrive in order: when this one has been rejected, the trajectory has been accepted.
        publisher.publish(JointTrajectory(joint_names=["base", "elbo"], points=[JointTrajectoryPoint()]))
        listener.until(lambda: "joint_trajectory: message rejected" in experiment.node.text, "the rejection")
        listener.pause(False)
        listener.until(lambda: abs(listener.states[-1].position[0] - 0.5) < 1e-3, "the second motion")
        assert experiment.node.end(signal.SIGINT) == 0
    (path,) = (tmp_path / "logs").glob("*.mcap")
    (verification,) = verify(path)
    assert verification.is_intact and verification.agrees, verification.first
    commands = applied(path)
    points = zip(np.radians([0, 20, -30, 0, 40, 0]), *POSES, strict=True)
    passed = [JointCurve([JointPoint(0.2 * k, p, 0.0, 0.0) for k, p in enumerate(joint)]) for joint in points]
    ticks = [tick for tick in commands if tick < 1000 * start]
    assert len(ticks) > 245 and not any(tick % 4 for tick in ticks)  # 1 s at 250 Hz

    def error(begin):
        expected = [[curve.at(1e-3 * (tick - begin))[:2] for curve in passed] for tick in ticks]
        return np.abs(np.array([commands[tick] for tick in ticks]) - expected).max()

    # The command at the beginning repeats the one in effect, so it is not recorded.
    assert min(error(ticks[0] - lead) for lead in range(1, 5)) < 1e-12
    assert min(tick for tick in commands if tick not in ticks) == 1000 * start
    assert commands[1000 * start + 100][0] == pytest.approx([0.25, 2.5])
    assert commands[max(commands)][0].tolist() == [0.5, 0.0]
