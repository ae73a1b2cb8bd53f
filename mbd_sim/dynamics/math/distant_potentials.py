"""Potentials of forces that are given by expressions, at elongations beyond the ends of their tables.

A compiled function contains a limited number of panels. Where these do not suffice, and the force does not repeat
itself, the rest of the integral is added in Python when energies are read, on cells that are added as the motion goes.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Callable
from threading import Lock

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.geometry.pose import Array
from mbd_sim.dynamics.math.expressions import evaluated
from mbd_sim.dynamics.math.piecewise import POINTS, PotentialTable, gauss_formula

INTERVAL_TOLERANCE = 2e-15  # of the integral over an interval, relative to that of the absolute value
MAX_HALVINGS = 50  # of a cell
MAX_PARTS = 256  # of each interval on average that are halved again; the integral of faster waves is nan
MAX_CELLS = 1_000_000  # on each side; the energy is nan beyond
CELLS_PER_END = 16  # the largest number of cells in the distance of an end from 0
CHUNK = 256  # cells added at once
BATCH = 512  # points at which f is evaluated at once
EXTRAPOLATION = 1e-8  # relative error to an end; a kink this close to it is no more than its square in the integral
AMPLIFICATION = 100.0  # an upper bound of that of rounding errors by this extrapolation

_NODES, _WEIGHTS = gauss_formula()
_NODES_AND_ENDS = np.array([*_NODES, 0.0, 1.0])
# The Lagrange polynomials of the nodes at 0; at 1 they are in reversed order.
_AT_START = [float(np.prod([other / (other - own) for other in _NODES if other != own])) for own in _NODES]


class DistantPotential:
    """∫ f from the nearer end of a table to x beyond it, in J; 0 between the ends.

    Its error is some 1e-14 of the integral of |f| from 0 to x. It depends on x alone, not on what was read before,
    and may be read by several threads.
    """

    def __init__(self, f: Callable[[ca.SX], ca.SX], table: PotentialTable) -> None:
        self._lower, self._upper = table.ends
        at = _BatchEvaluator(f)
        first, last = table.panels.origins[:2], table.panels.origins[-2:]
        self._below = _Cells(at, self._lower, -max(float(first[1] - first[0]), -self._lower / CELLS_PER_END))
        self._above = _Cells(at, self._upper, max(float(last[1] - last[0]), self._upper / CELLS_PER_END))
        self._lock = Lock()

    def __call__(self, x: float) -> float:
        """The integral to x in m or rad; nan beyond `MAX_CELLS` cells, and from where f changes too fast on."""
        if self._lower <= x <= self._upper:
            return 0.0
        with self._lock, np.errstate(all="ignore"):
            return (self._above if x > self._upper else self._below).integral(x)


class _Cells:
    """The integrals from `start` to the ends of cells of one (signed) `width`, as far as they have been read."""

    def __init__(self, at: Callable[[Array], Array], start: float, width: float) -> None:
        self._at, self._start, self._width = at, start, width
        self._integrals = array("d", [0.0])
        self._total = self._rest = 0.0  # of all cells, with the rounding error of the total (Neumaier)

    def integral(self, x: float) -> float:
        distance = (x - self._start) / self._width if self._width else np.inf
        if not distance < MAX_CELLS:
            return float("nan")
        cell = int(distance)
        while len(self._integrals) <= cell and not math.isnan(self._total):
            self._add_cells()
        if len(self._integrals) <= cell:
            return float("nan")
        begin = self._start + cell * self._width
        return self._integrals[cell] + float(_integrals(self._at, np.array([begin]), np.array([x]))[0])

    def _add_cells(self) -> None:
        first = len(self._integrals) - 1
        edges = np.array([self._start + cell * self._width for cell in range(first, first + CHUNK + 1)])
        for value in _integrals(self._at, edges[:-1], edges[1:]).tolist():
            total = self._total + value
            larger, smaller = (self._total, value) if abs(self._total) >= abs(value) else (value, self._total)
            self._rest += (larger - total) + smaller
            self._total = total
            self._integrals.append(total + self._rest)


class _BatchEvaluator:
    """f as a function of arrays of numbers. Each value depends on its own number alone, to the last bit."""

    def __init__(self, f: Callable[[ca.SX], ca.SX]) -> None:
        x = ca.SX.sym("x", BATCH)
        self._function = ca.Function("f", [x], [ca.densify(f(x))])

    def __call__(self, points: Array) -> Array:
        flat = points.ravel()
        values = np.empty(flat.size)
        for start in range(0, flat.size, BATCH):
            part = flat[start : start + BATCH]
            padded = np.concatenate([part, np.zeros(BATCH - part.size)])
            values[start : start + BATCH] = evaluated(self._function, padded)[: part.size, 0]
        return values.reshape(points.shape)


def _integrals(at: Callable[[Array], Array], starts: Array, stops: Array) -> Array:
    """The integrals (n,) from `starts` to `stops`; each interval is halved until that changes nothing twice."""
    unchanged, most = np.zeros(len(starts), dtype=bool), MAX_PARTS * len(starts)
    return _refined(at, starts, stops, _quadrature(at, starts, stops)[0], unchanged, most, MAX_HALVINGS)


def _refined(
    at: Callable[[Array], Array],
    starts: Array,
    stops: Array,
    whole: Array,
    unchanged: NDArray[np.bool_],
    most: int,
    halvings: int,
) -> Array:
    """Improve the integrals `whole`; for the `unchanged` intervals, the last halving changed nothing.

    At most `most` intervals are halved again, `halvings` times.
    """
    middles = 0.5 * (starts + stops)
    lower, lower_error = _quadrature(at, starts, middles)
    upper, upper_error = _quadrature(at, middles, stops)
    result = lower + upper
    rough = np.abs(whole - result) > lower_error + upper_error
    again = rough | ~unchanged
    if np.count_nonzero(again) > most:
        result[rough] = np.nan
    elif halvings and np.any(again):
        begins = np.concatenate([starts[again], middles[again]])
        ends = np.concatenate([middles[again], stops[again]])
        halves, quiet = np.concatenate([lower[again], upper[again]]), np.tile(~rough[again], 2)
        parts = _refined(at, begins, ends, halves, quiet, most, halvings - 1)
        result[again] = parts[: len(parts) // 2] + parts[len(parts) // 2 :]
    return result


def _quadrature(at: Callable[[Array], Array], starts: Array, stops: Array) -> tuple[Array, Array]:
    """The integrals over intervals (n,) by Gauss's formula, and the errors (n,) that they may have by rounding.

    The error is negative where the polynomial through the points misses a value at an end: there is a kink between.
    """
    widths = stops - starts
    values = at(starts[:, None] + widths[:, None] * _NODES_AND_ENDS)
    total, size = np.zeros(len(widths)), np.zeros(len(widths))
    first, last = -values[:, POINTS], -values[:, POINTS + 1]
    for index, weight in enumerate(_WEIGHTS.tolist()):
        total += weight * values[:, index]
        size += weight * np.abs(values[:, index])
        first += _AT_START[index] * values[:, index]
        last += _AT_START[POINTS - 1 - index] * values[:, index]
    # Far from 0 the rounding of x itself changes f, and no halving removes that.
    rounding = np.finfo(float).eps * np.maximum(np.abs(starts), np.abs(stops)) * np.ptp(values, axis=1)
    allowed = EXTRAPOLATION * np.max(np.abs(values), axis=1) + AMPLIFICATION * rounding / np.abs(widths)
    missed = np.maximum(np.abs(first), np.abs(last)) > allowed
    error = INTERVAL_TOLERANCE * np.abs(widths) * size + rounding
    return widths * total, np.where(missed, -np.inf, error)
