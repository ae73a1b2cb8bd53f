"""Dimensions: lengths, horizontal and vertical offsets, and angles between points of a mechanism.

A point is named as `part.point`, `ground.point`, a part (its origin), or a joint (its place at its first part). Lengths
are those in the plane of a planar mechanism; other mechanisms are seen obliquely. Numbers are in mm and degrees (ISO
129-1).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Literal

import numpy as np

from mbd_sim.base.errors import InputError, nearest
from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.base.geometry.rotation import unit_or_zero
from mbd_sim.mechanism.elements.parts import GROUND
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.pictures.drawing.sheet import (
    INK,
    MARKS,
    Projection,
    ScaledView,
    Sheet,
    SheetPath,
    SheetText,
    arc,
    arrow_head,
    left_of,
)
from mbd_sim.pictures.shapes.extent import frame_of
from mbd_sim.simulation.run.moving_points import named_frame, points_of

DECIMALS = 3  # of millimeters and degrees, as in drawings for CAD
Kind = Literal["length", "x", "y", "angle"]
AUTO = "auto"
OFFSET, STEP = 26.0, 20.0  # pt, of a dimension line from what it measures, and of the next one
RADIUS = 34.0  # pt, of the arc of an angle
THIN = 0.6  # pt
TEXT = 9.0  # pt
BEYOND = 4.0  # pt, of an extension line beyond the dimension line
GAP = 3.0  # pt, between a point and its extension line
SAME_DEPTH = 1e-6  # of the size, by which points may lie in front of each other
MOST = 24  # dimensions that are chosen automatically


def _rounded(value: float) -> str:
    """A number for a drawing; what is smaller than 1 keeps its digits."""
    return f"{round(value, DECIMALS):.12g}" if abs(value) >= 1.0 else f"{value:.3g}"


@dataclass(frozen=True, eq=False)
class Dimension:
    """A dimension: its kind, the points (n, 2) that it measures, in m in the plane of the view, and their names.

    Those of an angle are one on the first line, the vertex, and one on the second line.
    """

    kind: Kind
    points: Array
    names: tuple[str, ...]

    @property
    def value(self) -> float:
        """In m, or rad."""
        first, last = self.points[0], self.points[-1]
        match self.kind:
            case "length":
                return float(np.hypot(*(last - first)))
            case "x":
                return abs(float(last[0] - first[0]))
            case "y":
                return abs(float(last[1] - first[1]))
        return float(np.diff(self.directions)[0] % (2.0 * np.pi))

    @property
    def directions(self) -> Array:
        """The angles (2,) of both lines of an angle in rad, the second one counterclockwise from the first."""
        lines = self.points[[0, 2]] - self.points[1]
        first, second = np.arctan2(lines[:, 1], lines[:, 0])
        if (second - first) % (2.0 * np.pi) > np.pi:
            first, second = second, first
        return np.array([first, first + (second - first) % (2.0 * np.pi)])

    @property
    def text(self) -> str:
        """The number as it is written."""
        if self.kind == "angle":
            return f"{_rounded(float(np.degrees(self.value)))}°"
        return _rounded(1e3 * self.value)


class Places:
    """The named places of a mechanism at the poses of its parts."""

    def __init__(self, mechanism: Mechanism, poses: Mapping[str, Pose], view: Projection) -> None:
        self.mechanism, self.view = mechanism, view
        self._poses, self._axes = poses, np.column_stack([view.right, view.up])
        self._depths: dict[str, float] = {}

    def __call__(self, name: str) -> Array:
        """(2,) in m in the plane of the view.

        :raises InputError: there is no such point, part or joint.
        """
        joint = self.mechanism.all_joints.get(name)
        if joint is not None:
            position = frame_of(self._poses, joint.parent, joint.parent_pose).position
        else:
            known = points_of(self.mechanism)
            if name.partition(".")[0] not in known:
                raise InputError(f"there is no point '{name}'", nearest(name, [*self.mechanism.all_joints, *known]))
            part, pose = named_frame(self.mechanism, name)
            position = frame_of(self._poses, part, pose).position
        self._depths[name] = float(position @ self.view.toward)
        return np.asarray(position @ self._axes)

    def dimension(self, kind: Kind, names: Sequence[str]) -> Dimension:
        """:raises InputError: a point does not exist, or the length is not seen in its true size."""
        points = np.array([self(name) for name in names])
        depths = [self._depths[name] for name in names]
        size = max(float(np.max(np.ptp(points, axis=0))), 1e-12)
        if not self.view.planar and max(depths) - min(depths) > SAME_DEPTH * size:
            message = f"{' and '.join(names)} are not seen in true length in an oblique view"
            raise InputError(message, "Dimension points of planar mechanisms.")
        return Dimension(kind, points, tuple(names))


def dimension_of(text: str, places: Places) -> Dimension:
    """Read `A,B` for a length, `x:A,B` or `y:A,B` for an offset, `angle:A,V,B`, or `angle:A,B` from the horizontal.

    :raises InputError: it has another form, or a point does not exist.
    """
    word, colon, rest = text.partition(":")
    kind, given = (word.strip(), rest) if colon else ("length", text)
    names = [name.strip() for name in given.split(",")]
    kinds: dict[str, Kind] = {"length": "length", "x": "x", "y": "y", "angle": "angle"}
    if kind not in kinds:
        raise InputError(f"there is no dimension '{kind}'", nearest(kind, kinds))
    if len(names) not in ((2, 3) if kind == "angle" else (2,)) or "" in names:
        raise InputError(f"'{text}' is not a dimension", "Write A,B, or x:A,B, y:A,B, angle:A,V,B, angle:A,B.")
    if kind == "angle" and len(names) == 2:
        return _from_horizontal(places.dimension("length", names))
    return places.dimension(kinds[kind], names)


def _from_horizontal(line: Dimension) -> Dimension:
    """The angle of a line at its first point, from the horizontal."""
    start, end = line.points
    along = start + np.array([max(np.hypot(*(end - start)), 1e-9), 0.0])
    return Dimension("angle", np.array([along, start, end]), (line.names[0], *line.names))


def automatic(places: Places) -> list[Dimension]:
    """The lengths of links between their joints, the offsets of the supports, and the angle of the first link.

    :raises InputError: the mechanism is not planar, so that lengths are not seen in true size.
    """
    mechanism = places.mechanism
    if not places.view.planar:
        raise InputError(
            f"{mechanism.name} is not planar: its lengths are not seen in true size", "Leave out the dimensions."
        )
    joints = {name: joint for name, joint in mechanism.all_joints.items() if joint.kind.connects}
    found: list[Dimension] = []
    for part in mechanism.parts:
        names = _apart([name for name, joint in joints.items() if part in (joint.parent, joint.child)], places)
        found += [places.dimension("length", pair) for pair in pairwise(names)]
        points = _apart([*names, *(f"{part}.{point}" for point in mechanism.parts[part].points)], places)
        found += [places.dimension("length", (points[0], other)) for other in points[max(len(names), 1) :]]
    on_ground = [name for name, joint in joints.items() if GROUND in (joint.parent, joint.child)]
    supports = _apart(on_ground, places)
    for other in supports[1:]:
        found += [places.dimension(kind, (supports[0], other)) for kind in ("x", "y")]
    cranks = [one for one in found if one.kind == "length" and on_ground and one.names[0] == on_ground[0]]
    found += [_from_horizontal(one) for one in cranks[:1]]
    size = max((one.value for one in found if one.kind != "angle"), default=0.0)
    kept: dict[tuple[str, tuple[str, ...]], Dimension] = {}
    for one in found:
        if one.value > 1e-6 * (1.0 if one.kind == "angle" else size):
            kept.setdefault((one.kind, tuple(sorted(one.names))), one)
    return list(kept.values())[:MOST]


def _apart(names: Sequence[str], places: Places) -> list[str]:
    """The names of which no two are at the same place."""
    kept: list[str] = []
    for name in names:
        if all(np.hypot(*(places(name) - places(other))) > 1e-9 for other in kept):
            kept.append(name)
    return kept


@dataclass
class DimensionLines:
    """Dimensions as lines and texts on a sheet: each where it covers no other text.

    `placed` are the dimensions with where their lines run, in pt: a point (2,) on it, for DXF.
    """

    page: ScaledView
    low: Array
    high: Array
    sheet: Sheet = field(default_factory=Sheet)
    placed: list[tuple[Dimension, Array]] = field(default_factory=list)

    def add(self, dimension: Dimension) -> None:
        """Draw a dimension."""
        points = dimension.points * self.page.scale
        match dimension.kind:
            case "angle":
                tries = [_angle(dimension, points, RADIUS + number * 0.7 * STEP) for number in range(8)]
            case "length":
                normal = left_of(points[1] - points[0])
                away = 1.0 if normal @ (0.5 * (points[0] + points[1]) - 0.5 * (self.low + self.high)) >= 0.0 else -1.0
                tries = [
                    _line(dimension, points, points + side * (OFFSET + number * STEP) * normal)
                    for number in range(6)
                    for side in (away, -away)
                ]
            case _:
                axis = 0 if dimension.kind == "x" else 1
                tries = [_line(dimension, points, self._beside(points, axis, number)) for number in range(10)]
        chosen = next((one for one in tries if not self._covers(one)), tries[-1])
        self.sheet.add(*chosen.paths)
        self.sheet.texts += chosen.texts
        self.placed.append((dimension, chosen.texts[0].at))

    def _beside(self, points: Array, axis: int, number: int) -> Array:
        """The ends of a dimension line below, or to the left of, everything."""
        feet = points.copy()
        feet[:, 1 - axis] = self.low[1 - axis] - OFFSET - number * STEP
        return feet

    def _covers(self, one: Sheet) -> bool:
        text = one.texts[0]
        return any(
            np.all(np.minimum(text.box[1], other.box[1]) - np.maximum(text.box[0], other.box[0]) > 0.0)
            for other in self.sheet.texts
        )


def _line(dimension: Dimension, points: Array, feet: Array) -> Sheet:
    """A dimension line between two feet, with arrows, extension lines and the number."""
    start, stop = feet
    along = unit_or_zero(stop - start)
    sheet = Sheet()
    for point, foot in zip(points, feet, strict=True):
        away = unit_or_zero(foot - point)
        if np.hypot(*(foot - point)) > GAP:
            sheet.add(_thin(np.array([point + GAP * away, foot + BEYOND * away])))
    sheet.add(arrow_head(start, -along, INK, 6.0), arrow_head(stop, along, INK, 6.0))
    text = SheetText(dimension.text, 0.5 * (start + stop), TEXT)
    width = float(np.min(text.half / np.maximum(np.abs(along), 1e-9))) + 2.0  # half of it, along the line
    if 2.0 * width + 14.0 > np.hypot(*(stop - start)):  # no room between the arrows
        text = replace(text, at=stop + (10.0 + width) * along)
        sheet.add(_thin(np.array([start, stop + 10.0 * along])))
    else:
        sheet.add(_thin(np.array([start, text.at - width * along])), _thin(np.array([text.at + width * along, stop])))
    sheet.texts.append(text)
    return sheet


def _angle(dimension: Dimension, points: Array, radius: float) -> Sheet:
    """An arc about the vertex, with arrows, extension lines and the number."""
    vertex, (first, last) = points[1], dimension.directions
    sheet = Sheet()
    for angle in (first, last):
        along = np.array([np.cos(angle), np.sin(angle)])
        sheet.add(_thin(np.array([vertex, vertex + (radius + BEYOND) * along])))
        tip = vertex + radius * along
        turn = left_of(along) * (-1.0 if angle == first else 1.0)
        sheet.add(arrow_head(tip, turn, INK, 6.0))
    sheet.add(_thin(arc(vertex, radius, first, last)))
    middle = 0.5 * (first + last)
    sheet.texts.append(
        SheetText(dimension.text, vertex + (radius + 10.0) * np.array([np.cos(middle), np.sin(middle)]), TEXT)
    )
    return sheet


def _thin(points: Array) -> SheetPath:
    return SheetPath(points, edge=INK, width=THIN, layer=MARKS)
