"""`ros2 run mbd_sim example_pd_hold`: holds a double pendulum in place, with gravity compensation."""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np
from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter

from mbd_sim.analysis.mechanics.inverse_dynamics import InverseDynamics
from mbd_sim.base.geometry.pose import Array
from mbd_sim.examples.control_node import ControlNode, mechanism_parameter, run
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.ros.node.parameters import ParameterSpec


class PdHold:
    """PD control with gravity compensation: e = g(q) + kp (target - q) - kd u."""

    def __init__(self, mechanism: Mechanism, stiffness: float = 40.0, damping: float = 6.0) -> None:
        """`stiffness` kp in N·m/rad, `damping` kd in N·m·s/rad."""
        self.kp, self.kd = stiffness, damping
        self._inverse_dynamics = InverseDynamics(mechanism)
        self._zeros = np.zeros(len(mechanism.coordinate_names))

    def efforts(self, q: Array, u: Array, target: Array) -> Array:
        """The efforts (nv,) in N·m."""
        gravity = self._inverse_dynamics(q, self._zeros, self._zeros)
        return gravity + self.kp * (target - q) - self.kd * u


class PdHoldNode(ControlNode):
    """The parameter `target` (rad, one for each joint) may be changed during the run."""

    PARAMETERS = (
        mechanism_parameter("double_pendulum"),
        ParameterSpec("stiffness", 40.0, "kp in N·m/rad"),
        ParameterSpec("damping", 6.0, "kd in N·m·s/rad"),
        ParameterSpec("target", [2.0, 0.8], "the position to hold in rad, one for each joint", live=True),
    )

    def __init__(self) -> None:
        super().__init__("pd_hold")
        checked = self._check_target([self.get_parameter("target")])
        if not checked.successful:
            raise ValueError(f"target: {checked.reason}")
        self.add_on_set_parameters_callback(self._check_target)
        stiffness, damping = (float(self.get_parameter(name).value) for name in ("stiffness", "damping"))
        self.law = PdHold(self.mechanism, stiffness, damping)

    def control(self, time: float, q: Array, u: Array) -> Array:
        """The efforts toward the present target."""
        return self.law.efforts(q, u, np.array(self.get_parameter("target").value))

    def _check_target(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        """Refuse a target that has not one finite position for each joint."""
        for parameter in parameters:
            if parameter.name == "target" and not (
                len(parameter.value) == len(self.names) and np.all(np.isfinite(parameter.value))
            ):
                reason = f"give one finite position for each of {', '.join(self.names)}"
                return SetParametersResult(successful=False, reason=reason)
        return SetParametersResult(successful=True)


def main() -> int:
    """Run the node."""
    return run("example_pd_hold", PdHoldNode, example="target:=[1.0,0.5]")


if __name__ == "__main__":
    sys.exit(main())
