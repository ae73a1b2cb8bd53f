"""Adams–Bashforth–Moulton methods as data (Hairer, Nørsett & Wanner, *Solving Ordinary Differential Equations I*)."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from math import comb, prod
from typing import ClassVar

from mbd_sim.base.short_repr import short_repr
from mbd_sim.integrators.method import Coefficients, Method
from mbd_sim.integrators.tableau import EXPLICIT, Tableau


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
