"""Gauss methods as data (Hairer, Lubich & Wanner, *Geometric Numerical Integration*, sec. II.1.3)."""

from __future__ import annotations

import math
from dataclasses import dataclass

from mbd_sim.integrators.estimate import Estimate, Row


@dataclass(frozen=True)
class Gauss:
    """y + h Σ b_i k_i with k_i = f(t + c_i h, y + h Σ_j a_ij k_j), the k_i found by sweeps over the stages.

    A step takes at most `sweeps` of them, and fewer where they change nothing more. The slopes of the `estimate` are
    f at the start of the step and then the k_i: what the polynomial through the k_i misses at the start. `reach` is
    how large h |λ| may be for the sweeps to converge.
    """

    name: str
    order: int
    a: tuple[Row, ...]
    b: Row
    c: Row
    estimate: Estimate
    sweeps: int = 16
    reach: float = 2.0

    @property
    def stages(self) -> int:
        """Stages; a step evaluates the accelerations of each of them in every sweep, and once at its start."""
        return len(self.b)


R3, R15 = math.sqrt(3.0), math.sqrt(15.0)

# The factors 0.6 and 0.5 bring the estimates to the size of the errors of a double pendulum, a top and a cart.
GAUSS: dict[str, Gauss] = {
    method.name: method
    for method in (
        Gauss(
            "gauss4",
            4,
            ((0.25, 0.25 - R3 / 6.0), (0.25 + R3 / 6.0, 0.25)),
            (0.5, 0.5),
            (0.5 - R3 / 6.0, 0.5 + R3 / 6.0),
            Estimate(tuple(0.6 * d for d in (1.0, -(1.0 + R3) / 2.0, -(1.0 - R3) / 2.0)), (1.0,)),
        ),
        Gauss(
            "gauss6",
            6,
            (
                (5.0 / 36.0, 2.0 / 9.0 - R15 / 15.0, 5.0 / 36.0 - R15 / 30.0),
                (5.0 / 36.0 + R15 / 24.0, 2.0 / 9.0, 5.0 / 36.0 - R15 / 24.0),
                (5.0 / 36.0 + R15 / 30.0, 2.0 / 9.0 + R15 / 15.0, 5.0 / 36.0),
            ),
            (5.0 / 18.0, 4.0 / 9.0, 5.0 / 18.0),
            (0.5 - R15 / 10.0, 0.5, 0.5 + R15 / 10.0),
            Estimate(tuple(0.5 * d for d in (1.0, -(5.0 + R15) / 6.0, 2.0 / 3.0, -(5.0 - R15) / 6.0)), (1.0,)),
        ),
    )
}
