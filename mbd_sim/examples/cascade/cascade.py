"""`ros2 run mbd_sim example_cascade`: turns an arm on a DC motor from target to target, by cascade control."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence

import numpy as np
from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState

from mbd_sim.base.geometry.pose import Array
from mbd_sim.examples.control_node import ControlNode, mechanism_parameter, run
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


class CascadeNode(ControlNode):
    """The parameter `targets` (rad), which are taken in turn for `period` s each, may be changed during the run."""

    PARAMETERS = (
        mechanism_parameter("motor_drive"),
        ParameterSpec("targets", [2.5, -1.0, 1.2, 0.0], "positions of the first joint in rad, in turn", live=True),
        ParameterSpec("period", 1.5, "time for each target in s"),
        ParameterSpec("gain", 12.0, "of the position loop in 1/s"),
    )

    def __init__(self) -> None:
        super().__init__("cascade")
        self.add_on_set_parameters_callback(self._check_targets)
        self.loop = PositionLoop(float(self.get_parameter("gain").value))
        self._period = float(self.get_parameter("period").value)

    def target(self, time: float) -> float:
        """The present target in rad."""
        targets = self.get_parameter("targets").value
        return float(targets[int(time / self._period) % len(targets)])

    def command(self, time: float, q: Array, u: Array) -> JointState:
        """The velocity of the first joint toward its present target."""
        velocity = self.loop.velocity(float(q[0]), self.target(time))
        return JointState(name=self.names[:1], velocity=[velocity])

    def _check_targets(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        for parameter in parameters:
            if parameter.name == "targets" and not (len(parameter.value) and np.all(np.isfinite(parameter.value))):
                return SetParametersResult(successful=False, reason="give at least one position, each finite")
        return SetParametersResult(successful=True)


def main() -> int:
    """Run the node."""
    return run("example_cascade", CascadeNode, example="targets:=[1.0,-1.0]", topics=TOPICS)


if __name__ == "__main__":
    sys.exit(main())
