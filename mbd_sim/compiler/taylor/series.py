"""Taylor series of the values of an instruction list, as data: recurrences for their coefficients.

Moore, *Methods and Applications of Interval Analysis*; Griewank & Walther, *Evaluating Derivatives*, ch. 13.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from mbd_sim.compiler.lists.instruction_list import Node


@dataclass(frozen=True, slots=True)
class Sum:
    """The sum of factor x_j y_{k−j} over j from `first` to k − `less`; with j x_j for x_j if x is `derived`."""

    x: int
    y: int
    first: int = 0
    less: int = 0
    derived: bool = False
    factor: float = 1.0


@dataclass(frozen=True, slots=True)
class Recurrence:
    """Coefficient k ≥ 1 of a series: (Σ factor x_k + Σ sums) factor / d_0.

    The `terms` are pairs of a factor and a series x. If `by_order`, the sums are divided by k; without a `divisor`,
    d_0 is 1.
    """

    terms: tuple[tuple[float, int], ...] = ()
    sums: tuple[Sum, ...] = ()
    by_order: bool = False
    divisor: int | None = None
    factor: float = 1.0


@dataclass(frozen=True, slots=True)
class Integral:
    """Coefficient k ≥ 1 of a series that is the integral of a result: that result's coefficient k − 1, divided by k."""

    result: int


@dataclass(frozen=True, slots=True)
class Series:
    """A series: the operation whose value is its coefficient 0, on those of other series, and the others' `rule`.

    Without a rule they are zero.
    """

    start: Node
    rule: Recurrence | Integral | None = None


@dataclass(frozen=True, eq=False)
class SeriesList:
    """Series in an order in which coefficients k can be computed one after the other, and those of the `results`."""

    series: Sequence[Series]
    results: Sequence[int]

    @property
    def divisors(self) -> list[int]:
        """The series by whose coefficients 0 others are divided."""
        rules = (series.rule for series in self.series)
        return sorted({r.divisor for r in rules if isinstance(r, Recurrence) and r.divisor is not None})

    @property
    def has_exponentials(self) -> bool:
        """Whether values may decay exponentially, so that coefficients may say nothing of what follows.

        An example is tanh((t − 1) / 0.001) at t = 0.
        """
        return any(
            series.start.operation in (ca.OP_EXP, ca.OP_TANH)
            # x^a has the divisor x, and exp(y log x) has none.
            or (series.start.operation == ca.OP_POW and series.rule.divisor is None)
            for series in self.series
            if isinstance(series.rule, Recurrence)
        )

    def products(self, order: int) -> int:
        """About how many products the coefficients up to an order take."""
        sums = sum(len(series.rule.sums) for series in self.series if isinstance(series.rule, Recurrence))
        return sums * order * (order + 1) // 2
