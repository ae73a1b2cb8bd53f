"""Polynomials with exact coefficients in symbols, sines, cosines and roots, always in reduced form.

The squares of sines, of roots and of the scalar part of quaternions are replaced by the polynomials that they equal. So
terms cancel without a search for identities. Quotients of reduced polynomials serve to cancel roots in denominators.

The coefficients are the exact numbers for which floating-point numbers stand: 1/3, √3/2, 1/(100 π).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from fractions import Fraction
from itertools import product
from math import lcm
from typing import Any

from mbd_sim.base.errors import MbdSimError
from mbd_sim.mechanism.mechanism import Mechanism

Monomial = tuple[tuple[int, int], ...]  # (generator, exponent), by generator
Polynomial = dict[Monomial, Fraction]
_Terms = tuple[tuple[Monomial, int | Fraction], ...]

MAX_PRODUCTS = 200_000  # products of two terms in one derivation; more would take minutes and fill pages


class TooLargeError(MbdSimError):
    """Formulas that are too long to be read."""


@dataclass
class Algebra:
    """The generators of the polynomials: the SymPy expression of each one, and the polynomial of its square if known.

    `angles` has for each sine and cosine its kind, and the number of its argument in `arguments`. `positive` are
    generators with positive values. `products` counts the products of two terms.
    """

    expressions: list[Any] = field(default_factory=list)
    squares: dict[int, Polynomial] = field(default_factory=dict)
    angles: dict[int, tuple[str, int]] = field(default_factory=dict)
    arguments: list[Any] = field(default_factory=list)
    positive: set[int] = field(default_factory=set)
    products: int = 0
    _known: dict[Any, int] = field(default_factory=dict)
    _reductions: dict[Monomial, tuple[_Terms, int]] = field(default_factory=dict, repr=False)

    def generator(self, expression: Any) -> int:
        """The number of the generator for an expression."""
        if expression not in self._known:
            self._known[expression] = len(self.expressions)
            self.expressions.append(expression)
        return self._known[expression]

    def symbol(self, expression: Any) -> Polynomial:
        """The polynomial of one generator for an expression."""
        return {((self.generator(expression), 1),): Fraction(1)}

    def root(self, expression: Any, square: Polynomial) -> Polynomial:
        """The polynomial of one generator for an expression whose square is a polynomial."""
        number = self.generator(expression)
        self.define_square(number, square)
        return {((number, 1),): Fraction(1)}

    def define_square(self, number: int, square: Polynomial) -> None:
        """Replace the square of a generator by a polynomial, from now on."""
        if self.squares.get(number) != square:
            self.squares[number] = square
            self._reductions.clear()

    def sine_cosine(self, argument: Any, sine: Any, cosine: Any) -> tuple[Polynomial, Polynomial]:
        """The sine and the cosine of an argument."""
        s, c = self.generator(sine), self.generator(cosine)
        if s not in self.angles:
            self.arguments.append(argument)
            self.angles[s], self.angles[c] = ("sin", len(self.arguments) - 1), ("cos", len(self.arguments) - 1)
            self.define_square(s, {(): Fraction(1), ((c, 2),): Fraction(-1)})
        return {((s, 1),): Fraction(1)}, {((c, 1),): Fraction(1)}

    def add(self, p: Polynomial, q: Polynomial, factor: int = 1) -> Polynomial:
        """p + factor · q."""
        total = dict(p)
        for monomial, value in q.items() if factor == 1 else self.scaled(q, factor).items():
            _accumulate(total, monomial, value)
        return total

    def scaled(self, p: Polynomial, factor: Fraction | int) -> Polynomial:
        """factor · p."""
        if factor == -1:
            return {monomial: -value for monomial, value in p.items()}
        return {monomial: factor * value for monomial, value in p.items()} if factor else {}

    def multiply(self, p: Polynomial, q: Polynomial) -> Polynomial:
        """p · q, reduced.

        :raises TooLargeError: the products so far have had too many terms.
        """
        self._count(len(p) * len(q))
        (first_terms, first_divisor), (second_terms, second_divisor) = _whole(p), _whole(q)
        total: dict[Monomial, int | Fraction] = {}
        for first, a in first_terms:
            for second, b in second_terms:
                for monomial, value in self._product(first, second):
                    _accumulate(total, monomial, a * b * value)
        divisor = first_divisor * second_divisor
        return {monomial: Fraction(value, divisor) for monomial, value in total.items()}

    def power(self, p: Polynomial, exponent: int) -> Polynomial:
        """p to an integer power, not negative."""
        result: Polynomial = {(): Fraction(1)}
        for _ in range(exponent):
            result = self.multiply(result, p)
        return result

    def inverse(self, p: Polynomial, expression: Callable[[Polynomial], Any]) -> Polynomial:
        """1/p; a sum of several terms becomes a generator, whose expression is that of p."""
        if len(p) == 1:
            ((monomial, value),) = p.items()
            return {tuple((number, -exponent) for number, exponent in monomial): 1 / value}
        return {((self.generator(expression(p)), -1),): Fraction(1)}

    def _product(self, first: Monomial, second: Monomial) -> _Terms:
        """The product of two monomials, reduced."""
        exponents = dict(first)
        for number, exponent in second:
            exponents[number] = exponents.get(number, 0) + exponent
        monomial = tuple(sorted([item for item in exponents.items() if item[1]]))
        for number, exponent in monomial:
            if exponent >= 2 and number in self.squares:
                return self._reduced(monomial)
        return ((monomial, 1),)

    def _reduced(self, monomial: Monomial) -> _Terms:
        """The terms of a monomial in reduced form; one that recurs is reduced once, but counts each time."""
        if monomial not in self._reductions:
            before = self.products
            index = next(i for i, (number, exponent) in enumerate(monomial) if exponent >= 2 and number in self.squares)
            number, exponent = monomial[index]
            left = ((number, exponent - 2),) if exponent > 2 else ()
            rest = {monomial[:index] + left + monomial[index + 1 :]: Fraction(1)}
            terms = self.multiply(rest, self.squares[number]).items()
            whole = tuple((key, int(value) if value.denominator == 1 else value) for key, value in terms)
            self._reductions[monomial] = whole, self.products - before
            return whole
        known, products = self._reductions[monomial]
        self._count(products)
        return known

    def _count(self, products: int) -> None:
        self.products += products
        if self.products > MAX_PRODUCTS:
            raise TooLargeError(f"their derivation takes more than {MAX_PRODUCTS} products")


def _whole(p: Polynomial) -> tuple[list[tuple[Monomial, int]], int]:
    """The numerators of the coefficients over their common denominator, since integers are faster than fractions."""
    divisor = lcm(*(value.denominator for value in p.values()))
    return [(monomial, value.numerator * (divisor // value.denominator)) for monomial, value in p.items()], divisor


def _accumulate(total: dict[Monomial, Any], monomial: Monomial, value: Any) -> None:
    if (before := total.get(monomial)) is not None:
        value = before + value
    if value:
        total[monomial] = value
    elif before is not None:
        del total[monomial]


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


TOLERANCE = 1e-12  # relative
LARGEST_DENOMINATOR = 1000
LARGEST_SCALED = 99  # denominator of a number between 1 and 10
LARGEST_SEARCHED = 10**6  # denominator of a fraction that agrees to rounding
ROUNDING = 1e-15  # relative
LARGEST_RADICAND = 10**6


@dataclass(frozen=True)
class Exact:
    """`ratio` · √`radicand` · π^`pi`."""

    ratio: Fraction
    radicand: int = 1
    pi: int = 0

    def __float__(self) -> float:
        return float(self.ratio) * math.sqrt(self.radicand) * math.pi**self.pi


def exact(value: float, tolerance: float = TOLERANCE) -> Exact:
    """The simplest exact number within a relative tolerance of a value: a fraction, a root, a multiple of π or 1/π.

    If there is none, a longer fraction that agrees to rounding, or its decimals.
    """
    found = _fraction(value, tolerance)
    if found is not None:
        return Exact(found)
    square = _fraction(value * value, tolerance)
    if square is not None and square.numerator * square.denominator < LARGEST_RADICAND:
        # √(p/q) = √(p q)/q, with square factors extracted
        outside, radicand = _square_free(square.numerator * square.denominator)
        return Exact(Fraction(math.copysign(1, value)) * Fraction(outside, square.denominator), radicand)
    for power in (1, -1):
        found = _fraction(value / math.pi**power, tolerance)
        if found is not None:
            return Exact(found, 1, power)
    near = Fraction(value).limit_denominator(LARGEST_SEARCHED)
    if abs(float(near) - value) <= ROUNDING * abs(value):
        return Exact(near)
    return Exact(Fraction(repr(value) if tolerance <= TOLERANCE else f"{value:.11g}"))


def in_sympy(number: Exact) -> Any:
    """An exact number in SymPy."""
    import sympy as sp

    return sp.Rational(number.ratio) * sp.sqrt(number.radicand) * sp.pi**number.pi


def _fraction(value: float, tolerance: float) -> Fraction | None:
    """A fraction with a small denominator, perhaps times a power of ten, or with few decimals; or None."""
    ten = Fraction(10) ** int(f"{value:e}".partition("e")[2])
    nearest = (
        Fraction(value).limit_denominator(LARGEST_DENOMINATOR),
        Fraction(f"{value:.6g}"),
        (Fraction(value) / ten).limit_denominator(LARGEST_SCALED) * ten,
    )
    for near in nearest:
        if abs(float(near) - value) <= tolerance * abs(value):
            return near
    return None


def _square_free(number: int) -> tuple[int, int]:
    """(a, b) with a² b = `number`, where b has no square factor."""
    outside, divisor = 1, 2
    while divisor * divisor <= number:
        while number % (divisor * divisor) == 0:
            number //= divisor * divisor
            outside *= divisor
        divisor += 1
    return outside, number


MAX_INSTRUCTIONS = 20_000
MAX_TERMS = 200  # of one entry before simplification
MAX_OPERATIONS = 400  # of one entry after simplification
MAX_TOTAL_OPERATIONS = 1500  # of all entries after simplification


def too_large(mechanism: Mechanism, why: str) -> MbdSimError:
    """The error that equations are too long."""
    return MbdSimError(
        f"{mechanism.name}: the equations of motion are too long to read: {why}",
        "Use a smaller mechanism, or make some of its joints fixed or driven.",
    )
