"""The Taylor method as data (Jorba & Zou, *Experimental Mathematics* 14, 2005)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from mbd_sim.base.short_repr import short_repr
from mbd_sim.integrators.method import Method
from mbd_sim.integrators.tableau import EXPLICIT, Tableau


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
