"""Piecewise functions as CasADi expressions: their integrals from zero, potentials, and tables.

The integrals are exact to rounding. The potentials are those of forces that are given by expressions, and they hold
also far beyond the range of their panels. Tables that expressions look up are curves or surfaces.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.linear_algebra import product
from mbd_sim.base.rounded import gauss_legendre
from mbd_sim.mechanism.values.tables import BicubicSurface, Curve, Table, hermite

POINTS = 16
INTEGRAL_TOLERANCE = 1e-15  # of an integral, relative to the integral of the absolute value from 0
MAX_PANELS = 64  # on each side of 0
DECADES = 5  # beyond the range of a law, to which further panels may reach
MIN_WIDTH = 1e-12  # of a panel, relative to the range


@dataclass(frozen=True, eq=False)
class Panels:
    """The panels of an integral from 0, separated by `knots` (n,).

    In panel i the integral is `values[i]` plus that from `origins[i]`; both arrays are (n + 1,).
    """

    knots: Array
    origins: Array
    values: Array

    @property
    def ends(self) -> tuple[float, float]:
        """The outer ends of the outermost panels; 0 on a side without panels."""
        return float(self.origins[0]), float(self.origins[-1])


@cache
def gauss_formula() -> tuple[Array, Array]:
    """The nodes (16,) between 0 and 1 and the weights (16,) of Gauss–Legendre quadrature over this interval."""
    nodes, weights = (0.5 * np.array(values) for values in gauss_legendre(POINTS))
    return nodes + 0.5, weights


def select(x: ca.SX, knots: Array, columns: Array) -> ca.SX:
    """The row of `columns` (n + 1, m) for the piece in which x lies, as (m,); a knot belongs to the piece above it.

    Each number is selected rather than summed from differences, and so keeps its last bit.
    """
    beyond = [ca.SX(1), *(x >= float(knot) for knot in knots), ca.SX(0)]
    result = ca.SX(columns.shape[1], 1)
    for row, (here, next_) in zip(columns, pairwise(beyond), strict=True):
        inside = here - next_
        result += ca.vertcat(*(ca.if_else(inside, float(value), 0.0) for value in row))
    return result


def integral(f: Callable[[ca.SX], ca.SX], panels: Panels, x: ca.SX) -> ca.SX:
    """∫ f from 0 to x: a number up to the origin of the panel of x, and Gauss–Legendre quadrature from there."""
    start, value = ca.vertsplit(select(x, panels.knots, np.column_stack([panels.origins, panels.values])))
    width = x - start
    terms = [float(weight) * f(start + width * float(node)) for node, weight in zip(*gauss_formula(), strict=True)]
    return value + width * sum(terms[1:], terms[0])


def evaluator(f: Callable[[ca.SX], ca.SX]) -> Callable[[Array], Array]:
    """f as a function of an array of numbers, whose shape its values have."""
    x = ca.SX.sym("x")
    values = ca.Function("f", [x], [f(x)])

    def at(points: Array) -> Array:
        return np.array(values.map(points.size)(ca.DM(points.ravel()).T)).reshape(points.shape)

    return at


def panels_of(f: Callable[[ca.SX], ca.SX], lower: float, upper: float) -> Panels:
    """The panels on which 16 points integrate f to rounding, from `lower` ≤ 0 to `upper` ≥ 0.

    Quadrature rather than a closed form, because many expressions have no antiderivative, and others have one that
    cancels (x - log(1 + x) near 0) or jumps between branches. Sixteen points are exact for polynomials up to degree
    31. Where they are not enough, as at a kink, panels are halved until they are. The integrals occur only in the
    energies, which are read at the publishing rate; the accelerations contain f alone. Panels stop where f overflows.
    """
    at = evaluator(f)
    below, above = _edges(at, lower), _edges(at, upper)
    edges = np.array([*reversed(below), 0.0, *above])
    pieces = _integrals(at, edges)
    zero = len(below)
    energies = [*-np.cumsum(pieces[:zero][::-1])[::-1], 0.0, *np.cumsum(pieces[zero:])]
    return Panels(np.delete(edges, zero), edges, np.array(energies))


def extended(f: Callable[[ca.SX], ca.SX], panels: Panels) -> Panels:
    """Panels extended beyond both ends, by decades, as far as `MAX_PANELS` for each are enough."""
    at = evaluator(f)
    above, below = (_outward(at, float(panels.knots[index])) for index in (-1, 0))
    edges = np.array([*reversed(below), *panels.origins, *above])
    up = np.cumsum([panels.values[-1], *_integrals(at, [panels.origins[-1], *above])])
    down = np.cumsum([panels.values[0], *_integrals(at, [panels.origins[0], *below])])
    energies = np.array([*down[:0:-1], *panels.values, *up[1:]])
    return Panels(np.array([*reversed(below), *panels.knots, *above]), edges, energies)


def _outward(at: Callable[[Array], Array], start: float) -> list[float]:
    """The ends of the panels beyond `start`, from there outward."""
    found: list[float] = []
    for decade in range(DECADES):
        a, b = start * 10.0**decade, start * 10.0 ** (decade + 1)
        edges, errors = [a, b], [_refined(at, a, b)]
        size = _refined(at, 0.0, a)[1]
        while len(edges) <= MAX_PANELS:
            if not np.all(np.isfinite(at(np.array(edges)))) or not np.all(np.isfinite([e for _, e in errors])):
                return found
            total = size + sum(own for _, own in errors)
            worst = max(range(len(errors)), key=lambda index: errors[index][0])
            if errors[worst][0] <= INTEGRAL_TOLERANCE * total:
                break
            _halve(at, edges, errors, worst)
        else:
            return found
        found += edges[1:]
    return found


def _edges(at: Callable[[Array], Array], end: float) -> list[float]:
    """The ends of the panels on one side of 0, from 0 outward."""
    least = MIN_WIDTH * abs(end)
    while end and not np.all(np.isfinite(at(np.linspace(0.0, end, 65)[:-1]))):
        end = 0.5 * end if abs(end) > least else 0.0
    if not end:
        return []
    edges, found = [0.0, end], [_refined(at, 0.0, end)]
    for _ in range(MAX_PANELS):
        errors, sizes = np.array(found)[:, 0], np.cumsum(np.array(found)[:, 1])
        narrow = np.abs(np.diff(edges)) <= MIN_WIDTH * abs(end)
        excess = np.where((errors <= INTEGRAL_TOLERANCE * sizes) | narrow, 0.0, errors / np.maximum(sizes, 1e-300))
        worst = int(np.argmax(excess))
        if not excess[worst] > 0.0:
            break
        _halve(at, edges, found, worst)
    return edges[1:]


def _halve(at: Callable[[Array], Array], edges: list[float], found: list[tuple[float, float]], index: int) -> None:
    """Halve the panel `index` between `edges`, and replace what `_refined` has found for it."""
    a, b = edges[index : index + 2]
    middle = 0.5 * (a + b)
    found[index : index + 1] = [_refined(at, a, middle), _refined(at, middle, b)]
    edges.insert(index + 1, middle)


def _refined(at: Callable[[Array], Array], a: float, b: float) -> tuple[float, float]:
    """How much halving changes the integral from a to b, and the integral of the absolute value."""
    middle = 0.5 * (a + b)
    (whole, size), (first, _), (second, _) = _quadratures(at, (a, b), (a, middle), (middle, b))
    change = whole - first - second
    return (abs(change), size) if np.isfinite(change) else (0.0, size)


def _integrals(at: Callable[[Array], Array], edges: Iterable[float]) -> list[float]:
    """The integrals from each of the edges to the next."""
    return [whole for whole, _ in _quadratures(at, *pairwise(edges))]


def _quadratures(at: Callable[[Array], Array], *ranges: tuple[float, float]) -> list[tuple[float, float]]:
    """The integral over each range and that of the absolute value; the function is called once for all of them."""
    if not ranges:
        return []
    nodes, weights = gauss_formula()
    values = at(np.array([a + (b - a) * nodes for a, b in ranges]).reshape(-1, POINTS))
    return [
        (float((b - a) * (product(weights, row))), float(abs(b - a) * (product(weights, np.abs(row)))))
        for (a, b), row in zip(ranges, values, strict=True)
    ]


MAX_TURNS = 6  # longest period that is recognized; half of it lies within the panels
SAMPLES = np.concatenate([np.linspace(-40.0, 40.0, 2003), np.geomspace(41.0, 1e3, 300), -np.geomspace(41.0, 1e3, 300)])
SAMPLES_NEAR = 2003  # samples up to 40 rad
ROUND_OFF, RELATIVE_ROUND_OFF = 1e-12, 1e-14  # of forces, relative to the largest near force and to each force


@dataclass(frozen=True)
class Repetition:
    """f(x) = slope x + g(x) for every x, where g repeats itself after a number of turns."""

    turns: int
    slope: float


@dataclass(frozen=True, eq=False)
class PotentialTable:
    """The panels of ∫ f from 0, and how f repeats itself; without repetition the integral is exact between `ends`."""

    panels: Panels
    repetition: Repetition | None
    mean: float = 0.0

    @property
    def ends(self) -> tuple[float, float]:
        """The smallest and the largest x with exact integrals."""
        return self.panels.ends if self.repetition is None else (-np.inf, np.inf)


def table_of(f: Callable[[ca.SX], ca.SX], lower: float, upper: float) -> PotentialTable:
    """The panels of ∫ f between `lower` and `upper`, and further ones where few of them are enough.

    If f repeats itself, those between the two suffice: x is reduced by whole periods beyond.
    """
    panels = panels_of(f, lower, upper)
    if lower != -upper or panels.ends != (lower, upper):
        return PotentialTable(panels, None)
    found = repetition(f)
    if found is None:
        return PotentialTable(extended(f, panels), None)
    symbol = ca.SX.sym("x")
    inside = ca.Function("inside", [symbol], [integral(f, panels, symbol)])
    half = np.pi * found.turns
    mean = float(inside(half) - inside(-half)) / (2.0 * half)
    if abs(mean) <= RELATIVE_ROUND_OFF * float(np.max(np.abs(_values(f, np.linspace(-half, half, 101))))):
        mean = 0.0
    return PotentialTable(panels, found, mean)


def potential(f: Callable[[ca.SX], ca.SX], table: PotentialTable, x: ca.SX) -> ca.SX:
    """∫ f from 0 to x, exact to rounding between the ends of the table; beyond them, the integral up to the end."""
    lower, upper = table.panels.ends
    if table.repetition is None:
        return integral(f, table.panels, ca.if_else(x > upper, upper, ca.if_else(x < lower, lower, x)))
    turns, slope = table.repetition.turns, table.repetition.slope
    angle = x / turns
    reduced = ca.if_else(ca.fabs(x) > upper, turns * ca.atan2(ca.sin(angle), ca.cos(angle)), x)
    whole = x - reduced
    return integral(f, table.panels, reduced) + whole * (0.5 * slope * (x + reduced) + table.mean)


def repetition(f: Callable[[ca.SX], ca.SX]) -> Repetition | None:
    """The shortest period of f in whole turns, apart from a linear part; None if there is none."""
    here = _values(f, SAMPLES)
    if not np.all(np.isfinite(here)):
        return None
    near = float(np.max(np.abs(here[:SAMPLES_NEAR])))
    for turns in range(1, MAX_TURNS + 1):
        period = 2.0 * np.pi * turns
        later = _values(f, SAMPLES + period)
        rise = float(np.median(later - here))
        allowed = ROUND_OFF * near + RELATIVE_ROUND_OFF * (np.abs(here) + np.abs(later))
        if np.all(np.abs(later - here - rise) <= allowed):
            return Repetition(turns, 0.0 if abs(rise) <= ROUND_OFF * near else rise / period)
    return None


def _values(f: Callable[[ca.SX], ca.SX], points: Array) -> Array:
    return evaluator(f)(points)


def looked_up(table: Table, *at: Any) -> ca.SX:
    """The value of a table: see `Curve` and `BicubicSurface`."""
    places = [ca.SX(value) for value in at]
    return _on_curve(table, *places) if isinstance(table, Curve) else _on_surface(table, *places)


def _on_curve(curve: Curve, x: ca.SX) -> ca.SX:
    if curve.period is not None:
        x = x - curve.period * ca.floor((x - curve.x[0]) / curve.period)
    pieces = curve.pieces
    rows = np.column_stack([pieces.origins, pieces.coefficients])
    origin, c0, c1, c2, c3 = ca.vertsplit(select(x, pieces.knots, rows))
    d = x - origin
    return c0 + d * (c1 + d * (c2 + d * c3))


def _on_surface(surface: BicubicSurface, x: ca.SX, y: ca.SX) -> ca.SX:
    columns = ca.SX(ca.DM(surface.nodes)) @ _weights(surface.y, y)
    return ca.dot(_weights(surface.x, x), columns)


def _weights(knots: Sequence[float], x: ca.SX) -> ca.SX:
    """The weights (2 n,) of the value and the slope at each knot; beyond all knots, those of a straight line."""
    last = len(knots) - 1
    reached = [ca.SX(1), *(x >= knot for knot in knots), ca.SX(0)]
    inside = [here - next_ for here, next_ in pairwise(reached)]  # below all knots, in each interval, above all knots
    rows = [(knots[0], 1.0), *((one, other - one) for one, other in pairwise(knots)), (knots[last], 1.0)]
    origin, width = ca.vertsplit(select(x, np.array(knots), np.array(rows)))
    d = x - origin
    straight, cubic = (ca.SX(1), d), hermite(d, width)
    found = []
    for index in range(last + 1):
        for order in range(2):
            terms = [ca.if_else(inside[index + 1], cubic[order], 0.0)] if index < last else []
            terms += [ca.if_else(inside[index], cubic[2 + order], 0.0)] if index > 0 else []
            terms += [ca.if_else(inside[0], straight[order], 0.0)] if index == 0 else []
            terms += [ca.if_else(inside[last + 1], straight[order], 0.0)] if index == last else []
            found.append(sum(terms[1:], terms[0]))
    return ca.vertcat(*found)
