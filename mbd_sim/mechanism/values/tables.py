"""Tables that expressions read by name: functions of one or two variables through given points.

Both are cubic between the points, with the slopes of Fritsch and Butland (PCHIP), and linear beyond them. The value and
its slopes are continuous everywhere.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.linear_algebra import product

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Curve:
    """A function of x with these `values` at these increasing `x`; with a `period` it repeats itself.

    The values at both ends of a period are equal.
    """

    x: tuple[float, ...]
    values: tuple[float, ...]
    period: float | None = None
    dimension = 1

    @cached_property
    def pieces(self) -> Piecewise:
        """The function as cubic pieces; of a periodic one, those of one period and the next points on both sides."""
        if self.period is None:
            return tabulated(self.x, self.values)
        before, after = [x - self.period for x in self.x[:-1]], [x + self.period for x in self.x[1:]]
        return tabulated([*before, *self.x, *after], [*self.values[:-1], *self.values, *self.values[1:]])

    def at(self, x: float) -> float:
        """The value at x."""
        if self.period is not None:
            x = x - self.period * math.floor((x - self.x[0]) / self.period)
        pieces = self.pieces
        piece = int(np.searchsorted(pieces.knots, x, side="right"))
        d, (c0, c1, c2, c3) = x - float(pieces.origins[piece]), pieces.coefficients[piece].tolist()
        return float(c0 + d * (c1 + d * (c2 + d * c3)))


@dataclass(frozen=True)
class BicubicSurface:
    """A function of x and y with `values[i][j]` at `x[i]` and `y[j]`, both increasing.

    Between the points it is bicubic: Hermite polynomials in x and y through the values, with slopes along each row and
    each column as those of a `Curve`, and the slopes of these slopes.
    """

    x: tuple[float, ...]
    y: tuple[float, ...]
    values: tuple[tuple[float, ...], ...]
    dimension = 2

    @cached_property
    def nodes(self) -> Floats:
        """The value, the slopes in x and y, and the mixed derivative at each point, as (2 nx, 2 ny).

        Entry (2 i + a, 2 j + b) is the derivative of order a in x and b in y at point (i, j).
        """
        x, y, f = np.array(self.x), np.array(self.y), np.array(self.values)
        by_x = np.column_stack([slopes_of(x, column) for column in f.T])
        by_y = np.array([slopes_of(y, row) for row in f])
        mixed = np.array([slopes_of(y, row) for row in by_x])
        found = np.empty((2 * len(x), 2 * len(y)))
        found[::2, ::2], found[1::2, ::2], found[::2, 1::2], found[1::2, 1::2] = f, by_x, by_y, mixed
        return found

    def at(self, x: float, y: float) -> float:
        """The value at (x, y)."""
        i, along_x = _weights(self.x, x)
        j, along_y = _weights(self.y, y)
        return float(
            product(product(np.array(along_x), self.nodes[2 * i : 2 * i + 4, 2 * j : 2 * j + 4]), np.array(along_y))
        )


Table = Curve | BicubicSurface


def hermite(d: Any, width: Any) -> tuple[Any, Any, Any, Any]:
    """The weights of the value and the slope at the left end of an interval, and of those at its right end."""
    s = d / width
    right = s * s * (3.0 - 2.0 * s)
    return 1.0 - right, d * (1.0 - s) ** 2, right, d * s * (s - 1.0)


def _weights(knots: Sequence[float], x: float) -> tuple[int, tuple[float, float, float, float]]:
    """The interval of x, and the weights at its ends; beyond all knots, those of a straight line."""
    if x < knots[0]:
        return 0, (1.0, x - knots[0], 0.0, 0.0)
    if x >= knots[-1]:
        return len(knots) - 2, (0.0, 0.0, 1.0, x - knots[-1])
    i = int(np.searchsorted(np.array(knots), x, side="right")) - 1
    return i, hermite(x - knots[i], knots[i + 1] - knots[i])


@dataclass(frozen=True, eq=False)
class Piecewise:
    """f(x) by cubic pieces: the first of `coefficients` (n + 1, 4) is left of all `knots` (n,), the last right of them.

    Piece i is c0 + c1 d + c2 d² + c3 d³ with d = x - `origins[i]`, and `energies[i]` is its potential at d = 0.
    """

    knots: NDArray[np.float64]
    origins: NDArray[np.float64]
    coefficients: NDArray[np.float64]
    energies: NDArray[np.float64]


def tabulated(elongations: Sequence[float], forces: Sequence[float]) -> Piecewise:
    """A table as a force with a continuous derivative: cubic between its points, linear beyond them.

    The slopes are those of Fritsch and Butland (PCHIP): the force rises and falls only where the table does. The
    potential, zero at x = 0, is the integral of the pieces and therefore exact to rounding.

    :param elongations: (n,) at least two, increasing.
    :param forces: (n,) N or N·m.
    """
    x, f = np.array(elongations, dtype=np.float64), np.array(forces, dtype=np.float64)
    h, slopes = np.diff(x), slopes_of(x, f)
    secants = np.diff(f) / h
    inner = np.column_stack(
        [
            f[:-1],
            slopes[:-1],
            (3.0 * secants - 2.0 * slopes[:-1] - slopes[1:]) / h,
            (slopes[:-1] + slopes[1:] - 2.0 * secants) / h**2,
        ]
    )
    ends = [[f[0], slopes[0], 0.0, 0.0], [f[-1], slopes[-1], 0.0, 0.0]]
    coefficients = np.vstack([ends[0], inner, ends[1]])
    origins = np.concatenate([x[:1], x])
    gains = [_integral(c, width) for c, width in zip(inner, h, strict=True)]
    energies = np.cumsum([0.0, 0.0, *gains])
    piece = int(np.searchsorted(x, 0.0, side="right"))
    at_zero = energies[piece] + _integral(coefficients[piece], -origins[piece])
    return Piecewise(x, origins, coefficients, energies - at_zero)


def _integral(coefficients: NDArray[np.float64], d: float) -> float:
    c0, c1, c2, c3 = (float(c) for c in coefficients)
    return d * (c0 + d * (c1 / 2.0 + d * (c2 / 3.0 + d * c3 / 4.0)))


def slopes_of(x: NDArray[np.float64], f: NDArray[np.float64]) -> NDArray[np.float64]:
    """The derivatives (n,) at the points: weighted harmonic means of the secant slopes, 0 where these change sign."""
    h, secants = np.diff(x), np.diff(f) / np.diff(x)
    if len(x) == 2:
        return np.array([secants[0], secants[0]])
    slopes = np.zeros(len(x))
    for i in range(1, len(x) - 1):
        before, after = secants[i - 1], secants[i]
        if before * after > 0.0:
            left, right = 2.0 * h[i] + h[i - 1], h[i] + 2.0 * h[i - 1]
            slopes[i] = (left + right) / (left / before + right / after)
    slopes[0] = _end_slope(h[0], h[1], secants[0], secants[1])
    slopes[-1] = _end_slope(h[-1], h[-2], secants[-1], secants[-2])
    return slopes


def _end_slope(near: float, far: float, secant: float, next_secant: float) -> float:
    """Three-point formula at an end, limited so that the force stays monotone (Fritsch & Carlson 1980)."""
    slope = ((2.0 * near + far) * secant - near * next_secant) / (near + far)
    if slope * secant <= 0.0:
        return 0.0
    if secant * next_secant <= 0.0 and abs(slope) > 3.0 * abs(secant):
        return 3.0 * secant
    return slope
