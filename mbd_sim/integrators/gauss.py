"""Gauss methods as data (Hairer, Lubich & Wanner, *Geometric Numerical Integration*, sec. II.1.3)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from mbd_sim.base.short_repr import short_repr
from mbd_sim.integrators.method import Coefficients, ErrorEstimate, Method


@dataclass(frozen=True)
class Gauss(Method):
    """y + h Σ b_i k_i with k_i = f(t + c_i h, y + h Σ_j a_ij k_j); sweeps over the stages solve for the k_i.

    A step takes at most `sweeps` of them, and fewer once a sweep changes nothing. The slopes of the `estimate` are f at
    the start of the step and then the k_i: it measures by how much the polynomial through the k_i misses f there.
    `stability_limit` is the largest h |λ| at which the sweeps converge, for the eigenvalues λ of the system.
    """

    explicit: ClassVar[bool] = False

    a: tuple[Coefficients, ...]
    b: Coefficients
    c: Coefficients
    estimate: ErrorEstimate
    sweeps: int = 16

    __repr__ = short_repr

    @property
    def stages(self) -> int:
        """The number of stages. A step evaluates the accelerations once per stage and sweep, and once at its start."""
        return len(self.b)


R3, R15 = math.sqrt(3.0), math.sqrt(15.0)

# The factors 0.6 and 0.5 scale the estimates to the errors measured on a double pendulum, a top and a cart.
GAUSS: dict[str, Gauss] = {
    method.name: method
    for method in (
        Gauss(
            "gauss4",
            4,
            ((0.25, 0.25 - R3 / 6.0), (0.25 + R3 / 6.0, 0.25)),
            (0.5, 0.5),
            (0.5 - R3 / 6.0, 0.5 + R3 / 6.0),
            ErrorEstimate(tuple(0.6 * d for d in (1.0, -(1.0 + R3) / 2.0, -(1.0 - R3) / 2.0)), (1.0,)),
            stability_limit=2.0,
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
            ErrorEstimate(tuple(0.5 * d for d in (1.0, -(5.0 + R15) / 6.0, 2.0 / 3.0, -(5.0 - R15) / 6.0)), (1.0,)),
            stability_limit=2.0,
        ),
    )
}
