"""Products of sums in the form whose numbers are shortest."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from mbd_sim.studies.symbolic.algebra.names import exact_number

ROUNDED = 1000  # characters that a rounded number counts as


def shortest_numbers(forms: Sequence[Any]) -> Any:
    """Of equal expressions, the one whose numbers are shortest when they are written; the first of several.

    For each, the form with factors whose leading coefficients are 1 is considered as well: 2 (l² m + 0.01) in place of
    0.02 (100 l² m + 1).
    """
    candidates = [form for given in forms for form in (given, _with_leading_ones(given))]
    return min(candidates, key=_size)


def _with_leading_ones(expression: Any) -> Any:
    import sympy as sp

    number, factors = sp.S.One, []
    for factor in sp.Mul.make_args(expression):
        base, exponent = factor.as_base_exp()
        if base.is_Add and exponent.is_Integer:
            lead = max(base.args, key=lambda term: (term.as_coeff_Mul()[1].count_ops(), sp.default_sort_key(term)))
            coefficient = lead.as_coeff_Mul()[0]
            number *= coefficient**exponent
            factor = sp.Add(*(term / coefficient for term in base.args)) ** exponent
        factors.append(factor)
    return sp.Mul(number, *factors, evaluate=False) if number != 1 else sp.Mul(*factors)


def _size(expression: Any) -> int:
    """The characters of all numbers, and of what is repeated in sums."""
    import sympy as sp

    total = 0
    for node in sp.preorder_traversal(expression):
        if node.is_Rational and abs(node) != 1:
            total += len(exact_number(int(node.p), int(node.q)).removeprefix(r"\tfrac")) or ROUNDED
    return total + int(expression.count_ops())
