"""Polynomials with exact coefficients in symbols, sines, cosines and roots, always in reduced form.

The squares of sines, of roots and of the scalar part of quaternions are replaced by the polynomials that they equal. So
terms cancel without a search for identities.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

from mbd_sim.errors import MbdSimError

Monomial = tuple[tuple[int, int], ...]  # (generator, exponent), by generator
Polynomial = dict[Monomial, Fraction]

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
        self.squares[number] = square
        return {((number, 1),): Fraction(1)}

    def sine_cosine(self, argument: Any, sine: Any, cosine: Any) -> tuple[Polynomial, Polynomial]:
        """The sine and the cosine of an argument."""
        s, c = self.generator(sine), self.generator(cosine)
        if s not in self.angles:
            self.arguments.append(argument)
            self.angles[s], self.angles[c] = ("sin", len(self.arguments) - 1), ("cos", len(self.arguments) - 1)
            self.squares[s] = {(): Fraction(1), ((c, 2),): Fraction(-1)}
        return {((s, 1),): Fraction(1)}, {((c, 1),): Fraction(1)}

    def add(self, p: Polynomial, q: Polynomial, factor: int = 1) -> Polynomial:
        """p + factor · q."""
        total = dict(p)
        for monomial, value in q.items():
            _accumulate(total, monomial, factor * value)
        return total

    def scaled(self, p: Polynomial, factor: Fraction | int) -> Polynomial:
        """factor · p."""
        return {monomial: factor * value for monomial, value in p.items()} if factor else {}

    def multiply(self, p: Polynomial, q: Polynomial) -> Polynomial:
        """p · q, reduced.

        :raises TooLargeError: the products so far have had too many terms.
        """
        self.products += len(p) * len(q)
        if self.products > MAX_PRODUCTS:
            raise TooLargeError(f"their derivation takes more than {MAX_PRODUCTS} products")
        total: Polynomial = {}
        for first, a in p.items():
            for second, b in q.items():
                for monomial, value in self._reduced(_product(first, second)):
                    _accumulate(total, monomial, a * b * value)
        return total

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

    def _reduced(self, monomial: Monomial) -> Iterator[tuple[Monomial, Fraction]]:
        for index, (number, exponent) in enumerate(monomial):
            if exponent >= 2 and number in self.squares:
                left = ((number, exponent - 2),) if exponent > 2 else ()
                rest = {monomial[:index] + left + monomial[index + 1 :]: Fraction(1)}
                yield from self.multiply(rest, self.squares[number]).items()
                return
        yield monomial, Fraction(1)


def _product(first: Monomial, second: Monomial) -> Monomial:
    exponents = dict(first)
    for number, exponent in second:
        exponents[number] = exponents.get(number, 0) + exponent
    return tuple(sorted(item for item in exponents.items() if item[1]))


def _accumulate(total: Polynomial, monomial: Monomial, value: Fraction) -> None:
    value += total.get(monomial, 0)
    if value:
        total[monomial] = value
    else:
        total.pop(monomial, None)
