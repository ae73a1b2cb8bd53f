"""Polynomials with exact coefficients in symbols, sines, cosines and roots, always in reduced form.

The squares of sines, of roots and of the scalar part of quaternions are replaced by the polynomials that they equal. So
terms cancel without a search for identities.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from fractions import Fraction
from math import lcm
from typing import Any

from mbd_sim.errors import MbdSimError

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
