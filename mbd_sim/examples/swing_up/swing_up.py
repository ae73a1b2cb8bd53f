"""`ros2 run mbd_sim example_swing_up`: swings up the pendulum of a cart by energy control, and balances it by LQR."""

from __future__ import annotations

import math
import sys

import numpy as np

from mbd_sim.analysis.linear.linearization import linearize
from mbd_sim.analysis.linear.state_space import lqr
from mbd_sim.base.geometry.pose import Array
from mbd_sim.dynamics.equations import derive
from mbd_sim.examples.control_node import ControlNode, mechanism_parameter, run
from mbd_sim.mechanism.mechanism import Mechanism

CATCH_ANGLE, LOSE_ANGLE = 0.35, 0.8  # rad from upright: balancing starts within the first, has failed beyond the second
CATCH_SPEED = 4.0  # rad/s below which balancing may start
PUMP_GAIN, CENTER_GAIN, BRAKE_GAIN = 12.0, 2.0, 3.0  # m/s² per J, 1/s², 1/s
MAX_ACCELERATION = 9.0  # m/s², of the cart during the swing-up
STATE_COST, EFFORT_COST = np.diag([4.0, 10.0, 1.0, 1.0]), np.array([[0.2]])  # of x, angle and their rates; of the force


class SwingUp:
    """Controls a mechanism with the coordinates (cart, pendulum), where the pendulum hangs at zero.

    Swing-up (Åström & Furuta 2000): a cart acceleration a changes the pendulum's energy at the rate -m c a θ' cos θ.
    Therefore a = -k (E_up - E) sign(θ' cos θ), within the limits of the cart, never moves the energy away from E_up.
    The force for this acceleration follows from the equations of motion. Near the top a linear-quadratic regulator
    takes over, computed from the exact linearization about the upright position.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        self.equations = derive(mechanism)
        self.effort_limit = float(mechanism.effort_limits()[0])
        upright, zeros = np.array([0.0, math.pi]), np.zeros(2)
        linear = linearize(self.equations, upright, zeros, zeros)
        self.gain = lqr(linear.a, linear.b[:, :1], STATE_COST, EFFORT_COST)[0]
        self.energy_up = self._energy(math.pi, 0.0)
        self.balancing = False

    def force(self, q: Array, u: Array) -> float:
        """The force on the cart in N."""
        angle = math.remainder(q[1] - math.pi, 2.0 * math.pi)  # from upright
        if self.balancing:
            self.balancing = abs(angle) < LOSE_ANGLE
        else:
            self.balancing = abs(angle) < CATCH_ANGLE and abs(u[1]) < CATCH_SPEED
        if self.balancing:
            force = float(-self.gain @ [q[0], angle, u[0], u[1]])
        else:
            force = self._force_for(q, u, self._pumping_acceleration(q, u))
        return float(np.clip(force, -self.effort_limit, self.effort_limit))

    def _pumping_acceleration(self, q: Array, u: Array) -> float:
        """The cart acceleration that brings the pendulum's energy toward that of standing upright."""
        missing_energy = self.energy_up - self._energy(q[1], u[1])
        swing = u[1] * math.cos(q[1])
        direction = math.copysign(1.0, swing if abs(swing) > 1e-6 else 1.0)  # a pendulum at rest needs a first push
        pumping = float(np.clip(-PUMP_GAIN * missing_energy * direction, -MAX_ACCELERATION, MAX_ACCELERATION))
        return float(pumping - CENTER_GAIN * q[0] - BRAKE_GAIN * u[0] * (abs(q[0]) > 0.5))

    def _energy(self, angle: float, rate: float) -> float:
        """T + V of the pendulum in J, with the cart at rest."""
        y = np.array([0.0, angle, 0.0, rate, 0.0, 0.0, 0.0])
        return float(np.sum(np.array(self.equations.energies(0.0, y))))

    def _force_for(self, q: Array, u: Array, acceleration: float) -> float:
        """The force in N that gives the cart an acceleration, which is linear in the force."""
        y = np.concatenate([q, u, np.zeros(3)])
        free, pushed = (float(self.equations.rates.call([0.0, y, [force, 0.0]])[0][2]) for force in (0.0, 1.0))
        return (acceleration - free) / (pushed - free)


class SwingUpNode(ControlNode):
    """Logs when it starts to balance, and when it swings up again."""

    PARAMETERS = (mechanism_parameter("cart_pendulum"),)

    def __init__(self) -> None:
        super().__init__("swing_up")
        self.law = SwingUp(self.mechanism)

    def control(self, time: float, q: Array, u: Array) -> Array:
        """The force on the cart; the pendulum's joint has no motor."""
        before = self.law.balancing
        force = self.law.force(q, u)
        if self.law.balancing != before:
            self.get_logger().info(f"t = {time:.2f} s: {'balancing' if self.law.balancing else 'swinging up'}")
        return np.array([force, 0.0])


def main() -> int:
    """Run the node."""
    return run("example_swing_up", SwingUpNode, example="mechanism:=cart_pendulum")


if __name__ == "__main__":
    sys.exit(main())
