"""`ros2 run mbd_sim example_cascade`: turns an arm on a DC motor from target to target, by cascade control."""

from __future__ import annotations

import math
import sys

from sensor_msgs.msg import JointState

from mbd_sim.base.geometry.pose import Array
from mbd_sim.examples.control_node import TargetNode, mechanism_parameter, run
from mbd_sim.ros.node.parameters import ParameterSpec

TOPICS = (
    ("joint_states", "sensor_msgs/msg/JointState, subscribed: the state; each message is answered with a velocity"),
    ("joint_commands", "sensor_msgs/msg/JointState, published: velocities by joint name, for the servo of the motor"),
)


class PositionLoop:
    """The outer loop: a velocity in proportion to the error of the position, from which the motor can still stop.

    Stopping within the distance e at the deceleration a is possible from √(2 a e).
    """

    def __init__(self, gain: float = 12.0, speed: float = 6.0, deceleration: float = 15.0) -> None:
        """`gain` in 1/s, the largest `speed` in rad/s, and a `deceleration` in rad/s² of which the motor is capable."""
        self.gain, self.speed, self.deceleration = gain, speed, deceleration

    def velocity(self, position: float, target: float) -> float:
        """The velocity to command, in rad/s."""
        error = target - position
        stopping = math.sqrt(2.0 * self.deceleration * abs(error))
        return math.copysign(min(self.gain * abs(error), stopping, self.speed), error)


class CascadeNode(TargetNode):
    """Commands velocities toward targets in rad."""

    PARAMETERS = (
        mechanism_parameter("motor_drive"),
        ParameterSpec("targets", [2.5, -1.0, 1.2, 0.0], "positions of the first joint in rad, in turn", live=True),
        ParameterSpec("period", 1.5, "time for each target in s"),
        ParameterSpec("gain", 12.0, "of the position loop in 1/s"),
    )

    def __init__(self) -> None:
        super().__init__("cascade")
        self.loop = PositionLoop(float(self.get_parameter("gain").value))

    def command(self, time: float, q: Array, u: Array) -> JointState:
        """The velocity of the first joint toward its present target."""
        velocity = self.loop.velocity(float(q[0]), self.target(int(time / self.period)))
        return JointState(name=self.names[:1], velocity=[velocity])


def main() -> int:
    """Run the node."""
    return run("example_cascade", CascadeNode, example="targets:=[1.0,-1.0]", topics=TOPICS)


if __name__ == "__main__":
    sys.exit(main())
