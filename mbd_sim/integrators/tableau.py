"""Explicit Runge–Kutta methods as data (Hairer, Nørsett & Wanner, *Solving Ordinary Differential Equations I*).

Estimates of the error of a step are coefficients of the slopes that the step computes anyway.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from mbd_sim.base.short_repr import short_repr
from mbd_sim.integrators.coefficients import dop853, tsitouras8, verner7

Coefficients = tuple[float, ...]
Scales = Sequence[float]  # s of each component of a state y: errors are relative to s + |y|. Without any, they are 1


@dataclass(frozen=True)
class ErrorEstimate:
    """F² / √(F² + w C²) with F = |Σ fine k| and C = |Σ coarse k|, or F alone without `coarse`; w is `weight`.

    |·| is the Euclidean norm over the components of the state, each divided by s + |y| with its scale s. k are h times
    the slopes of a Runge–Kutta method, or the increments of a Rosenbrock method. With F of order hᵖ and C of order hᵠ
    the estimate is of order h²ᵖ⁻ᵠ. It is F if the step is so large that F exceeds C (Hairer, Nørsett & Wanner I, sec.
    II.10, where w = 0.01 for DOP853).
    """

    fine: Coefficients
    coarse: Coefficients = ()
    weight: float = 1.0

    __repr__ = short_repr


@dataclass(frozen=True)
class Tableau:
    """y + h Σ b_i k_i with k_i = f(t + c_i h, y + h Σ_{j<i} a_ij k_j); `a` holds the rows below the diagonal.

    `stability_limit` is roughly the largest h |λ| at which a step is stable, for a damped eigenvalue λ of the system.
    It is the smaller of the limits along the real and the imaginary axis, or the other one if that is zero.
    """

    name: str
    order: int
    a: tuple[Coefficients, ...]
    b: Coefficients
    c: Coefficients
    estimate: ErrorEstimate
    stability_limit: float

    __repr__ = short_repr

    @property
    def stages(self) -> int:
        """Evaluations of the accelerations per step."""
        return len(self.b)


EXPLICIT: dict[str, Tableau] = {
    method.name: method
    for method in (
        # The second stage of Euler's method serves the estimate only.
        Tableau("euler", 1, ((), (1.0,)), (1.0, 0.0), (0.0, 1.0), ErrorEstimate((-0.5, 0.5)), 2.0),
        Tableau("midpoint", 2, ((), (0.5,)), (0.0, 1.0), (0.0, 0.5), ErrorEstimate((-1.0, 1.0), (1.0,)), 2.0),
        Tableau(
            "rk4",
            4,
            ((), (0.5,), (0.0, 0.5), (0.0, 0.0, 1.0)),
            (1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0),
            (0.0, 0.5, 0.5, 1.0),
            ErrorEstimate((1.0 / 3.0, -1.0 / 3.0, -1.0 / 3.0, 1.0 / 3.0), (1.0,)),
            2.8,
        ),
        Tableau("verner7", 7, verner7.A, verner7.B, verner7.C, ErrorEstimate(verner7.FINE, verner7.COARSE), 4.6),
        Tableau(
            "tsitouras8",
            8,
            tsitouras8.A,
            tsitouras8.B,
            tsitouras8.C,
            ErrorEstimate(tsitouras8.FINE, tsitouras8.COARSE),
            2.9,
        ),
        Tableau("dop853", 8, dop853.A, dop853.B, dop853.C, ErrorEstimate(dop853.E5, dop853.E3, 0.01), 6.0),
    )
}
