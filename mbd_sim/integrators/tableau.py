"""Explicit Runge–Kutta methods as data (Hairer, Nørsett & Wanner, *Solving Ordinary Differential Equations I*)."""

from __future__ import annotations

from dataclasses import dataclass

from mbd_sim.base.short_repr import short_repr
from mbd_sim.integrators.coefficients import dop853, tsitouras8, verner7
from mbd_sim.integrators.method import Coefficients, ErrorEstimate, Method


@dataclass(frozen=True)
class Tableau(Method):
    """y + h Σ b_i k_i with k_i = f(t + c_i h, y + h Σ_{j<i} a_ij k_j); `a` holds the rows below the diagonal.

    `stability_limit` is the smaller of the limits along the real and the imaginary axis, or the other one if that is
    zero.
    """

    a: tuple[Coefficients, ...]
    b: Coefficients
    c: Coefficients
    estimate: ErrorEstimate

    __repr__ = short_repr

    @property
    def stages(self) -> int:
        """Evaluations of the accelerations per step."""
        return len(self.b)


EXPLICIT: dict[str, Tableau] = {
    method.name: method
    for method in (
        # The second stage of Euler's method serves the estimate only.
        Tableau("euler", 1, ((), (1.0,)), (1.0, 0.0), (0.0, 1.0), ErrorEstimate((-0.5, 0.5)), stability_limit=2.0),
        Tableau(
            "midpoint", 2, ((), (0.5,)), (0.0, 1.0), (0.0, 0.5), ErrorEstimate((-1.0, 1.0), (1.0,)), stability_limit=2.0
        ),
        Tableau(
            "rk4",
            4,
            ((), (0.5,), (0.0, 0.5), (0.0, 0.0, 1.0)),
            (1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0),
            (0.0, 0.5, 0.5, 1.0),
            ErrorEstimate((1.0 / 3.0, -1.0 / 3.0, -1.0 / 3.0, 1.0 / 3.0), (1.0,)),
            stability_limit=2.8,
        ),
        Tableau(
            "verner7",
            7,
            verner7.A,
            verner7.B,
            verner7.C,
            ErrorEstimate(verner7.FINE, verner7.COARSE),
            stability_limit=4.6,
        ),
        Tableau(
            "tsitouras8",
            8,
            tsitouras8.A,
            tsitouras8.B,
            tsitouras8.C,
            ErrorEstimate(tsitouras8.FINE, tsitouras8.COARSE),
            stability_limit=2.9,
        ),
        Tableau(
            "dop853", 8, dop853.A, dop853.B, dop853.C, ErrorEstimate(dop853.E5, dop853.E3, 0.01), stability_limit=6.0
        ),
    )
}
