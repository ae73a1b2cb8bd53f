"""Potentials of forces that are given by expressions, also far beyond the range of their panels."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np

from mbd_sim.dynamics.piecewise import Panels, evaluator, extended, integral, panels_of
from mbd_sim.geometry.pose import Array

MAX_TURNS = 6  # longest period that is recognized; half of it lies within the panels
SAMPLES = np.concatenate([np.linspace(-40.0, 40.0, 2003), np.geomspace(41.0, 1e3, 300), -np.geomspace(41.0, 1e3, 300)])
NEAR = 2003  # samples up to 40 rad
ROUND_OFF, RELATIVE_ROUND_OFF = 1e-12, 1e-14  # of forces, relative to the largest near force and to each force


@dataclass(frozen=True)
class Repetition:
    """f(x) = slope x + g(x) for every x, where g repeats itself after a number of turns."""

    turns: int
    slope: float


@dataclass(frozen=True, eq=False)
class Table:
    """The panels of ∫ f from 0, and how f repeats itself; without repetition the integral is exact between `ends`."""

    panels: Panels
    repetition: Repetition | None
    mean: float = 0.0

    @property
    def ends(self) -> tuple[float, float]:
        """The smallest and the largest x with exact integrals."""
        return self.panels.ends if self.repetition is None else (-np.inf, np.inf)


def table_of(f: Callable[[ca.SX], ca.SX], lower: float, upper: float) -> Table:
    """The panels of ∫ f between `lower` and `upper`, and further ones where few of them are enough.

    If f repeats itself, those between the two suffice: x is reduced by whole periods beyond.
    """
    panels = panels_of(f, lower, upper)
    if lower != -upper or panels.ends != (lower, upper):
        return Table(panels, None)
    found = repetition(f)
    if found is None:
        return Table(extended(f, panels), None)
    symbol = ca.SX.sym("x")
    inside = ca.Function("inside", [symbol], [integral(f, panels, symbol)])
    half = np.pi * found.turns
    mean = float(inside(half) - inside(-half)) / (2.0 * half)
    if abs(mean) <= RELATIVE_ROUND_OFF * float(np.max(np.abs(_values(f, np.linspace(-half, half, 101))))):
        mean = 0.0
    return Table(panels, found, mean)


def potential(f: Callable[[ca.SX], ca.SX], table: Table, x: ca.SX) -> ca.SX:
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
    near = float(np.max(np.abs(here[:NEAR])))
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
