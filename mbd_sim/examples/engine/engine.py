"""`ros2 run mbd_sim example_engine`: starts a small engine, and brakes it to one speed after the other."""

from __future__ import annotations

import math
import sys

import numpy as np
from sensor_msgs.msg import JointState

from mbd_sim.base.geometry.pose import Array
from mbd_sim.examples.control_node import TargetNode, mechanism_parameter, run
from mbd_sim.ros.node.parameters import ParameterSpec

TOPICS = (
    ("joint_states", "sensor_msgs/msg/JointState, subscribed: the state; each message is answered with a torque"),
    ("joint_commands", "sensor_msgs/msg/JointState, published: the torque of the machine on the crankshaft"),
)
STARTED, STALLED = 150.0, 30.0  # rad/s


class Dynamometer:
    """The machine on the crankshaft: it turns the engine until it runs, and then brakes it at the wanted mean speed.

    A PI controller on the filtered speed gives the torque of the brake; it hardly sees how the speed varies in a cycle.
    """

    def __init__(self, proportional: float = 6e-4, integral: float = 1e-3, filter_time: float = 0.1) -> None:
        """Gains in N·m·s and N·m, and the time constant of the filter in s."""
        self.proportional, self.integral, self.filter_time = proportional, integral, filter_time
        self.starting_torque, self.limit = 0.3, 0.4  # N·m
        self.runs, self.mean, self._sum, self._time = False, 0.0, 0.0, math.nan

    def torque(self, time: float, speed: float, target: float) -> float:
        """The torque on the crankshaft in N·m at a time in s, for its speed and the target in rad/s."""
        period = time - self._time
        self._time = time
        if not 0.0 < period < 1.0:  # the first state, or one after a reset
            self.runs, period = False, 0.0
        if (self.mean < STALLED and self.runs) or (not self.runs and speed < STARTED):
            self.runs, self.mean, self._sum = False, speed, 0.0
            return self.starting_torque
        self.runs = True
        self.mean += (speed - self.mean) * min(1.0, period / self.filter_time)
        wanted = self.proportional * (self.mean - target) + self._sum
        if 0.0 < wanted < self.limit:
            self._sum += self.integral * (self.mean - target) * period
        return -max(0.0, min(self.limit, wanted))


class EngineNode(TargetNode):
    """Brakes to targets in rad/s."""

    LOWEST = 100.0

    PARAMETERS = (
        mechanism_parameter("engine"),
        ParameterSpec("targets", [250.0, 350.0, 200.0], "mean speeds in rad/s, above 100, in turn", live=True),
        ParameterSpec("period", 6.0, "time for each target in s"),
    )

    def __init__(self) -> None:
        super().__init__("engine")
        self.law, self._crank = Dynamometer(), self.names.index("crank")
        self._speeds: list[float] = []  # of the last second
        self._number = 0

    def command(self, time: float, q: Array, u: Array) -> JointState:
        """The torque on the crankshaft that leads to its present target; the last second of each is reported."""
        number = int(time / self.period)
        torque = self.law.torque(time, float(u[self._crank]), self.target(self._number))
        if number != self._number:
            if number > self._number and self._speeds:
                self._report(-torque)
            self._number = number
            self._speeds.clear()
        if time >= (number + 1) * self.period - 1.0:
            self._speeds.append(float(u[self._crank]))
        return JointState(name=[self.names[self._crank]], effort=[torque])

    def _report(self, brake: float) -> None:
        """Log the mean speed, its coefficient of fluctuation, and the power of the brake."""
        mean, spread = float(np.mean(self._speeds)), max(self._speeds) - min(self._speeds)
        self.get_logger().info(
            f"runs at {mean:.1f} rad/s, varies by {100.0 * spread / mean:.1f} %, brake {brake:.3f} N·m, "
            f"{brake * mean:.1f} W"
        )


def main() -> int:
    """Run the node."""
    return run("example_engine", EngineNode, example="targets:=[300.0,200.0]", topics=TOPICS)


if __name__ == "__main__":
    sys.exit(main())
