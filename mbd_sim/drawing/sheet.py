"""The elements of a drawing: paths and texts in points (1/72 inch), x to the right and y up, without Matplotlib."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from mbd_sim.appearance.palette import Color, mixed
from mbd_sim.appearance.polylines import circle
from mbd_sim.geometry.pose import Array
from mbd_sim.geometry.rotation import unit_or_zero

WHITE: Color = (255, 255, 255)
INK: Color = (44, 50, 60)
GRAY: Color = (120, 128, 140)
STEEL: Color = (196, 202, 210)

# From back to front; within a layer the depth decides, then the order of addition.
BACK, BODIES, FRONT, MARKS = 0, 1, 2, 3

LINE = 1.1  # pt
AXIS_DASH = (9.0, 2.5, 1.5, 2.5)  # pt, of axes and pitch lines


@dataclass(frozen=True, eq=False)
class SheetPath:
    """A line through `points` (n, 2), in points; `depth` in m grows toward the eye.

    `particle` marks the dots of particles, which lie on top in planar views.
    """

    points: Array
    edge: Color | None = INK
    fill: Color | None = None
    width: float = LINE
    closed: bool = False
    dash: tuple[float, ...] = ()
    layer: int = BODIES
    depth: float = 0.0
    particle: bool = False


@dataclass(frozen=True, eq=False)
class SheetText:
    """A text centered on `at` (2,), `size` in points."""

    text: str
    at: Array
    size: float
    color: Color = INK
    italic: bool = False

    @cached_property
    def half(self) -> Array:
        """Approximately half the width and the height (2,) of the text in DejaVu Sans."""
        return 0.5 * np.array([0.61 * self.size * max(len(self.text), 1), 1.1 * self.size])

    @cached_property
    def box(self) -> tuple[Array, Array]:
        """The approximate corners, lower left (2,) and upper right (2,), of the text."""
        return self.at - self.half, self.at + self.half


@dataclass(eq=False)
class Sheet:
    """The paths and texts of a drawing."""

    paths: list[SheetPath] = field(default_factory=list)
    texts: list[SheetText] = field(default_factory=list)

    def add(self, *paths: SheetPath) -> None:
        """Add paths."""
        self.paths += paths

    def bounds(self) -> tuple[Array, Array]:
        """Lower left (2,) and upper right (2,) of everything on the sheet, in points."""
        corners = [path.points for path in self.paths if len(path.points)]
        corners += [np.array(text.box) for text in self.texts]
        every = np.vstack(corners or [np.zeros((1, 2))])
        return every.min(axis=0), every.max(axis=0)

    def translated(self, by: Array) -> Sheet:
        """A copy moved by (2,) points."""
        return Sheet(
            [replace(path, points=path.points + by) for path in self.paths],
            [replace(text, at=text.at + by) for text in self.texts],
        )

    def back_to_front(self) -> list[SheetPath]:
        """The paths in drawing order."""
        return sorted(self.paths, key=lambda path: (path.layer, path.depth))


def fill_color(color: Color) -> Color:
    """The fill of a part of this color."""
    return mixed(color, WHITE, 0.5)


def outline_color(color: Color) -> Color:
    """The outline of a part of this color, and its name."""
    return mixed(color, INK, 0.55)


def arc(center: Array, radius: float, start: float = 0.0, stop: float = 2.0 * np.pi, count: int = 49) -> Array:
    """Points (count, 2) on a circle, from angle `start` to `stop` in rad."""
    return np.asarray(center + radius * circle(np.linspace(start, stop, count)))


def left_of(direction: Array) -> Array:
    """The unit vector (2,) to the left of a direction (2,)."""
    return np.array([-direction[1], direction[0]]) / max(float(np.hypot(*direction)), 1e-300)


def arrow_head(tip: Array, direction: Array, color: Color, size: float = 7.0) -> SheetPath:
    """A filled arrow head with its tip at `tip` (2,)."""
    along = unit_or_zero(direction)
    across = left_of(along)
    back = tip - size * along
    points = np.array([tip, back + 0.36 * size * across, back + 0.22 * size * along, back - 0.36 * size * across])
    return SheetPath(points, edge=None, fill=color, closed=True, layer=MARKS)
