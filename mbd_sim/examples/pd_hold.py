"""`ros2 run mbd_sim example_pd_hold`: a double pendulum is held in place, its weight carried."""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np
from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter

from mbd_sim.analysis.inverse_dynamics import InverseDynamics
from mbd_sim.examples.control_node import AT_START, ControlNode, run
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.records import Mechanism


class PdHold:
    """Spring and damper to a target, besides the efforts that carry the weight: e = g(q) + kp (target - q) - kd u."""

    def __init__(self, mechanism: Mechanism, stiffness: float = 40.0, damping: float = 6.0) -> None:
        self.kp, self.kd = stiffness, damping
        self._inverse = InverseDynamics(mechanism)
        self._still = np.zeros(len(mechanism.coordinate_names))

    def efforts(self, q: Array, u: Array, target: Array) -> Array:
        """The efforts (nv,), N·m."""
        return self._inverse(q, self._still, self._still) + self.kp * (target - q) - self.kd * u


class PdHoldNode(ControlNode):
    """The parameter `target` (rad for each joint) may be changed while it runs."""

    def __init__(self) -> None:
        super().__init__("pd_hold", "double_pendulum")
        self.declare_parameter("stiffness", 40.0, AT_START)
        self.declare_parameter("damping", 6.0, AT_START)
        self.add_on_set_parameters_callback(self._accept)
        self.declare_parameter("target", [2.0, 0.8])
        stiffness, damping = (float(self.get_parameter(name).value) for name in ("stiffness", "damping"))
        self.law = PdHold(self.mechanism, stiffness, damping)
        self.start()

    def control(self, time: float, q: Array, u: Array) -> Array:
        """To the target of this moment."""
        return self.law.efforts(q, u, np.array(self.get_parameter("target").value))

    def _accept(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        """Take a target that has a finite position for each joint, and no other."""
        for parameter in parameters:
            if parameter.name == "target" and not (
                len(parameter.value) == len(self.names) and np.all(np.isfinite(parameter.value))
            ):
                reason = f"write a finite position for each of {', '.join(self.names)}"
                return SetParametersResult(successful=False, reason=reason)
        return SetParametersResult(successful=True)


def main() -> int:
    """Run the node."""
    return run(PdHoldNode)


if __name__ == "__main__":
    sys.exit(main())
