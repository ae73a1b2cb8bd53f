"""Functions and constants that are rounded once, and so have the same bits on every machine.

C libraries, and NumPy with each set of instructions, differ in the last digit.
"""

from __future__ import annotations

import functools
import math
from decimal import Decimal, localcontext

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

BITS = 160  # behind the binary point
HALF_PI = 0x1921FB54442D18469898CC51701B839A252049C1114CF98E8  # times 2**192
TINY = 2.0**-28  # rad, below which the next terms of the series round to nothing
LARGEST = 1e9  # rad; the quarter turns of a larger angle are lost in the digits of π/2


def sine_cosine(angle: float) -> tuple[float, float]:
    """The sine and the cosine of an angle in rad, up to a billion; beyond, those of the C library."""
    angle = float(angle)
    if not abs(angle) <= LARGEST:
        return math.sin(angle), math.cos(angle)
    if abs(angle) < TINY:
        return angle, 1.0
    numerator, denominator = angle.as_integer_ratio()
    turned = (numerator << 192) // denominator
    quarters = (2 * turned + HALF_PI) // (2 * HALF_PI)
    rest = (turned - quarters * HALF_PI) >> (192 - BITS)
    pair = _series(rest, rest, 2), _series(1 << BITS, rest, 1)
    for _ in range(quarters % 4):
        pair = pair[1], -pair[0]
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


def _legendre(count: int, x: Decimal) -> tuple[Decimal, Decimal]:
    """The Legendre polynomial of a degree, and its derivative."""
    before, value = Decimal(1), x
    for degree in range(2, count + 1):
        before, value = value, ((2 * degree - 1) * x * value - (degree - 1) * before) / degree
    return value, count * (x * value - before) / (x * x - 1)
