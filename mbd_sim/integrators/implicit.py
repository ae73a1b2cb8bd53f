"""Implicit methods as data: Gauss methods, and Rosenbrock methods, which are linearly implicit.

Gauss methods: Hairer, Lubich & Wanner, *Geometric Numerical Integration*, sec. II.1.3.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from mbd_sim.base.linear_algebra import added
from mbd_sim.base.short_repr import short_repr
from mbd_sim.integrators.coefficients import rodas5p, ros34pw2
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


@dataclass(frozen=True)
class Rosenbrock(Method):
    """y + Σ m_i U_i, with increments U_i that are each a solution of a linear system with the same matrix.

    With J = ∂f/∂y and f_t = ∂f/∂t at the start of the step,

    (I − h γ J) U_i = γ (h f(t + c_i h, y + Σ_{j<i} a_ij U_j) + Σ_{j<i} g_ij U_j + d_i h² f_t),

    which is Hairer & Wanner II, eq. IV.7.25, multiplied by h γ, so that no stage needs a product with J. `a` and `g`
    hold the rows below the diagonal. `stability_limit` is infinite for an L-stable method.
    """

    for_stiff: ClassVar[bool] = True
    explicit: ClassVar[bool] = False

    gamma: float
    a: tuple[Coefficients, ...]
    g: tuple[Coefficients, ...]
    c: Coefficients
    d: Coefficients
    m: Coefficients
    estimate: ErrorEstimate

    __repr__ = short_repr

    @property
    def stages(self) -> int:
        """Evaluations of the accelerations per step, besides one of their derivatives."""
        return len(self.m)


@dataclass(frozen=True, repr=False)
class RosenbrockW(Rosenbrock):
    """Of a method that keeps its order for any J: J holds only the forces within joints, and f_t is taken as zero."""

    uses_joints: ClassVar[bool] = True


def _rosenbrock_w(
    name: str,
    order: int,
    gamma: float,
    alpha: Sequence[Coefficients],
    off_diagonal: Sequence[Coefficients],
    weights: Coefficients,
    embedded: Coefficients,
) -> RosenbrockW:
    """A method given by α, the rows of Γ below its diagonal, b and the embedded b.

    With U = Γ k the coefficients are a = α Γ⁻¹, g = 1/γ - Γ⁻¹ and m = b Γ⁻¹ (Hairer & Wanner II, eq. IV.7.25).
    """
    stages = len(weights)
    inverse = [[0.0] * stages for _ in range(stages)]
    for row in range(stages):
        for column in range(row + 1):
            total = 1.0 if row == column else 0.0
            for index in range(column, row):
                total -= off_diagonal[row][index] * inverse[index][column]
            inverse[row][column] = total / gamma

    def transformed(row: Coefficients) -> Coefficients:
        return tuple(added(value * inverse[i][column] for i, value in enumerate(row)) for column in range(stages))

    m, low = transformed(weights), transformed(embedded)
    return RosenbrockW(
        name,
        order,
        gamma,
        a=tuple(transformed(row)[: len(row)] for row in alpha),
        g=tuple(tuple(-value for value in row[:index]) for index, row in enumerate(inverse)),
        c=tuple(added(row) for row in alpha),
        d=(0.0,) * stages,
        m=m,
        estimate=ErrorEstimate(tuple(one - other for one, other in zip(m, low, strict=True))),
        stability_limit=math.inf,
    )


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
            stability_limit=math.inf,
        ),
    )
}
ROSENBROCK_W: dict[str, RosenbrockW] = {
    "rosenbrock_w": _rosenbrock_w(
        "rosenbrock_w",
        3,
        ros34pw2.GAMMA,
        ros34pw2.ALPHA,
        ros34pw2.OFF_DIAGONAL,
        ros34pw2.B,
        ros34pw2.EMBEDDED,
    )
}
