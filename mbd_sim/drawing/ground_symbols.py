"""Symbols of ground and of its supports: hatched lines, brackets, bearings, walls, posts."""

from __future__ import annotations

import numpy as np

from mbd_sim.drawing.sheet import BACK, FRONT, GRAY, INK, LINE, STEEL, WHITE, SheetPath, arc, left_of
from mbd_sim.geometry.pose import Array
from mbd_sim.geometry.rotation import unit_or_zero

PIN = 4.6  # pt, radius of a pin
HATCH, SPACING = 6.0, 5.0  # pt
SUPPORT = 17.0  # pt, from a pin to the ground below it


def hatched_line(start: Array, stop: Array, side: Array, layer: int = BACK, depth: float = 0.0) -> list[SheetPath]:
    """A line from `start` (2,) to `stop` (2,) with hatching on its `side`, a direction (2,)."""
    along = unit_or_zero(stop - start)
    across = left_of(along) * (1.0 if left_of(along) @ side >= 0.0 else -1.0)
    length = float(np.hypot(*(stop - start)))
    count = max(round(length / SPACING), 2)
    strokes = [
        SheetPath(
            np.array([foot, foot + HATCH * (across - 0.75 * along)]), edge=GRAY, width=0.7, layer=layer, depth=depth
        )
        for foot in (start + along * length * (i + 0.75) / count for i in range(count))
    ]
    return [*strokes, SheetPath(np.array([start, stop]), edge=INK, width=1.4, layer=layer, depth=depth)]


def support(at: Array, direction: Array, layer: int = BACK, depth: float = 0.0) -> list[SheetPath]:
    """A bracket from a pin to hatched ground in `direction` (2,) from it."""
    down, across = unit_or_zero(direction), left_of(direction)
    foot = at + SUPPORT * down
    bracket = np.array([at + 0.9 * PIN * across, foot + 11.0 * across, foot - 11.0 * across, at - 0.9 * PIN * across])
    body = SheetPath(bracket, fill=STEEL, closed=True, layer=layer, depth=depth)
    return [*hatched_line(foot - 17.0 * across, foot + 17.0 * across, down, layer, depth), body]


def bearing(at: Array) -> list[SheetPath]:
    """A bearing in ground, seen along its axis."""
    spokes = [
        SheetPath(np.array([at + 10.5 * d, at + 15.5 * (d + 0.35 * left_of(d))]), edge=GRAY, width=0.7, layer=BACK)
        for d in (np.array([np.cos(a), np.sin(a)]) for a in np.linspace(0.0, 2.0 * np.pi, 14, endpoint=False))
    ]
    return [*spokes, SheetPath(arc(at, 10.5), fill=STEEL, width=1.2, closed=True, layer=BACK)]


def pin(at: Array, layer: int = FRONT, depth: float = 0.0) -> list[SheetPath]:
    """A pin seen along its axis."""
    return [SheetPath(arc(at, PIN), edge=INK, fill=WHITE, width=1.3, closed=True, layer=layer, depth=depth)]


def ball(at: Array, away: Array, depth: float, layer: int) -> list[SheetPath]:
    """A ball in a socket that opens opposite to the direction `away` (2,)."""
    angle = float(np.arctan2(away[1], away[0]))
    socket = arc(at, 8.6, angle - 1.75, angle + 1.75, 25)
    return [
        SheetPath(socket, edge=INK, fill=STEEL, width=1.3, closed=True, layer=layer, depth=depth),
        SheetPath(arc(at, 6.4), edge=INK, fill=WHITE, width=1.2, closed=True, layer=layer, depth=depth),
        SheetPath(arc(at + np.array([-1.9, 2.1]), 1.5), edge=None, fill=STEEL, closed=True, layer=layer, depth=depth),
    ]


def wall(at: Array, away: Array, depth: float = 0.0, layer: int = BACK) -> list[SheetPath]:
    """A short piece of hatched ground at the end of a spring, with the hatching in the direction `away` (2,)."""
    across = left_of(away)
    return hatched_line(at - 13.0 * across, at + 13.0 * across, away, layer, depth)


def post(at: Array, direction: Array, length: float, depth: float, layer: int) -> list[SheetPath]:
    """A short post on hatched ground in `direction` (2,) from its end."""
    down, across = unit_or_zero(direction), left_of(direction)
    foot = at + length * down
    stem = SheetPath(np.array([at, foot]), edge=INK, width=3.2 * LINE, layer=layer, depth=depth)
    inside = SheetPath(np.array([at, foot]), edge=STEEL, width=1.6 * LINE, layer=layer, depth=depth)
    return [stem, inside, *hatched_line(foot - 13.0 * across, foot + 13.0 * across, down, layer, depth)]
