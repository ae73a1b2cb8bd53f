"""`ros2 run mbd_sim example_excite`: excites a joint at many frequencies, for `example_identify`."""

from __future__ import annotations

import math
import sys

import numpy as np

from mbd_sim.base.errors import InputError, nearest
from mbd_sim.base.geometry.pose import Array
from mbd_sim.examples.control_node import ControlNode, end_program, mechanism_parameter, run
from mbd_sim.ros.node.parameters import ParameterSpec

SINES = 8


def multisine(time: float, amplitude: float, lowest: float = 0.2, highest: float = 4.0) -> float:
    """A sum of sines from `lowest` to `highest` (Hz) with Schroeder's phases (1970), which keep its peaks low."""
    k = np.arange(SINES)
    frequencies = lowest * (highest / lowest) ** (k / (SINES - 1))
    return float(
        amplitude * math.sqrt(2.0 / SINES) * np.sum(np.sin(2 * np.pi * frequencies * time + np.pi * k**2 / SINES))
    )


class ExciteNode(ControlNode):
    """Ends after `duration` seconds of simulated time."""

    PARAMETERS = (
        mechanism_parameter("motor_arm"),
        ParameterSpec("joint", "", "the joint to excite; empty: the first one"),
        ParameterSpec("amplitude", 0.6, "amplitude of the multisine in N or N·m"),
        ParameterSpec("duration", 10.0, "simulated s after which the program ends"),
    )

    def __init__(self) -> None:
        super().__init__("excite")
        joint = self.get_parameter("joint").value or self.names[0]
        if joint not in self.names:
            raise InputError(f"there is no joint '{joint}'", nearest(joint, self.names))
        self.joint_index = self.names.index(joint)
        self.amplitude, self.duration = (float(self.get_parameter(n).value) for n in ("amplitude", "duration"))
        self._start_time: float | None = None

    def control(self, time: float, q: Array, u: Array) -> Array:
        """The torque of the multisine at the joint."""
        self._start_time = time if self._start_time is None else self._start_time
        efforts = np.zeros(len(self.names))
        if time - self._start_time > self.duration:
            self.get_logger().info("done: stop sim_node, and pass its recording to example_identify", once=True)
            end_program()
        else:
            efforts[self.joint_index] = multisine(time - self._start_time, self.amplitude)
        return efforts


def main() -> int:
    """Run the node."""
    return run("example_excite", ExciteNode, example="duration:=10.0")


if __name__ == "__main__":
    sys.exit(main())
