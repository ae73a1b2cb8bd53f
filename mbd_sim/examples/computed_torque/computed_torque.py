"""`ros2 run mbd_sim example_computed_torque`: an arm follows a motion by inverse dynamics."""

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np
from std_msgs.msg import Float64MultiArray

from mbd_sim.analysis.mechanics.inverse_dynamics import InverseDynamics
from mbd_sim.base.geometry.pose import Array
from mbd_sim.examples.control_node import CONTROL_TOPICS, ControlNode, mechanism_parameter, run
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.ros.node.parameters import ParameterSpec

TOPICS = (
    *CONTROL_TOPICS,
    ("~/tracking_error", "std_msgs/msg/Float64MultiArray, published: the error of each joint in rad"),
)


@dataclass(frozen=True, slots=True)
class Reference:
    """The reference motion at one time: coordinates in rad, speeds and accelerations, (nv,) each."""

    q: Array
    u: Array
    u_rates: Array


def sway(home: Array, amplitude: float, frequency: float, time: float) -> Reference:
    """All joints oscillate from rest at `home` (rad), each at a higher frequency (Hz) than the one before."""
    w = 2.0 * np.pi * frequency * (1.0 + 0.15 * np.arange(len(home)))
    c, s = np.cos(w * time), np.sin(w * time)
    return Reference(home + amplitude * (1.0 - c) / 2.0, amplitude * w * s / 2.0, amplitude * w**2 * c / 2.0)


class ComputedTorque:
    """Computed-torque control: e = M(q) (q̈_d + kd (q̇_d - u) + kp (q_d - q)) + h(q, u).

    M and h are evaluated by inverse dynamics; the error then obeys the equation of a damped oscillator
    (Siciliano et al. 2009, sec. 8.5.2).
    """

    def __init__(self, mechanism: Mechanism, bandwidth: float = 20.0) -> None:
        """Errors decay at the rate `bandwidth` (1/s), critically damped."""
        self.kp, self.kd = bandwidth**2, 2.0 * bandwidth
        self._inverse_dynamics = InverseDynamics(mechanism)

    def efforts(self, q: Array, u: Array, reference: Reference) -> Array:
        """The efforts (nv,) in N·m."""
        feedback = self.kd * (reference.u - u) + self.kp * (reference.q - q)
        return self._inverse_dynamics(q, u, reference.u_rates + feedback)


class ComputedTorqueNode(ControlNode):
    """Publishes the tracking error of each joint in rad on `~/tracking_error`."""

    PARAMETERS = (
        mechanism_parameter("six_axis_arm"),
        ParameterSpec("amplitude", 0.8, "amplitude of the reference motion in rad"),
        ParameterSpec("frequency", 0.25, "frequency of the reference motion in Hz"),
        ParameterSpec("bandwidth", 20.0, "natural frequency of the tracking error in rad/s"),
    )

    def __init__(self) -> None:
        super().__init__("computed_torque")
        self.amplitude, self.frequency = (float(self.get_parameter(n).value) for n in ("amplitude", "frequency"))
        self.law = ComputedTorque(self.mechanism, float(self.get_parameter("bandwidth").value))
        self._errors = self.create_publisher(Float64MultiArray, "~/tracking_error", 10)
        self._start_time: float | None = None
        self._home = np.zeros(len(self.names))

    def control(self, time: float, q: Array, u: Array) -> Array:
        """Follow the reference motion, which starts at the first received state."""
        if self._start_time is None or time < self._start_time:
            self._start_time, self._home = time, q
        reference = sway(self._home, self.amplitude, self.frequency, time - self._start_time)
        self._errors.publish(Float64MultiArray(data=(reference.q - q).tolist()))
        return self.law.efforts(q, u, reference)


def main() -> int:
    """Run the node."""
    return run("example_computed_torque", ComputedTorqueNode, example="amplitude:=0.5", topics=TOPICS)


if __name__ == "__main__":
    sys.exit(main())
