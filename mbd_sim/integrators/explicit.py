"""Explicit methods as data: Runge–Kutta, Adams–Bashforth–Moulton and Taylor methods.

Runge–Kutta and Adams methods: Hairer, Nørsett & Wanner, *Solving Ordinary Differential Equations I*. The Taylor method:
Jorba & Zou, *Experimental Mathematics* 14, 2005.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from math import comb, prod
from typing import ClassVar

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


@dataclass(frozen=True)
class Taylor(Method):
    """y(t + τ) = Σ c_k τᵏ up to k = `order`, with the Taylor coefficients c_k of the solution at t.

    An expansion holds for as many whole steps as fit into the longest τ with rᵏ τᵏ ≤ `tolerance` at k = `order`, but
    for `most_steps` at most. r is the largest |c_k|^(1/k) of the last `compared` orders, since in symmetric motions
    some of them vanish, with |c| = Σ_i |c_i| / (s_i + |y_i|). If τ is shorter than a step, the step is divided, into
    `most_parts` at most. If it is shorter still, or the constraints are ill-conditioned, the step is taken by
    `otherwise`. `stability_limit` is the largest h |λ| at which it is not: e^(λ τ) has r = |λ| / (k!)^(1/k).
    """

    keeps_history: ClassVar[bool] = True
    uses_series: ClassVar[bool] = True

    tolerance: float
    otherwise: Tableau
    compared: int = 4
    most_steps: int = 256
    most_parts: int = 32

    __repr__ = short_repr

    @property
    def stages(self) -> int:
        """The evaluations of the accelerations in a step that is taken by `otherwise`."""
        return self.otherwise.stages

    @property
    def one_step(self) -> Tableau:
        """The other method."""
        return self.otherwise

    def history_size(self, size: int, inputs_size: int) -> int:
        """The numbers of `mbd_sim.compiler.taylor.step`: four, then the state, the inputs and the coefficients."""
        return 4 + inputs_size + (2 + self.order) * size


TAYLOR: dict[str, Taylor] = {"taylor": Taylor("taylor", 20, 1e-16, EXPLICIT["tsitouras8"], stability_limit=40.0)}


@dataclass(frozen=True)
class Adams(Method):
    """A step y* = y + h Σ p_j f_j, y' = y + h (γ f(t + h, y*) + Σ c_j f_j), where f_j are the slopes j steps ago.

    p are the `predictor` and c the `corrector`, γ is the `newest` of its coefficients. A step is taken at once, or in
    two or four parts from slopes at a distance of h/2 or h/4, or else by `otherwise`: while there are fewer slopes than
    coefficients, or where the error of y* in a component exceeds `tolerance` (s + |y|), with its scale s. It is
    y' − y* = h γ ∇ᵏ f, the difference of order k of the slopes, k their number. `differences` are the coefficients s of
    those of the orders `LOWER`, f(t + h, y*) − Σ s_j f_j, which tell the error from the round-off of f, see
    `mbd_sim.compiler.steps.adams_attempt`. `midpoints` are the coefficients of f(t + h, y*) and the f_j in the slopes
    at t − h/2, t − 3h/2 ….
    `stability_limit` is that of `otherwise`, since y' − y* grows where a step of this method is not stable.
    """

    keeps_history: ClassVar[bool] = True

    predictor: Coefficients
    corrector: Coefficients
    newest: float
    differences: tuple[Coefficients, ...]
    midpoints: tuple[Coefficients, ...]
    tolerance: float
    otherwise: Tableau

    __repr__ = short_repr

    @property
    def length(self) -> int:
        """The number of slopes."""
        return len(self.predictor)

    @property
    def stages(self) -> int:
        """The evaluations of the accelerations in the code of a step, of which few are executed."""
        return self.otherwise.stages + 4

    @property
    def evaluations(self) -> int:
        """Those of a step at once."""
        return 2

    @property
    def one_step(self) -> Tableau:
        """The other method."""
        return self.otherwise

    def history_size(self, size: int, inputs_size: int) -> int:
        """The numbers of `mbd_sim.compiler.steps.adams_history`: six, then the state, inputs, round-off and slopes."""
        return 6 + inputs_size + (2 + PARTS * self.length) * size

    def inputs_in_history(self, size: int) -> int:
        """Behind the six numbers and the state."""
        return 6 + size


PARTS = 4  # of a step at most
LOWER = (3, 4, 5, 6, 7, 8)  # orders of differences with less round-off


def adams(name: str, length: int, tolerance: float, otherwise: Tableau) -> Adams:
    """The method with a predictor through `length` slopes, of that order, and a corrector of one order more."""
    weights = [Fraction(1)]  # γ_j with Σ_k γ_k / (j + 1 − k) = 1, sec. III.1, eq. (1.6)
    for j in range(1, length + 1):
        weights.append(1 - sum((weight / (j + 1 - k) for k, weight in enumerate(weights)), Fraction(0)))
    predictor = [(-1) ** j * sum(comb(m, j) * weights[m] for m in range(j, length)) for j in range(length)]
    newest = weights[length]  # y' − y* = h γ ∇ᵏ f, the difference of order k = `length` of f(t + h, y*) and the slopes
    corrector = [p + (-1) ** (j + 1) * comb(length, j + 1) * newest for j, p in enumerate(predictor)]
    p, c = (tuple(float(value) for value in values) for values in (predictor, corrector))
    differences = tuple(tuple(float(-((-1) ** j) * comb(k, j)) for j in range(1, k + 1)) for k in LOWER)
    midpoints = tuple(_interpolation(length, -1 - 2 * back) for back in range(length // 2))
    return Adams(
        name,
        length + 1,
        p,
        c,
        float(newest),
        differences,
        midpoints,
        tolerance,
        otherwise,
        stability_limit=otherwise.stability_limit,
    )


def _interpolation(length: int, twice: int) -> Coefficients:
    """The weights of the values at 1, 0, −1 … 1 − `length` of a polynomial in its value at `twice` / 2 (Lagrange)."""
    nodes = [1 - index for index in range(length + 1)]

    def weight(node: int) -> Fraction:
        others = [other for other in nodes if other != node]
        return Fraction(prod(twice - 2 * other for other in others), prod(2 * (node - other) for other in others))

    return tuple(float(weight(node)) for node in nodes)


ADAMS: dict[str, Adams] = {"adams11": adams("adams11", 10, 2e-14, EXPLICIT["tsitouras8"])}
