"""`ros2 run mbd_sim example_excite`: shakes a joint through many frequencies, for `example_identify`."""

from __future__ import annotations

import math
import sys

import numpy as np

from mbd_sim.examples.control_node import AT_START, ControlNode, end, run
from mbd_sim.geometry.pose import Array

SINES = 8


def multisine(time: float, amplitude: float, lowest: float = 0.2, highest: float = 4.0) -> float:
    """A sum of sines from `lowest` to `highest` Hz with Schroeder's phases (1970), which keep its peaks low."""
    k = np.arange(SINES)
    frequencies = lowest * (highest / lowest) ** (k / (SINES - 1))
    return float(
        amplitude * math.sqrt(2.0 / SINES) * np.sum(np.sin(2 * np.pi * frequencies * time + np.pi * k**2 / SINES))
    )


class ExciteNode(ControlNode):
    """Ends by itself after `duration` seconds of simulated time."""

    def __init__(self) -> None:
        super().__init__("excite", "motor_arm")
        for name, value in (("joint", self.names[0]), ("amplitude", 0.6), ("duration", 10.0)):
            self.declare_parameter(name, value, AT_START)
        joint = self.get_parameter("joint").value
        if joint not in self.names:
            raise ValueError(f"there is no joint '{joint}'. Choose one of {', '.join(self.names)}.")
        self.where = self.names.index(joint)
        self.amplitude, self.duration = (float(self.get_parameter(n).value) for n in ("amplitude", "duration"))
        self._began: float | None = None
        self.start()

    def control(self, time: float, q: Array, u: Array) -> Array:
        """The torque of this moment at the joint."""
        self._began = time if self._began is None else self._began
        efforts = np.zeros(len(self.names))
        if time - self._began > self.duration:
            self.get_logger().info("done: end sim_node, and give its recording to example_identify", once=True)
            end()
        else:
            efforts[self.where] = multisine(time - self._began, self.amplitude)
        return efforts


def main() -> int:
    """Run the node."""
    return run(ExciteNode)


if __name__ == "__main__":
    sys.exit(main())
