"""The exact numbers for which floating-point numbers stand: 1/3, √3/2, 1/(100 π)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

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

    ratio = sp.Rational(number.ratio.numerator, number.ratio.denominator)
    return ratio * sp.sqrt(number.radicand) * sp.pi**number.pi


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
