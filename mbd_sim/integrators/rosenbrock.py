"""Rosenbrock methods as data (Hairer & Wanner, *Solving Ordinary Differential Equations II*, sec. IV.7)."""

from __future__ import annotations

import math
from dataclasses import dataclass

from mbd_sim.integrators import rodas5p
from mbd_sim.integrators.estimate import Coefficients, ErrorEstimate


@dataclass(frozen=True)
class Rosenbrock:
    """y + Σ m_i U_i, with increments U_i that are each a solution of a linear system with the same matrix.

    With J = ∂f/∂y and f_t = ∂f/∂t at the start of the step,

    (I − h γ J) U_i = γ (h f(t + c_i h, y + Σ_{j<i} a_ij U_j) + Σ_{j<i} g_ij U_j + d_i h² f_t),

    which is Hairer & Wanner II, eq. IV.7.25, multiplied by h γ, so that no stage needs a product with J. `a` and `g`
    hold the rows below the diagonal. `stability_limit` is infinite for an L-stable method.
    """

    name: str
    order: int
    gamma: float
    a: tuple[Coefficients, ...]
    g: tuple[Coefficients, ...]
    c: Coefficients
    d: Coefficients
    m: Coefficients
    estimate: ErrorEstimate
    stability_limit: float = math.inf

    @property
    def stages(self) -> int:
        """Evaluations of the accelerations per step, besides one of their derivatives."""
        return len(self.m)


ROSENBROCK: dict[str, Rosenbrock] = {
    method.name: method
    for method in (
        Rosenbrock(
            "rosenbrock",
            5,
            rodas5p.GAMMA,
            rodas5p.A,
            rodas5p.G,
            rodas5p.C,
            rodas5p.D,
            rodas5p.M,
            ErrorEstimate((0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)),
        ),
    )
}
