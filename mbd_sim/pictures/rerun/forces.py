"""Springs, dampers, rods and ropes between points, forces as arrows, and couples as arcs.

A coil is logged once, one meter long; after that only the transform that stretches it is sent.

Arrows show the forces of the file, commanded ones, and those that joints transmit. Their lengths are to scale up to
`LONGEST`. An arrow of `LONG` times the mechanism's size stands for the largest value of the expression for forces of
the file, for the limit of efforts that have one, and otherwise for the weight of all parts (for couples, that weight
times a quarter of the size).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import assert_never

import numpy as np
import rerun as rr

from mbd_sim.base.errors import InputError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.mechanism.elements.forces import AppliedForce
from mbd_sim.mechanism.elements.parts import Attachment, Joint
from mbd_sim.mechanism.mass_properties import value_at
from mbd_sim.mechanism.values.source import Location
from mbd_sim.pictures.rerun import paths
from mbd_sim.pictures.rerun.scene import (
    MIN_LENGTH,
    Entity,
    LoggedItems,
    PartPoses,
    Rows,
    SceneDescription,
    line_transforms,
    transverse_direction,
)
from mbd_sim.pictures.shapes import joints, palette, solids
from mbd_sim.pictures.shapes.joints import LONG, LONGEST, joint_radius
from mbd_sim.pictures.shapes.palette import Color
from mbd_sim.pictures.shapes.primitives import Connector, connectors
from mbd_sim.pictures.shapes.solids import arc_arrow

LINE_RADIUS = -1.6  # negative: in points on the screen, which no transform stretches
ASPECT = 6.0  # length of a cylinder by its radius
FAINT = 0.6  # share of the background in the color of a rope that is slack


def connector_entities(scene: SceneDescription) -> Iterator[Entity]:
    """All springs, dampers and actuators between points, rods and ropes."""
    poses = scene.start_poses
    for connector in connectors(scene.mechanism, scene.extent, poses):
        match connector.form:
            case "coil":
                yield _Coil(scene, connector)
            case "cylinder":
                yield _Cylinder(scene, connector)
            case "line":
                yield _StraightLine(scene, connector)
            case _:
                assert_never(connector.form)


class _Stretched:
    """A connector of two points, drawn along z and stretched by a transform."""

    def __init__(self, scene: SceneDescription, connector: Connector) -> None:
        self.path, self._connector = paths.in_world(connector.kind, connector.name), connector
        self._first, self._second = connector.points
        line = scene.at_start(self._second) - scene.at_start(self._first)
        self._transverse = transverse_direction(scene, line)

    def _line(self, poses: PartPoses) -> tuple[Array, Array, Array]:
        """The starts (n, 3), and the lengths (n,) and quaternions (n, 4) of `line_transforms`."""
        starts, stops = poses.point(self._first), poses.point(self._second)
        return starts, *line_transforms(starts, stops, self._transverse)

    def _stretched(self, path: str, starts: Array, lengths: Array, quaternions: Array) -> LoggedItems:
        """The transforms that stretch an object along z from 0 to 1 m to these lengths."""
        scale = np.column_stack([np.ones_like(lengths), np.ones_like(lengths), np.maximum(lengths, MIN_LENGTH)])
        yield path, rr.Transform3D.columns(translation=starts, quaternion=quaternions, scale=scale)


class _Coil(_Stretched):
    def static(self) -> LoggedItems:
        coil = solids.coil(self._connector.radius)
        yield f"{self.path}/coil", rr.LineStrips3D([coil], radii=[LINE_RADIUS], colors=[self._connector.color])

    def columns(self, rows: Rows, poses: PartPoses) -> LoggedItems:
        yield from self._stretched(self.path, *self._line(poses))


class _Cylinder(_Stretched):
    """A rod through a cylinder of constant length."""

    def static(self) -> LoggedItems:
        rod = rr.LineStrips3D([[(0.0, 0.0, 0.0), (0.0, 0.0, 1.0)]], radii=[LINE_RADIUS], colors=[palette.SPRING])
        yield f"{self.path}/rod/line", rod
        radius, color = self._connector.radius, self._connector.color
        cylinder = rr.Cylinders3D(lengths=[ASPECT * radius], radii=[radius], colors=[color], fill_mode="solid")
        yield f"{self.path}/cylinder/body", cylinder

    def columns(self, rows: Rows, poses: PartPoses) -> LoggedItems:
        starts, lengths, quaternions = self._line(poses)
        yield from self._stretched(f"{self.path}/rod", starts, lengths, quaternions)
        middle = 0.5 * (starts + poses.point(self._second))
        yield f"{self.path}/cylinder", rr.Transform3D.columns(translation=middle, quaternion=quaternions)


class _StraightLine:
    """Straight lines from point to point, faint while they are slack."""

    def __init__(self, scene: SceneDescription, connector: Connector) -> None:
        self._path, self._connector, self._scene = paths.in_world(connector.kind, connector.name), connector, scene

    def static(self) -> LoggedItems:
        connector = self._connector
        fixed = None if connector.slackens else [connector.color]
        yield self._path, rr.LineStrips3D.from_fields(radii=[connector.radius], colors=fixed)
        ends = rr.Points3D.from_fields(radii=[1.8 * connector.radius], colors=[connector.color])
        yield f"{self._path}/ends", ends

    def columns(self, rows: Rows, poses: PartPoses) -> LoggedItems:
        connector = self._connector
        slices = np.stack([poses.point(at) for at in connector.points], axis=1)
        colors = None
        if connector.slackens:
            closed = is_closed(self._scene, (connector.kind, connector.name), rows)[:, None]
            faint = palette.mixed(connector.color, palette.BACKGROUND, FAINT)
            colors = np.where(closed, connector.color, faint).astype(np.uint8)
        yield self._path, rr.LineStrips3D.columns(strips=list(slices), colors=colors)
        ends = rr.Points3D.columns(positions=slices.reshape(-1, 3)).partition([len(connector.points)] * len(rows))
        yield f"{self._path}/ends", ends


def is_closed(scene: SceneDescription, owner: Location, rows: Rows) -> Array:
    """In which of the n samples (n,) the contact of an element is closed; always if it is not one-sided."""
    own = [index for other, index in scene.contacts if other == owner and index is not None]
    if not own:
        return np.ones(len(rows), dtype=bool)
    return np.asarray((rows.of("inputs")[:, own] > 0.0).any(axis=1))


SWEEP, MAX_SWEEP = np.radians(240.0), np.radians(330.0)  # of the arc of a couple
THRESHOLD = 2e-3  # relative to the value drawn at full length; nothing smaller is drawn
PREVIEW_TIME = 5.0  # s of an expression in which its largest value is sought


def arrow_entities(scene: SceneDescription) -> Iterator[Entity]:
    """All forces and couples that the samples contain."""
    for force in scene.mechanism.applied:
        yield _Applied(scene, force)
    for part in scene.wrenches:
        yield _Wrench(scene, part)
    for joint in scene.mechanism.joints.values():
        if joint.kind.coordinates and not joint.drive:
            yield _Effort(scene, joint)
    if scene.options.reactions:
        for index, joint in enumerate(scene.mechanism.all_joints.values()):
            yield _Reaction(scene, index, joint)


def weight(scene: SceneDescription) -> float:
    """The force in N that an arrow of full length stands for by default."""
    return joints.weight(scene.mechanism, scene.extent.size)


@dataclass(frozen=True)
class ArrowStyle:
    """The path, color and scale of an arrow or an arc."""

    path: str
    color: Color
    size: float  # of the mechanism, m
    full_scale: float  # N or N·m that are drawn at full length
    radius: float = 0.1  # of an arc, relative to the size

    def static(self, couple: bool) -> LoggedItems:
        """The style of an arrow, or of the arc of a `couple`."""
        radius = 0.008 * self.size
        if couple:
            yield f"{self.path}/couple", rr.LineStrips3D.from_fields(radii=[0.7 * radius], colors=[self.color])
        else:
            yield f"{self.path}/force", rr.Arrows3D.from_fields(radii=[radius], colors=[self.color])

    def force(self, origins: Array, vectors: Array, pushes: Array | None = None) -> LoggedItems:
        """Arrows at origins (n, 3), or k for each sample (n, k, 3), for vectors of the same shape in N.

        :param pushes: (k,) which of them end there instead.
        """
        samples, origins, vectors = len(vectors), origins.reshape(-1, 3), vectors.reshape(-1, 3)
        drawn, length = self._visible(vectors)
        scale = np.minimum(LONG * length / self.full_scale, LONGEST) * self.size / np.where(drawn, length, 1.0)
        counts = drawn.reshape(samples, -1).sum(axis=1)
        arrows = scale[:, None] * vectors
        if pushes is not None:
            origins = origins - np.tile(pushes, samples)[:, None] * arrows
        columns = rr.Arrows3D.columns(origins=origins[drawn].reshape(-1, 3), vectors=arrows[drawn].reshape(-1, 3))
        yield f"{self.path}/force", columns.partition(counts)

    def couple(self, centers: Array, vectors: Array) -> LoggedItems:
        """Arcs about centers (n, 3), for couples (n, 3) in N·m."""
        drawn, length = self._visible(vectors)
        strips = [
            arc_arrow(center, vector / size, min(SWEEP * size / self.full_scale, MAX_SWEEP), self.radius * self.size)
            for center, vector, size in zip(centers[drawn], vectors[drawn], length[drawn], strict=True)
        ]
        columns = rr.LineStrips3D.columns(strips=strips).partition(drawn.astype(int))
        yield f"{self.path}/couple", columns

    def _visible(self, vectors: Array) -> tuple[Array, Array]:
        length = np.linalg.norm(vectors, axis=1)
        return length > THRESHOLD * self.full_scale, length


class _Applied:
    """A force or a couple of the file, evaluated at the times of the samples."""

    def __init__(self, scene: SceneDescription, force: AppliedForce) -> None:
        self._force, self._scene = force, scene
        largest = weight(scene)
        if not any(component.state for component in force.vector):
            vectors = [self._vector(time, np.zeros(0)) for time in np.linspace(0.0, PREVIEW_TIME, 101)]
            largest = float(np.linalg.norm(vectors, axis=1).max()) or 1.0
        path = paths.in_world("forces", force.name)
        self._style = ArrowStyle(path, palette.APPLIED, scene.extent.size, largest)

    def static(self) -> LoggedItems:
        yield from self._style.static(self._force.couple)

    def columns(self, rows: Rows, poses: PartPoses) -> LoggedItems:
        values = np.array([self._vector(*row) for row in zip(rows.motion_times.tolist(), rows.of("y"), strict=True)])
        vectors = poses.direction(self._force.axes_of, values)
        at = poses.point(self._force.at)
        yield from self._style.couple(at, vectors) if self._force.couple else self._style.force(at, vectors)

    def _vector(self, time: float, y: Array) -> Array:
        mechanism, vector = self._scene.mechanism, self._force.vector
        try:
            return np.asarray(self._force.axes @ [value_at(mechanism, one, time, y) for one in vector])
        except InputError:
            return np.zeros(3)


class _Wrench:
    """The wrench commanded on a part."""

    def __init__(self, scene: SceneDescription, part: str) -> None:
        self._part, self._slice, rows = part, scene.wrenches[part], scene.rows
        self._start = rows.slices["inputs"].start
        path, full_scale, size = (
            paths.in_world("wrenches", part),
            weight(scene),
            scene.extent.size,
        )
        self._force = ArrowStyle(path, palette.COMMANDED, size, full_scale)
        self._couple = ArrowStyle(path, palette.COMMANDED, size, 0.25 * full_scale * size)

    def static(self) -> LoggedItems:
        yield from self._force.static(couple=False)
        yield from self._couple.static(couple=True)

    def columns(self, rows: Rows, poses: PartPoses) -> LoggedItems:
        force, couple, own_force, own_couple, point = np.split(rows.of("inputs")[:, self._slice], 5, axis=1)
        rotated = poses.rotations(self._part)
        origin = poses.point(Attachment(self._part, np.zeros(3)))
        at = origin + np.einsum("nij,nj->ni", rotated, point)
        yield from self._force.force(at, force + np.einsum("nij,nj->ni", rotated, own_force))
        yield from self._couple.couple(at, couple + np.einsum("nij,nj->ni", rotated, own_couple))


class _Effort:
    """The effort commanded on a joint, as it acts on the child."""

    def __init__(self, scene: SceneDescription, joint: Joint) -> None:
        self._joint, self._slice = joint, scene.u[joint.name]
        self._couples = {coordinate.rotation for coordinate in joint.kind.coordinates}
        path, size, limit = (
            paths.in_world("efforts", joint.name),
            scene.extent.size,
            joint.effort_limit,
        )
        radius = max(2.6 * joint_radius(scene.mechanism, joint, size) / size, 0.06)
        self._force = ArrowStyle(path, palette.COMMANDED, size, limit or weight(scene))
        self._couple = ArrowStyle(path, palette.COMMANDED, size, limit or 0.25 * weight(scene) * size, radius)

    def static(self) -> LoggedItems:
        for couple in sorted(self._couples):
            yield from (self._couple if couple else self._force).static(couple)

    def columns(self, rows: Rows, poses: PartPoses) -> LoggedItems:
        at = poses.point(Attachment(self._joint.child, self._joint.child_pose.position))
        force, couple = self.vectors(rows, poses)
        if False in self._couples:
            yield from self._force.force(at, force)
        if True in self._couples:
            yield from self._couple.couple(at, couple)

    def vectors(self, rows: Rows, poses: PartPoses) -> tuple[Array, Array]:
        """The force and the couple (n, 3) on the child, in ground's axes."""
        joint, sums = self._joint, (np.zeros((len(rows), 3)), np.zeros((len(rows), 3)))
        for coordinate, values in zip(joint.kind.coordinates, rows.of("inputs")[:, self._slice].T, strict=True):
            part, frame = (joint.child, joint.child_pose) if coordinate.on_child else (joint.parent, joint.parent_pose)
            direction = poses.direction(part, frame.rotation @ joint.direction(coordinate))
            sums[int(coordinate.rotation)][:] += direction * values[:, None]
        return sums


class _Reaction:
    """The force through a joint on the child."""

    def __init__(self, scene: SceneDescription, index: int, joint: Joint) -> None:
        self._index, self._joint = index, joint
        path = paths.in_world("reactions", joint.name)
        self._style = ArrowStyle(path, palette.REACTION, scene.extent.size, weight(scene))

    def static(self) -> LoggedItems:
        yield from self._style.static(couple=False)

    def columns(self, rows: Rows, poses: PartPoses) -> LoggedItems:
        forces = rows.of("reactions")[:, 6 * self._index : 6 * self._index + 3]
        at = poses.point(Attachment(self._joint.child, self._joint.child_pose.position))
        yield from self._style.force(at, forces)
