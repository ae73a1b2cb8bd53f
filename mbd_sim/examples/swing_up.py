"""`ros2 run mbd_sim example_swing_up`: swings the pendulum of a cart up by its energy, and balances it by LQR."""

from __future__ import annotations

import math
import sys

import numpy as np

from mbd_sim.analysis.linearization import linearize
from mbd_sim.analysis.regulator import lqr
from mbd_sim.dynamics.equations import derive
from mbd_sim.examples.control_node import ControlNode, run
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.records import Mechanism

CATCH, LOSE = 0.35, 0.8  # rad from upright at which balancing begins, and at which it has failed
FASTEST = 4.0  # rad/s at which it may begin
PUMP, CENTER, BRAKE = 12.0, 2.0, 3.0  # m/s² a J, 1/s², 1/s
STRONGEST = 9.0  # m/s², of the cart while it pumps
STATE_COST, EFFORT_COST = np.diag([4.0, 10.0, 1.0, 1.0]), np.array([[0.2]])  # of x, angle and their rates; of the force


class SwingUp:
    """The force on the cart of a mechanism with the coordinates (cart, pendulum), the pendulum hanging at zero.

    Swinging up (Åström & Furuta 2000): an acceleration a of the cart changes the pendulum's energy at the rate
    -m c a θ' cos θ, so that a = -k (E_up - E) sign(θ' cos θ), cut to what the cart can do, never goes the wrong way.
    The force that gives the cart this acceleration follows from our equations. Near the top the gains of the
    linear-quadratic regulator take over; they come from the exact linearization about the upright position.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        self.equations = derive(mechanism)
        self.limit = float(mechanism.effort_limits()[0])
        upright, still = np.array([0.0, math.pi]), np.zeros(2)
        linear = linearize(self.equations, upright, still, still)
        self.gain = lqr(linear.a, linear.b[:, :1], STATE_COST, EFFORT_COST)[0]
        self.energy_up = self._energy(math.pi, 0.0)
        self.balancing = False

    def force(self, q: Array, u: Array) -> float:
        """The force in N for the state of this moment."""
        angle = math.remainder(q[1] - math.pi, 2.0 * math.pi)  # from upright
        if self.balancing:
            self.balancing = abs(angle) < LOSE
        else:
            self.balancing = abs(angle) < CATCH and abs(u[1]) < FASTEST
        if self.balancing:
            wanted = float(-self.gain @ [q[0], angle, u[0], u[1]])
        else:
            wanted = self._force_for(q, u, self._pumping(q, u))
        return float(np.clip(wanted, -self.limit, self.limit))

    def _pumping(self, q: Array, u: Array) -> float:
        """The acceleration of the cart that brings the pendulum's energy to that of standing upright."""
        missing = self.energy_up - self._energy(q[1], u[1])
        swing = u[1] * math.cos(q[1])
        side = math.copysign(1.0, swing if abs(swing) > 1e-6 else 1.0)  # at rest it needs a first push
        pump = -PUMP * missing * side
        return float(np.clip(pump, -STRONGEST, STRONGEST) - CENTER * q[0] - BRAKE * u[0] * (abs(q[0]) > 0.5))

    def _energy(self, angle: float, rate: float) -> float:
        """T + V of the pendulum in J, with the cart held."""
        y = np.array([0.0, angle, 0.0, rate, 0.0, 0.0, 0.0])
        return float(np.sum(np.array(self.equations.energies(0.0, y))))

    def _force_for(self, q: Array, u: Array, acceleration: float) -> float:
        """The force in N that gives the cart an acceleration: x'' is linear in it."""
        y = np.concatenate([q, u, np.zeros(3)])
        free, pushed = (float(self.equations.rates.call([0.0, y, [force, 0.0]])[0][2]) for force in (0.0, 1.0))
        return (acceleration - free) / (pushed - free)


class SwingUpNode(ControlNode):
    """Says when it begins to balance."""

    def __init__(self) -> None:
        super().__init__("swing_up", "cart_pendulum")
        self.law = SwingUp(self.mechanism)
        self.start()

    def control(self, time: float, q: Array, u: Array) -> Array:
        """The force on the cart; the pin has no motor."""
        before = self.law.balancing
        force = self.law.force(q, u)
        if self.law.balancing != before:
            self.get_logger().info(f"t = {time:.2f} s: {'balancing' if self.law.balancing else 'swinging up'}")
        return np.array([force, 0.0])


def main() -> int:
    """Run the node."""
    return run(SwingUpNode)


if __name__ == "__main__":
    sys.exit(main())
