"""Constraints: rods and cables, curves and surfaces, and the contact points of wheels."""

from __future__ import annotations

from collections.abc import Iterator
from typing import assert_never

import numpy as np
import rerun as rr

from mbd_sim.appearance import palette
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.constraints import Cable, Clutch, Coupling, Distance, Flat, KnifeEdge, Rolling, Surface
from mbd_sim.mechanism.records import GROUND, Attachment
from mbd_sim.viewer import entity_paths
from mbd_sim.viewer.entity import Entity, LoggedItems
from mbd_sim.viewer.part_poses import PartPoses
from mbd_sim.viewer.sample_rows import Rows
from mbd_sim.viewer.scene_description import ConstraintLines, SceneDescription
from mbd_sim.viewer.trace_entities import Trace

HALF_LENGTH = 0.7  # of the line on which a point is constrained to lie, relative to the mechanism's size
MIN_SINE = 0.05  # of the angle between a wheel and its plane: a wheel that lies flat touches with all its rim


def constraint_entities(scene: SceneDescription) -> Iterator[Entity]:
    """All constraints that have a picture."""
    size = scene.extent.size
    for constraint_lines in scene.constraint_lines:
        yield _ConstraintLines(constraint_lines, size)
    for constraint in scene.mechanism.constraints:
        path = f"{entity_paths.WORLD}/constraints/{constraint.name}"
        match constraint:
            case Distance(first=first, second=second):
                yield _StraightLine(path, (first, second), 0.007 * size, palette.CLOSING)
            case Cable(points=points):
                yield _StraightLine(path, points, 0.005 * size, palette.ROPE)
            case Rolling():
                yield _RollingContact(constraint, size)
            case Flat():
                yield _PointOnLine(path, constraint, size)
            case KnifeEdge(point=point) | Surface(point=point):
                yield _Point(path, point, size)
            case Coupling() | Clutch():
                pass  # visible in the motion of its joints only
            case _:
                assert_never(constraint)


class _ConstraintLines:
    """A curve, or lines on a surface, in the frame of the part that carries it."""

    def __init__(self, constraint_lines: ConstraintLines, size: float) -> None:
        self._lines, self._size = constraint_lines, size

    def static(self) -> LoggedItems:
        width, color = (-0.7, palette.CURVE) if self._lines.surface else (0.006 * self._size, palette.CLOSING)
        lines = rr.LineStrips3D(list(self._lines.lines), radii=[width], colors=[color])
        if self._lines.lines:
            yield f"{entity_paths.part(self._lines.part)}/wires/{self._lines.name}", lines

    def columns(self, rows: Rows, poses: PartPoses) -> LoggedItems:
        yield from ()


class _StraightLine:
    """Straight lines from point to point."""

    def __init__(self, path: str, points: tuple[Attachment, ...], radius: float, color: palette.Color) -> None:
        self._path, self._points, self._radius, self._color = path, points, radius, color

    def static(self) -> LoggedItems:
        yield self._path, rr.LineStrips3D.from_fields(radii=[self._radius], colors=[self._color])
        yield f"{self._path}/ends", rr.Points3D.from_fields(radii=[1.8 * self._radius], colors=[self._color])

    def columns(self, rows: Rows, poses: PartPoses) -> LoggedItems:
        slices = np.stack([poses.point(at) for at in self._points], axis=1)
        yield self._path, rr.LineStrips3D.columns(strips=list(slices))
        ends = rr.Points3D.columns(positions=slices.reshape(-1, 3)).partition([len(self._points)] * len(rows))
        yield f"{self._path}/ends", ends


class _Point:
    """A constrained point."""

    def __init__(self, path: str, point: Attachment, size: float) -> None:
        self._path, self._point, self._size = path, point, size

    def static(self) -> LoggedItems:
        yield self._path, rr.Points3D.from_fields(radii=[0.014 * self._size], colors=[palette.CLOSING])

    def columns(self, rows: Rows, poses: PartPoses) -> LoggedItems:
        yield self._path, rr.Points3D.columns(positions=poses.point(self._point))


class _PointOnLine(_Point):
    """A point on a plane, or on a line, which is drawn in the frame of the part that carries it."""

    def __init__(self, path: str, constraint: Flat, size: float) -> None:
        super().__init__(path, constraint.point, size)
        self._constraint = constraint

    def static(self) -> LoggedItems:
        yield from super().static()
        if len(self._constraint.normals) == 2:
            base, half = self._constraint.base, HALF_LENGTH * self._size * np.cross(*self._constraint.normals)
            line = rr.LineStrips3D([[base.point - half, base.point + half]], radii=[-1.0], colors=[palette.CURVE])
            yield f"{entity_paths.part(base.part)}/lines/{self._constraint.name}", line


class _RollingContact:
    """The point at which a wheel or a ball touches its plane, and the track that it leaves there."""

    def __init__(self, constraint: Rolling, size: float) -> None:
        self._constraint, self._size = constraint, size
        self._path = f"{entity_paths.WORLD}/contacts/{constraint.name}"
        self._track = Trace(entity_paths.trace(constraint.name), palette.CONTACT, 0.003 * size)

    def static(self) -> LoggedItems:
        yield self._path, rr.Points3D.from_fields(radii=[0.014 * self._size], colors=[palette.CONTACT])
        yield from self._track.static()

    def columns(self, rows: Rows, poses: PartPoses) -> LoggedItems:
        touched = contact(self._constraint, poses)
        yield self._path, rr.Points3D.columns(positions=touched)
        yield from self._track.columns_through(rows, touched)


def contact(constraint: Rolling, poses: PartPoses) -> Array:
    """The points (n, 3) of a disc, or a ball, that are nearest to its plane."""
    center = poses.point(constraint.center)
    down = -poses.direction(constraint.plane.part, constraint.normal)
    if constraint.axis is not None:
        axis = poses.direction(constraint.center.part, constraint.axis)
        down = down - np.sum(down * axis, axis=1, keepdims=True) * axis
        down /= np.maximum(np.linalg.norm(down, axis=1, keepdims=True), MIN_SINE)
    return np.asarray(center + constraint.radius * down)


def floor_of(scene: SceneDescription) -> tuple[Array, Array] | None:
    """A point (3,) and the normal (3,) of the first plane of ground that something rolls or slides on."""
    for constraint in scene.mechanism.constraints:
        if isinstance(constraint, Rolling) and constraint.plane.part == GROUND:
            return constraint.plane.point, constraint.normal
        if isinstance(constraint, Flat) and constraint.base.part == GROUND and len(constraint.normals) == 1:
            return constraint.base.point, constraint.normals[0]
    return None
