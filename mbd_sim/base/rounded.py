"""Functions and constants that are rounded once, and so have the same bits on every machine.

C libraries, and NumPy with each set of instructions, differ in the last digit.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from decimal import Context, Decimal, localcontext
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

BITS = 160  # behind the binary point
HALF_PI = 0x1921FB54442D18469898CC51701B839A252049C1114CF98E8  # times 2**192
TINY = 2.0**-28  # rad, below which the next terms of the series round to nothing
LARGEST = 1e9  # rad; the quarter turns of a larger angle are lost in the digits of π/2
MOST_FACTORS = 64  # of a power that is multiplied out
SATURATED = 20.0  # from which on a hyperbolic tangent rounds to 1
DIGITS = Context(prec=50)


def sine_cosine(angle: float) -> tuple[float, float]:
    """The sine and the cosine of an angle in rad, up to a billion; beyond, those of the C library."""
    angle = float(angle)
    if not abs(angle) <= LARGEST:
        return math.sin(angle), math.cos(angle)
    if abs(angle) < TINY:
        return angle, 1.0
    pair = _sine_cosine(angle)
    return pair[0] / (1 << BITS), pair[1] / (1 << BITS)


def sine(angle: float) -> float:
    """The sine of an angle in rad."""
    return sine_cosine(angle)[0]


def cosine(angle: float) -> float:
    """The cosine of an angle in rad."""
    return sine_cosine(angle)[1]


def sines_cosines(angles: Array) -> tuple[Array, Array]:
    """The sines and cosines (n,) of angles (n,) in rad."""
    pairs = np.array([sine_cosine(angle) for angle in angles.tolist()]).reshape(-1, 2)
    return pairs[:, 0], pairs[:, 1]


def tangent(angle: float) -> float:
    """The tangent of an angle in rad, up to a billion; beyond, that of the C library."""
    if abs(angle) < TINY:
        return float(angle)
    if not abs(angle) <= LARGEST:
        return math.tan(angle)
    sine, cosine = _sine_cosine(float(angle))
    return sine / cosine


def arc_tangent(y: float, x: float = 1.0) -> float:
    """The angle in rad of the point x, y, from -π to π."""
    y, x = float(y), float(x)
    near = math.atan2(y, x)
    if not (x and y and math.isfinite(x) and math.isfinite(y)):
        return near
    if abs(near) < TINY:
        ratio = Fraction(y) / Fraction(x)
        return float(ratio - ratio**3 / 3)
    sine, cosine = _sine_cosine(near)
    x_exact, y_exact = Fraction(x), Fraction(y)
    return float(Fraction(near) + (y_exact * cosine - x_exact * sine) / (x_exact * cosine + y_exact * sine))


def arc_sine(sine: float) -> float:
    """The angle in rad, from -π/2 to π/2, of a sine.

    :raises ValueError: it is not between -1 and 1.
    """
    sine = float(sine)
    near = math.asin(sine)
    if abs(sine) < TINY:
        return float(sine)
    if abs(sine) == 1.0 or math.isnan(near):
        return near
    found, slope = _sine_cosine(near)
    return float(Fraction(near) + (Fraction(sine) * (1 << BITS) - found) / slope)


def arc_cosine(cosine: float) -> float:
    """The angle in rad, from 0 to π, of a cosine.

    :raises ValueError: it is not between -1 and 1.
    """
    cosine = float(cosine)
    near = math.acos(cosine)
    if abs(cosine) == 1.0 or math.isnan(near):
        return near
    slope, found = _sine_cosine(near)
    return float(Fraction(near) + (found - Fraction(cosine) * (1 << BITS)) / slope)


def exponential(x: float) -> float:
    """e to the power of x.

    :raises OverflowError: it is too large.
    """
    x = float(x)
    near = math.exp(x)
    return float(DIGITS.exp(Decimal(x))) if math.isfinite(x) and near else near


def logarithm(x: float) -> float:
    """The natural logarithm.

    :raises ValueError: x is not positive.
    """
    x = float(x)
    near = math.log(x)
    return float(DIGITS.ln(Decimal(x))) if math.isfinite(near) else near


def hyperbolic_tangent(x: float) -> float:
    """The hyperbolic tangent."""
    x = float(x)
    if abs(x) < TINY or math.isnan(x):
        return float(x)
    if abs(x) > SATURATED:
        return math.copysign(1.0, x)
    grown = DIGITS.exp(Decimal(2.0 * x))
    return float(DIGITS.divide(DIGITS.subtract(grown, Decimal(1)), DIGITS.add(grown, Decimal(1))))


def power(base: float, exponent: float) -> float:
    """`base` to the power of `exponent`.

    :raises ValueError: the base is negative and the exponent not whole, or the base is zero and the exponent negative.
    :raises OverflowError: it is too large.
    """
    base, exponent = float(base), float(exponent)
    near = math.pow(base, exponent)
    if not near or not math.isfinite(near) or not math.isfinite(exponent):
        return near
    if exponent == round(exponent) and abs(exponent) <= MOST_FACTORS:
        return float(Fraction(base) ** int(exponent))
    return float(DIGITS.power(Decimal(base), Decimal(exponent)))


def hypotenuse(x: float, y: float) -> float:
    """√(x² + y²)."""
    x, y = float(x), float(y)
    near = math.hypot(x, y)
    if not math.isfinite(near):
        return near
    squares = (DIGITS.multiply(each, each) for each in (Decimal(x), Decimal(y)))
    return float(DIGITS.sqrt(DIGITS.add(*squares)))


@functools.lru_cache(maxsize=4096)  # outlines ask twice for each of thousands of angles
def _sine_cosine(angle: float) -> tuple[int, int]:
    """The sine and the cosine of an angle in rad, times 2**BITS."""
    numerator, denominator = angle.as_integer_ratio()
    turned = (numerator << 192) // denominator
    quarters = (2 * turned + HALF_PI) // (2 * HALF_PI)
    rest = (turned - quarters * HALF_PI) >> (192 - BITS)
    pair = _series(rest, rest, 2), _series(1 << BITS, rest, 1)
    for _ in range(quarters % 4):
        pair = pair[1], -pair[0]
    return pair


def _series(first: int, angle: int, divisor: int) -> int:
    """A term with those after it: each is the one before times -angle² / (divisor (divisor + 1)), and so on."""
    square, found, term = (angle * angle) >> BITS, first, first
    while term:
        term = -((term * square) >> BITS) // (divisor * (divisor + 1))
        if term == -1:  # rounded down for ever
            break
        found += term
        divisor += 2
    return found


@functools.cache
def gauss_legendre(count: int) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """The nodes from -1 to 1, in their order, and the weights of Gauss–Legendre quadrature."""
    nodes, weights = list[float](), list[float]()
    with localcontext() as context:
        context.prec = 40
        for index in range(count, 0, -1):
            x = Decimal(math.cos(math.pi * (index - 0.25) / (count + 0.5)))
            for _ in range(6):  # Newton's method doubles the digits each time
                value, slope = _legendre(count, x)
                x -= value / slope
            _, slope = _legendre(count, x)
            if 2 * index == count + 1:
                x = Decimal(0)
            nodes.append(float(x))
            weights.append(float(2 / ((1 - x * x) * slope * slope)))
    return tuple(nodes), tuple(weights)


@functools.cache
def radau(count: int) -> tuple[tuple[float, ...], tuple[tuple[float, ...], ...]]:
    """The nodes c of the Radau IIA method in (0, 1], and its coefficients a: ∫₀^cᵢ of the Lagrange polynomial of cⱼ."""
    nodes, rows = list[Decimal](), list[tuple[float, ...]]()
    with localcontext() as context:
        context.prec = 40
        for index in range(count - 1, 0, -1):
            x = Decimal(math.cos(math.pi * (index + 0.25) / count))
            for _ in range(6):  # Newton's method doubles the digits each time
                (value, slope), (last_value, last_slope) = _legendre(count, x), _legendre(count - 1, x)
                x -= (value - last_value) / (slope - last_slope)
            nodes.append((1 + x) / 2)
        nodes.append(Decimal(1))
        polynomials = [_lagrange(nodes, index) for index in range(count)]
        for node in nodes:
            terms = ([part * node ** (k + 1) / (k + 1) for k, part in enumerate(each)] for each in polynomials)
            rows.append(tuple(float(sum(each, Decimal(0))) for each in terms))
    return tuple(map(float, nodes)), tuple(rows)


def _lagrange(nodes: Sequence[Decimal], index: int) -> list[Decimal]:
    """The coefficients of the polynomial that is 1 at one node and 0 at all others, that of x⁰ first."""
    found = [Decimal(1)]
    for other, node in enumerate(nodes):
        if other != index:
            size = nodes[index] - node
            found = [(a - node * b) / size for a, b in zip([Decimal(0), *found], [*found, Decimal(0)], strict=True)]
    return found


def _legendre(count: int, x: Decimal) -> tuple[Decimal, Decimal]:
    """The Legendre polynomial of a degree, and its derivative."""
    before, value = Decimal(1), x
    for degree in range(2, count + 1):
        before, value = value, ((2 * degree - 1) * x * value - (degree - 1) * before) / degree
    return value, count * (x * value - before) / (x * x - 1)
