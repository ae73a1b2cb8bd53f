"""Springs, dampers, rods, cables and friction between two points on the sheet."""

from __future__ import annotations

import numpy as np

from mbd_sim.appearance.polylines import flat_coil, spiral
from mbd_sim.drawing.projection import Page
from mbd_sim.drawing.sheet import BODIES, INK, LINE, WHITE, SheetPath, arc, left_of
from mbd_sim.geometry.pose import Array
from mbd_sim.geometry.rotation import unit_or_zero

AMPLITUDE, PITCH = 5.6, 7.0  # pt
MAX_TURNS = 11
BESIDE = 8.5  # pt, from the center line to a spring and its damper in parallel
MIN_LENGTH = 2.0  # pt
SAW = 4.5  # pt, from tooth to tooth


def spring(start: Array, stop: Array, layer: int = BODIES, depth: float = 0.0) -> list[SheetPath]:
    """A coil between two points (2,), with a white rim that sets it off from the background."""
    length = float(np.hypot(*(stop - start)))
    if length < MIN_LENGTH:
        return []
    along, end = unit_or_zero(stop - start), float(np.clip(0.12 * length, 0.0, 14.0))
    turns = int(np.clip(round((length - 2.0 * end) / PITCH), 4, MAX_TURNS))
    forward, sideways = flat_coil(length, end, turns, AMPLITUDE).T
    coil = start + np.outer(forward, along) + np.outer(sideways, left_of(along))
    points = np.vstack([start, coil, stop])
    rim = SheetPath(coil, edge=WHITE, width=3.0, layer=layer, depth=depth)
    return [rim, SheetPath(points, edge=INK, width=LINE, layer=layer, depth=depth)]


def damper(start: Array, stop: Array, layer: int = BODIES, depth: float = 0.0) -> list[SheetPath]:
    """A dashpot between two points (2,)."""
    length = float(np.hypot(*(stop - start)))
    if length < MIN_LENGTH:
        return []
    along, across = unit_or_zero(stop - start), left_of(stop - start)
    middle, half, box = 0.5 * (start + stop), 5.0, min(11.0, 0.3 * length)
    cup = np.array([middle + box * along + half * across, middle - box * along + half * across,
                    middle - box * along - half * across, middle + box * along - half * across])  # fmt: skip
    piston = middle + 0.25 * box * along
    lines = [
        np.array([start, middle - box * along]),
        cup,
        np.array([piston - 0.75 * half * across, piston + 0.75 * half * across]),
        np.array([piston, stop]),
    ]
    body = SheetPath(cup, edge=None, fill=WHITE, closed=True, layer=layer, depth=depth)
    strokes = [
        SheetPath(line, edge=INK, width=w, layer=layer, depth=depth)
        for line, w in zip(lines, (LINE, LINE, 2.0, LINE), strict=True)
    ]
    return [body, *strokes]


def spring_and_damper(
    start: Array, stop: Array, elastic: bool, damped: bool, layer: int = BODIES, depth: float = 0.0
) -> list[SheetPath]:
    """A spring, a damper, or both side by side."""
    if not (elastic and damped):
        draw = spring if elastic else damper
        return draw(start, stop, layer, depth) if elastic or damped else []
    length = float(np.hypot(*(stop - start)))
    if length < MIN_LENGTH:
        return []
    along, across = unit_or_zero(stop - start), BESIDE * left_of(stop - start)
    inset = min(7.0, 0.15 * length)
    first, last = start + inset * along, stop - inset * along
    bars = [
        SheetPath(np.array(line), edge=INK, width=LINE, layer=layer, depth=depth)
        for line in ([start, first], [last, stop], [first - across, first + across], [last - across, last + across])
    ]
    return [
        *spring(first + across, last + across, layer, depth),
        *damper(first - across, last - across, layer, depth),
        *bars,
    ]


def link(start: Array, stop: Array, layer: int = BODIES, depth: float = 0.0) -> list[SheetPath]:
    """A massless rod that keeps two points (2,) at a distance: dashed."""
    ends = [SheetPath(arc(at, 2.2), edge=INK, fill=INK, closed=True, layer=layer, depth=depth) for at in (start, stop)]
    line = np.array([start, stop])
    rim = SheetPath(line, edge=WHITE, width=3.0, layer=layer, depth=depth)
    return [rim, SheetPath(line, edge=INK, width=LINE, dash=(5.0, 3.0), layer=layer, depth=depth), *ends]


def cable_paths(page: Page, line: Array, depth: float) -> list[SheetPath]:
    """A taut cable along a line (n, 3) in ground's frame, with a white rim."""
    widths = ((WHITE, 3.0), (INK, LINE))
    return [SheetPath(page.project(line), edge=edge, width=w, layer=BODIES, depth=depth) for edge, w in widths]


def friction_teeth(start: Array, stop: Array, side: Array, layer: int, depth: float = 0.0) -> SheetPath:
    """Rough faces between two points (2,): saw teeth on the line, on the side opposite to `side` (2,)."""
    along, length = unit_or_zero(stop - start), float(np.hypot(*(stop - start)))
    count = max(round(length / SAW), 3)
    foot = start + np.outer(np.repeat(np.arange(count + 1), 2)[1:-1] * length / count, along)
    foot[1::2] -= 0.8 * SAW * unit_or_zero(side)
    return SheetPath(foot, edge=INK, width=1.2, layer=layer, depth=depth)


def brake_shoe(at: Array, away: Array, layer: int, depth: float = 0.0) -> list[SheetPath]:
    """A shoe that rubs on a pin, on the side `away` (2,)."""
    angle = float(np.arctan2(away[1], away[0]))
    shoe = np.vstack([arc(at, 7.0, angle - 0.9, angle + 0.9, 15), arc(at, 11.0, angle + 0.9, angle - 0.9, 15)])
    return [SheetPath(shoe, edge=INK, fill=INK, width=0.8, closed=True, layer=layer, depth=depth)]


def torsion_spring(at: Array, layer: int, depth: float = 0.0) -> list[SheetPath]:
    """A spiral spring about a pin."""
    points = at + spiral(6.2, 13.5, 2.25)
    rim = SheetPath(points, edge=WHITE, width=2.4, layer=layer, depth=depth)
    return [rim, SheetPath(points, edge=INK, width=0.9, layer=layer, depth=depth)]
