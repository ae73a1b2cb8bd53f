"""`ros2 run mbd_sim example_computed_torque`: an arm follows a motion by inverse dynamics."""

from __future__ import annotations

import sys
from typing import NamedTuple

import numpy as np
from std_msgs.msg import Float64MultiArray

from mbd_sim.analysis.inverse_dynamics import InverseDynamics
from mbd_sim.examples.control_node import AT_START, ControlNode, run
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.records import Mechanism


class Reference(NamedTuple):
    """Where the joints should be: coordinates in rad, speeds and accelerations, (nv,) each."""

    q: Array
    u: Array
    u_rates: Array


def sway(home: Array, amplitude: float, frequency: float, time: float) -> Reference:
    """Every joint to and fro, from rest at `home`, each a little faster than the one before; Hz and s."""
    w = 2.0 * np.pi * frequency * (1.0 + 0.15 * np.arange(len(home)))
    c, s = np.cos(w * time), np.sin(w * time)
    return Reference(home + amplitude * (1.0 - c) / 2.0, amplitude * w * s / 2.0, amplitude * w**2 * c / 2.0)


class ComputedTorque:
    """e = M(q) (q̈_d + kd (q̇_d - u) + kp (q_d - q)) + h(q, u): errors die away as those of a damped oscillator.

    M and h are those of our equations, by inverse dynamics (Siciliano et al. 2009, sec. 8.5.2).
    """

    def __init__(self, mechanism: Mechanism, bandwidth: float = 20.0) -> None:
        """Errors decay at the rate `bandwidth` (1/s), critically damped."""
        self.kp, self.kd = bandwidth**2, 2.0 * bandwidth
        self._inverse = InverseDynamics(mechanism)

    def efforts(self, q: Array, u: Array, wanted: Reference) -> Array:
        """The efforts (nv,), N·m."""
        return self._inverse(q, u, wanted.u_rates + self.kd * (wanted.u - u) + self.kp * (wanted.q - q))


class ComputedTorqueNode(ControlNode):
    """Publishes how far the joints are off on `~/tracking_error`, in rad."""

    def __init__(self) -> None:
        super().__init__("computed_torque", "six_axis_arm")
        for name, value in (("amplitude", 0.8), ("frequency", 0.25), ("bandwidth", 20.0)):
            self.declare_parameter(name, value, AT_START)
        self.amplitude, self.frequency = (float(self.get_parameter(n).value) for n in ("amplitude", "frequency"))
        self.law = ComputedTorque(self.mechanism, float(self.get_parameter("bandwidth").value))
        self._errors = self.create_publisher(Float64MultiArray, "~/tracking_error", 10)
        self._began: float | None = None
        self._home = np.zeros(len(self.names))
        self.start()

    def control(self, time: float, q: Array, u: Array) -> Array:
        """Along the reference, which begins where the arm is when it is first heard of."""
        if self._began is None or time < self._began:
            self._began, self._home = time, q
        wanted = sway(self._home, self.amplitude, self.frequency, time - self._began)
        self._errors.publish(Float64MultiArray(data=(wanted.q - q).tolist()))
        return self.law.efforts(q, u, wanted)


def main() -> int:
    """Run the node."""
    return run(ComputedTorqueNode)


if __name__ == "__main__":
    sys.exit(main())
