"""The sheet of a drawing: its elements, the projection onto it, and the placement of names.

The elements are paths and texts in points (1/72 inch), x to the right and y up, without Matplotlib. The direction of
view determines the projection from meters in space to points on the sheet. Names are placed near the points that they
name, and clear of lines and of each other.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.base.geometry.rotation import unit_or_zero
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.pictures.shapes.extent import PLANE_TOLERANCE, plane_normal
from mbd_sim.pictures.shapes.palette import Color, mixed
from mbd_sim.pictures.shapes.solids import circle

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

    `particle` marks the dots of particles, which lie on top in planar views. `group` says what it draws: `PARTS`,
    `JOINTS`, or "" for anything else.
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
    group: str = ""


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


AZIMUTH, ELEVATION = np.radians(-62.0), np.radians(24.0)  # of the eye, for spatial mechanisms


@dataclass(frozen=True, eq=False)
class Projection:
    """An orthographic view: unit vectors (3,) to the `right`, `up`, and `toward` the eye, in ground's frame.

    `planar` means that all motion is perpendicular to `toward`.
    """

    right: Array
    up: Array
    toward: Array
    planar: bool


@dataclass(frozen=True, eq=False)
class ScaledView:
    """A view at a scale, in points per meter."""

    view: Projection
    scale: float

    def project(self, points: Array) -> Array:
        """Points (..., 3) in ground's frame in m as points (..., 2) on the sheet, in points."""
        return np.asarray(points @ np.column_stack([self.view.right, self.view.up]) * self.scale)

    def depth(self, point: Array) -> float:
        """The coordinate in m of a point (3,) toward the eye."""
        return float(point @ self.view.toward)

    def to_space(self, direction: Array) -> Array:
        """The direction (3,) in the plane of the picture, in ground's frame, of a direction (2,) on the sheet."""
        return np.asarray(direction @ np.array([self.view.right, self.view.up]))

    def direction(self, direction: Array) -> Array:
        """The direction (2,) on the sheet of a direction (3,), foreshortened."""
        return np.asarray(direction @ np.column_stack([self.view.right, self.view.up]))


def view_of(mechanism: Mechanism, poses: Mapping[str, Pose]) -> Projection:
    """The view along the common axis of a planar mechanism, otherwise an oblique one."""
    normal = plane_normal(mechanism, poses)
    if normal is None:
        toward = np.array([np.cos(ELEVATION) * np.cos(AZIMUTH), np.cos(ELEVATION) * np.sin(AZIMUTH), np.sin(ELEVATION)])
        right = np.array([-np.sin(AZIMUTH), np.cos(AZIMUTH), 0.0])
        return Projection(right, np.cross(toward, right), toward, planar=False)
    vertical = np.array([0.0, 0.0, 1.0])
    if np.linalg.norm(np.cross(normal, vertical)) < PLANE_TOLERANCE:
        return Projection(np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]), vertical, planar=True)
    right = np.cross(vertical, normal)
    right /= np.linalg.norm(right)
    first = right[np.flatnonzero(np.abs(right) > PLANE_TOLERANCE)[0]]  # x to the right, or else y
    toward = normal if first > 0.0 else -normal
    right = right if first > 0.0 else -right
    return Projection(right, np.cross(toward, right), toward, planar=True)


DISTANCES = (13.0, 18.0, 25.0, 34.0)  # pt, from the named point to the edge of the text
DIRECTIONS = 16
STEP = 3.0  # pt, between the sampled points of lines


def place_labels(sheet: Sheet, names: Sequence[tuple[SheetText, float]]) -> list[SheetText]:
    """Move each text away from its point to where it covers least; texts that cost more than their limit are left out.

    :param names: texts at the points (2,) that they name, the most important first, each with the most it may cost.
    """
    lines, weights = _probes(sheet)
    placed: list[SheetText] = []
    for text, limit in names:
        offsets, costs = _candidates(0.5 * (text.box[1] - text.box[0]))
        centers = text.at + offsets
        costs = costs + _hidden(centers - text.half, centers + text.half, lines, weights, placed)
        best = int(np.argmin(costs))
        if costs[best] <= limit:
            placed.append(replace(text, at=centers[best]))
    return placed


def _candidates(half: Array) -> tuple[Array, Array]:
    """Places (k, 2) for the center of a text of half this size (2,), relative to the named point, and their costs."""
    offsets, costs = [], []
    for number in range(DIRECTIONS):
        angle = 2.0 * np.pi * number / DIRECTIONS
        direction = np.array([np.cos(angle), np.sin(angle)])
        edge = min(half[0] / max(abs(direction[0]), 1e-9), half[1] / max(abs(direction[1]), 1e-9))
        for rank, distance in enumerate(DISTANCES):
            offsets.append((distance - 6.0 + edge) * direction)
            costs.append(1.1 * rank + 0.01 * number)
    return np.array(offsets), np.array(costs)


def _hidden(low: Array, high: Array, lines: Array, weights: Array, placed: Sequence[SheetText]) -> Array:
    """The costs (k,) of the lines and texts that a text with corners `low` and `high` (k, 2) covers."""
    low, high = low - 2.0, high + 2.0
    near = np.flatnonzero(np.all((lines > low.min(axis=0)) & (lines < high.max(axis=0)), axis=1))
    (x, y), weights = lines[near].T, weights[near]
    inside = (x > low[:, :1]) & (x < high[:, :1]) & (y > low[:, 1:]) & (y < high[:, 1:])
    covered: Array = np.where(inside, weights, 0.0).sum(
        axis=1
    )  # the weights are halves: sums of them are exact in any order
    for other in placed:
        overlap = np.minimum(high, other.box[1]) - np.maximum(low, other.box[0])
        covered += np.where(np.all(overlap > 0.0, axis=1), 60.0 + np.prod(overlap, axis=1), 0.0)
    return covered


def _probes(sheet: Sheet) -> tuple[Array, Array]:
    """Points (n, 2) along all lines, and the cost (n,) of covering each."""
    points, weights = [np.zeros((0, 2))], [np.zeros(0)]
    for path in sheet.paths:
        corners = np.vstack([path.points, path.points[:1]]) if path.closed else path.points
        steps = np.hypot(*np.diff(corners, axis=0).T)
        along = np.concatenate([[0.0], np.cumsum(steps)])
        count = max(int(along[-1] / STEP), 1) + 1
        where = np.linspace(0.0, along[-1], count)
        points.append(np.column_stack([np.interp(where, along, corners[:, 0]), np.interp(where, along, corners[:, 1])]))
        weights.append(np.full(count, 0.5 if path.layer == BACK else 1.0))
    return np.vstack(points), np.concatenate(weights)
