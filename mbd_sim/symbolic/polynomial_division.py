"""Quotients of reduced polynomials, to cancel roots in denominators."""

from __future__ import annotations

from fractions import Fraction
from itertools import product

from mbd_sim.symbolic.polynomial import Algebra, Monomial, Polynomial

MAX_UNKNOWNS = 60  # coefficients of a quotient


def without_denominators(algebra: Algebra, p: Polynomial) -> Polynomial:
    """Write A/s = C s and A/s² = C in a polynomial for each root s whose square divides A, where A = C s²."""
    for number, square in list(algebra.squares.items()):
        plain = algebra.expressions[number].is_Symbol or algebra.expressions[number].is_number
        if not plain and number not in algebra.angles and any(dict(m).get(number, 0) < 0 for m in p):
            parts: list[Polynomial] = [{}, {}]
            for monomial, value in p.items():
                parts[dict(monomial).get(number, 0) % 2][monomial] = value
            even, odd = (_shortened(algebra, part, number, square) for part in parts)
            p = algebra.add(even, odd)
    return p


def quotient(algebra: Algebra, p: Polynomial, divisor: Polynomial) -> Polynomial | None:
    """The polynomial whose product with `divisor` is p, or None if there is none; both are in reduced form."""
    variables = sorted({number for monomial in divisor for number, _ in monomial})
    groups: dict[Monomial, Polynomial] = {}
    for monomial, value in p.items():
        own = tuple(item for item in monomial if item[0] in variables)
        rest = tuple(item for item in monomial if item[0] not in variables)
        groups.setdefault(rest, {})[own] = value
    total: Polynomial = {}
    for rest, part in groups.items():
        found = _solved(algebra, part, divisor, variables)
        if found is None:
            return None
        total = algebra.add(total, algebra.multiply({rest: Fraction(1)}, found))
    return total


def _shortened(algebra: Algebra, p: Polynomial, number: int, square: Polynomial) -> Polynomial:
    """A polynomial with only even or only odd powers of the root `number`, over the lowest possible power of it."""
    power = -min((dict(monomial).get(number, 0) for monomial in p), default=0)
    if power <= 0:
        return p
    above, divided = algebra.multiply(p, {((number, power),): Fraction(1)}), False
    while power > 0 and (found := quotient(algebra, above, square)) is not None:
        above, power, divided = found, power - 2, True
    return algebra.multiply(above, {((number, -power),): Fraction(1)} if power else {(): Fraction(1)}) if divided else p


def _solved(algebra: Algebra, p: Polynomial, divisor: Polynomial, variables: list[int]) -> Polynomial | None:
    """The quotient, by linear equations for its coefficients: long division would not end in reduced form."""
    degree = _degree(p) - _degree(divisor)
    if degree < 0 or any(exponent < 0 for monomial in p for _, exponent in monomial):
        return None
    highest = [1 if number in algebra.squares else degree for number in variables]
    unknown: list[Monomial] = [
        tuple((number, k) for number, k in zip(variables, exponents, strict=True) if k)
        for exponents in product(*(range(min(high, degree) + 1) for high in highest))
        if sum(exponents) <= degree
    ]
    if len(unknown) > MAX_UNKNOWNS:
        return None
    equations: dict[Monomial, dict[int, Fraction]] = {monomial: {-1: value} for monomial, value in p.items()}
    for column, monomial in enumerate(unknown):
        for key, value in algebra.multiply({monomial: Fraction(1)}, divisor).items():
            equations.setdefault(key, {})[column] = value
    values = _eliminated(list(equations.values()))
    return None if values is None else {unknown[column]: value for column, value in values.items() if value}


def _eliminated(rows: list[dict[int, Fraction]]) -> dict[int, Fraction] | None:
    """The solution of sparse equations Σ row[k] x_k = row[-1], or None if they contradict each other."""
    pivots: dict[int, dict[int, Fraction]] = {}
    for row in rows:
        left = dict(row)
        while column := max((k for k in left if k in pivots), default=-1) + 1:
            _subtract(left, pivots[column - 1], left[column - 1])
        column = max(left, default=-1)
        if column >= 0:
            pivots[column] = {k: value / left[column] for k, value in left.items()}
        elif left:
            return None
    values: dict[int, Fraction] = {}
    for column in sorted(pivots):
        row = pivots[column]
        lower = (value * values.get(k, Fraction(0)) for k, value in row.items() if 0 <= k < column)
        values[column] = row.get(-1, Fraction(0)) - sum(lower, Fraction(0))
    return values


def _subtract(row: dict[int, Fraction], other: dict[int, Fraction], factor: Fraction) -> None:
    for k, value in other.items():
        changed = row.get(k, Fraction(0)) - factor * value
        if changed:
            row[k] = changed
        else:
            row.pop(k, None)


def _degree(p: Polynomial) -> int:
    return max((sum(exponent for _, exponent in monomial) for monomial in p), default=0)
