"""`ros2 run mbd_sim example_hydraulic_lift`: raises a hydraulic scissor lift to one level after the other."""

from __future__ import annotations

import math
import sys

from std_msgs.msg import Float64MultiArray

from mbd_sim.base.geometry.pose import Array
from mbd_sim.examples.control_node import TargetNode, mechanism_parameter, run
from mbd_sim.ros.node.parameters import ParameterSpec

TOPICS = (
    ("joint_states", "sensor_msgs/msg/JointState, subscribed: the state; each message is answered with an opening"),
    ("sim_node/actuator_commands", "std_msgs/msg/Float64MultiArray, published: the opening of the valve, -1 to 1"),
)
LOWEST, HIGHEST = 0.3, 0.85  # m, of the platform


class LevelControl:
    """The valve follows a level that moves to its target at a limited speed: feedforward, and a PI controller.

    The integral replaces the oil that leaks past the piston. It stands still where the valve is fully open.
    """

    def __init__(self, proportional: float = 4.0, integral: float = 2.0, speed: float = 0.15) -> None:
        """Gains in 1/s and 1/s², and the largest `speed` of the level in m/s."""
        self.proportional, self.integral, self.speed = proportional, integral, speed
        self.full_speed = 0.45  # m/s of the platform, about that with the valve fully open
        self.level = self._sum = self._time = math.nan

    def opening(self, time: float, height: float, target: float) -> float:
        """The opening of the valve at a time in s, for the height of the platform and the target in m."""
        period = time - self._time
        self._time = time
        if not 0.0 < period < 1.0:  # the first state, or one after a reset
            self.level, self._sum, period = height, 0.0, 0.0
        moved = max(-self.speed * period, min(self.speed * period, target - self.level))
        self.level += moved
        error = self.level - height
        wanted = (moved / period if period else 0.0) + self.proportional * error + self._sum
        if abs(wanted) < self.full_speed:
            self._sum += self.integral * error * period
        return max(-1.0, min(1.0, wanted / self.full_speed))


class LiftNode(TargetNode):
    """Opens the valve toward targets in m."""

    LOWEST, HIGHEST = LOWEST, HIGHEST

    PARAMETERS = (
        mechanism_parameter("hydraulic_scissor_lift"),
        ParameterSpec("targets", [0.7, 0.45, 0.8], f"heights of the platform in m, {LOWEST} to {HIGHEST}", live=True),
        ParameterSpec("period", 5.0, "time for each target in s"),
    )

    def __init__(self) -> None:
        super().__init__("hydraulic_lift")
        self.law, self._bar = LevelControl(), self.mechanism.parameters["l"]
        self._hinge = self.names.index("hinge")
        self._valve = self.create_publisher(Float64MultiArray, "sim_node/actuator_commands", 10)

    def publish_answer(self, time: float, q: Array, u: Array) -> None:
        """Publish the opening that moves the platform toward its present target."""
        height = self._bar * math.sin(q[self._hinge])
        opening = self.law.opening(time, height, self.target(int(time / self.period)))
        self._valve.publish(Float64MultiArray(data=[opening]))


def main() -> int:
    """Run the node."""
    return run("example_hydraulic_lift", LiftNode, example="targets:=[0.6,0.4]", topics=TOPICS)


if __name__ == "__main__":
    sys.exit(main())
