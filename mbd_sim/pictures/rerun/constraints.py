"""Contacts, constrained points and traces in the scene.

Contacts are shown while they are closed, by the points where they touch, their normals and their forces.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import assert_never

import numpy as np
import rerun as rr

from mbd_sim.base.geometry.pose import Array
from mbd_sim.mechanism.elements.constraints import (
    Cable,
    Clutch,
    ContactLaw,
    Coupling,
    Distance,
    Flat,
    KnifeEdge,
    Rolling,
    Surface,
)
from mbd_sim.mechanism.elements.contacts import Face
from mbd_sim.mechanism.elements.parts import GROUND, Attachment
from mbd_sim.pictures.rerun import paths
from mbd_sim.pictures.rerun.forces import ArrowStyle
from mbd_sim.pictures.rerun.loads import ArrowScale
from mbd_sim.pictures.rerun.scene import Entity, LoggedItems, PartPoses, Rows, SceneDescription, is_closed, weight
from mbd_sim.pictures.shapes import palette
from mbd_sim.pictures.shapes.joints import pulls
from mbd_sim.pictures.shapes.touching import ForceScale, closed_places, normal_lines, of_shapes

POINT_RADIUS, NORMAL_RADIUS = 0.014, 0.003  # relative to the mechanism's size


def contact_entities(scene: SceneDescription) -> Iterator[Entity]:
    """All contacts that have a place."""
    if scene.contacts:
        yield _Contacts(scene)


class _Contacts:
    """The closed contacts: points, normals and arrows. All share three entities, so that many contacts cost little."""

    def __init__(self, scene: SceneDescription) -> None:
        self._extent, self._size, self._of_shapes = scene.extent, scene.extent.size, of_shapes(scene.contacts)
        self._inputs = [index for _, index in scene.contacts]
        self._pushes = np.array([not pulls(scene.mechanism, owner) for owner, _ in scene.contacts], dtype=bool)
        self._full = weight(scene)
        self._force_scale = ForceScale(self._full)
        self._style = ArrowStyle(
            paths.CONTACTS, ArrowScale("contacts", "", False, palette.CONTACT, self._size, self._full)
        )

    def static(self) -> LoggedItems:
        points = rr.Points3D.from_fields(radii=[POINT_RADIUS * self._size], colors=[palette.CONTACT])
        yield f"{paths.CONTACTS}/points", points
        normals = rr.LineStrips3D.from_fields(radii=[NORMAL_RADIUS * self._size], colors=[palette.CONTACT])
        yield f"{paths.CONTACTS}/normals", normals
        yield from self._style.static()

    def columns(self, rows: Rows, poses: PartPoses) -> LoggedItems:
        points, forces, normals = np.moveaxis(rows.of("contacts").reshape(len(rows), -1, 3, 3), 2, 0)
        points = self._extent.in_front(points, self._of_shapes)
        closed = closed_places(self._inputs, rows.of("inputs"), forces)
        counts = closed.sum(axis=1)
        columns = rr.Points3D.columns(positions=points[closed].reshape(-1, 3))
        yield f"{paths.CONTACTS}/points", columns.partition(counts)
        lines = rr.LineStrips3D.columns(strips=list(normal_lines(points[closed], normals[closed], self._size)))
        yield f"{paths.CONTACTS}/normals", lines.partition(counts)
        yield from self._style.force(points, self._scaled(np.where(closed[:, :, None], forces, 0.0)), self._pushes)

    def _scaled(self, forces: Array) -> Array:
        """Forces (n, k, 3), so that their arrows have the scale of contacts at each sample."""
        full = np.empty(len(forces))
        for index, sample in enumerate(forces):
            self._force_scale.add(sample)
            full[index] = self._force_scale.full
        return np.asarray(forces * (self._full / full)[:, None, None])


def trace_entities(scene: SceneDescription) -> Iterator[Entity]:
    """The chosen traces."""
    colors = palette.part_colors(scene.mechanism)
    for name, at in scene.traces.items():
        yield _PointTrace(name, at, colors.get(at.part, palette.JOINT), 0.005 * scene.extent.size)


class Trace:
    """A trace in pieces: each row is the line from the sample before, and the view shows those of the last second.

    A trace starts again where the motion does, as after a reset.
    """

    def __init__(self, path: str, color: palette.Color, radius: float) -> None:
        self.path, self._color, self._radius = path, color, radius
        self._end, self._time = np.zeros(3), np.inf
        self._touching = True

    def static(self) -> LoggedItems:
        """Its style."""
        yield self.path, rr.LineStrips3D.from_fields(colors=[self._color], radii=[self._radius])

    def columns_through(self, rows: Rows, points: Array, touching: Array) -> LoggedItems:
        """The pieces through points (n, 3); those that end where `touching` (n,) is False are not drawn."""
        times = np.concatenate([[self._time], rows.motion_times])
        before = np.vstack([self._end, points[:-1]])
        restarted = (np.diff(times) <= 0.0) | ~np.concatenate([[self._touching], touching[:-1]])
        before[restarted] = points[restarted]
        self._end, self._time, self._touching = points[-1], float(times[-1]), bool(touching[-1])
        columns = rr.LineStrips3D.columns(strips=list(np.stack([before, points], axis=1)[touching]))
        yield self.path, columns if touching.all() else columns.partition(touching.astype(int))


class _PointTrace(Trace):
    """The trace of a point of a part."""

    def __init__(self, name: str, at: Attachment, color: palette.Color, radius: float) -> None:
        super().__init__(paths.trace(name), color, radius)
        self._at = at

    def columns(self, rows: Rows, poses: PartPoses) -> LoggedItems:
        yield from self.columns_through(rows, poses.point(self._at), np.ones(len(rows), dtype=bool))


MIN_SINE = 0.05  # of the angle between a wheel and its plane: a wheel that lies flat touches with all its rim


def constraint_entities(scene: SceneDescription) -> Iterator[Entity]:
    """The points of constraints; their rods and ropes are connectors, their curves and lines wires."""
    size = scene.extent.size
    for constraint in scene.mechanism.constraints:
        path = paths.in_world("constraints", constraint.name)
        match constraint:
            case Rolling():
                yield _RollingContact(scene, constraint)
            case Surface(law=ContactLaw()):
                pass  # its point is drawn while it touches, as that of all contacts
            case Flat(point=point) | KnifeEdge(point=point) | Surface(point=point):
                yield _Point(path, point, size)
            case Distance() | Cable():
                pass  # a connector
            case Coupling() | Clutch():
                pass  # visible in the motion of its joints only
            case _:
                assert_never(constraint)


class _Point:
    """A constrained point."""

    def __init__(self, path: str, point: Attachment, size: float) -> None:
        self._path, self._point, self._size = path, point, size

    def static(self) -> LoggedItems:
        yield self._path, rr.Points3D.from_fields(radii=[0.014 * self._size], colors=[palette.CLOSING])

    def columns(self, rows: Rows, poses: PartPoses) -> LoggedItems:
        yield self._path, rr.Points3D.columns(positions=poses.point(self._point))


class _RollingContact:
    """The point at which a wheel or a ball touches its plane, and the track that it leaves there while it touches.

    The point of a wheel that can lift off is shown by `contact_entities`.
    """

    def __init__(self, scene: SceneDescription, constraint: Rolling) -> None:
        self._scene, self._constraint, self._size = scene, constraint, scene.extent.size
        self._path = paths.in_world("contacts", constraint.name)
        self._track = Trace(paths.trace(constraint.name), palette.CONTACT, 0.003 * self._size)

    def static(self) -> LoggedItems:
        if self._constraint.law is None:
            yield self._path, rr.Points3D.from_fields(radii=[0.014 * self._size], colors=[palette.CONTACT])
        yield from self._track.static()

    def columns(self, rows: Rows, poses: PartPoses) -> LoggedItems:
        touched = contact(self._constraint, poses)
        if self._constraint.law is None:
            yield self._path, rr.Points3D.columns(positions=touched)
        closed = is_closed(self._scene, ("constraints", self._constraint.name), rows)
        yield from self._track.columns_through(rows, touched, closed)


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
    """A point (3,) and the normal (3,) of the first plane of ground that something rolls, slides or falls on."""
    for constraint in scene.mechanism.constraints:
        if isinstance(constraint, Rolling) and constraint.plane.part == GROUND:
            return constraint.plane.point, constraint.normal
        if isinstance(constraint, Flat) and constraint.base.part == GROUND and len(constraint.normals) == 1:
            return constraint.base.point, constraint.normals[0]
    for contact in scene.mechanism.contacts:
        if isinstance(contact.second, Face) and contact.second.at.part == GROUND:
            return contact.second.at.point, contact.second.normal
    return None
