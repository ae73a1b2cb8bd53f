"""`ros2 run mbd_sim example_arm_trajectory`: sends a trajectory to an arm whose joints have servos."""

from __future__ import annotations

import sys

import numpy as np
from builtin_interfaces.msg import Duration
from rclpy.node import Node
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from mbd_sim.examples.control_node import NEWEST, declare, run
from mbd_sim.ros.node.parameters import ParameterSpec

JOINTS = ("base", "shoulder", "elbow", "wrist_roll", "wrist_bend", "flange")
HOME = (0.0, 0.35, -0.52, 0.0, 0.7, 0.0)
# Pick, lift and place, in rad; the arm stops at each of them.
POSES = (
    (0.6, 0.75, 0.15, 0.0, 0.65, 0.3),
    (0.6, 0.3, -0.3, 0.0, 1.0, 0.3),
    (-0.9, 0.3, -0.3, 0.5, 1.0, -0.6),
    (-0.9, 0.8, 0.1, 0.5, 0.65, -0.6),
    HOME,
)
TOPICS = (
    ("joint_trajectory", "trajectory_msgs/msg/JointTrajectory, published: the motion through all poses"),
    ("joint_states", "sensor_msgs/msg/JointState, subscribed: the time, and where the arm ends"),
)


def trajectory(duration: float) -> JointTrajectory:
    """The motion through all poses, from rest to rest and without jumps of the acceleration.

    :param duration: from one pose to the next in s.
    """
    message = JointTrajectory(joint_names=list(JOINTS))
    rest = [0.0] * len(JOINTS)
    for number, pose in enumerate(POSES, start=1):
        nanoseconds = round(1e9 * number * duration)
        message.points.append(
            JointTrajectoryPoint(
                positions=list(pose),
                velocities=rest,
                accelerations=rest,
                time_from_start=Duration(sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9),
            )
        )
    return message


class ArmTrajectoryNode(Node):  # type: ignore[misc]  # rclpy carries no types
    """Sends the trajectory when the simulator is there, and again each time the arm has come home."""

    PARAMETERS = (
        ParameterSpec("duration", 1.5, "simulated s from one pose to the next"),
        ParameterSpec("pause", 1.0, "simulated s at home before the next trajectory"),
    )

    def __init__(self) -> None:
        super().__init__("arm_trajectory")
        declare(self, self.PARAMETERS)
        self.duration, self.pause = (float(self.get_parameter(name).value) for name in ("duration", "pause"))
        if not self.duration > 0.0:
            raise ValueError(f"duration must be above zero, not {self.duration}.")
        self._publisher = self.create_publisher(JointTrajectory, "joint_trajectory", 10)
        self._end: float | None = None

    def start(self) -> None:
        """Subscribe to the joint states."""
        self.create_subscription(JointState, "joint_states", self._on_state, NEWEST)

    def stop(self) -> None:
        """Nothing to release; the arm follows the last trajectory to its end."""

    def _on_state(self, state: JointState) -> None:
        time = state.header.stamp.sec + 1e-9 * state.header.stamp.nanosec
        if self._end is not None and self._end - len(POSES) * self.duration <= time < self._end + self.pause:
            return
        if not self._publisher.get_subscription_count():
            return
        if self._end is not None:
            error = np.max(np.abs(np.array(state.position) - HOME))
            self.get_logger().info(f"home again, {1e3 * error:.2g} mrad from where it should be")
        self._publisher.publish(trajectory(self.duration))
        self._end = time + len(POSES) * self.duration


def main() -> int:
    """Run the node."""
    return run("example_arm_trajectory", ArmTrajectoryNode, example="duration:=1.0", topics=TOPICS)


if __name__ == "__main__":
    sys.exit(main())
