"""The forces and couples that samples contain, for each viewer that draws them as arrows and arcs.

They are the forces of the file, commanded ones, and those that joints transmit. Their lengths are to scale up to
`LONGEST`. An arrow of `LONG` times the mechanism's size stands for the largest value of the expression for forces of
the file, for the limit of efforts that have one, and otherwise for the weight of all parts (for couples, that weight
times a quarter of the size).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from mbd_sim.base.errors import InputError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.mechanism.elements.forces import AppliedForce
from mbd_sim.mechanism.elements.parts import Attachment, Joint
from mbd_sim.mechanism.mass_properties import value_at
from mbd_sim.pictures.rerun.scene import PartPoses, Rows, SceneDescription, weight
from mbd_sim.pictures.shapes import palette
from mbd_sim.pictures.shapes.joints import LONG, LONGEST, joint_radius
from mbd_sim.pictures.shapes.palette import Color

THRESHOLD = 2e-3  # relative to the value drawn at full length; nothing smaller is drawn
PREVIEW_TIME = 5.0  # s of an expression in which its largest value is sought
SWEEP, MAX_SWEEP = np.radians(240.0), np.radians(330.0)  # of the arc of a couple


@dataclass(frozen=True)
class ArrowScale:
    """How a force or a `couple` is drawn: its kind and the name of its element, its color and its scale."""

    kind: str
    name: str
    couple: bool
    color: Color
    size: float  # of the mechanism, m
    full_scale: float  # N or N·m that are drawn at full length
    radius: float = 0.1  # of an arc, relative to the size

    def visible(self, vectors: Array) -> tuple[Array, Array]:
        """Which of the vectors (n, 3) are large enough to be drawn, and their magnitudes (n,)."""
        magnitudes = np.linalg.norm(vectors, axis=1)
        return magnitudes > THRESHOLD * self.full_scale, magnitudes

    def arrows(self, vectors: Array) -> Array:
        """Forces (n, 3) in N as arrows (n, 3) in m."""
        drawn, force = self.visible(vectors)
        length = np.minimum(LONG * force / self.full_scale, LONGEST) * self.size / np.where(drawn, force, 1.0)
        return np.asarray(length[:, None] * vectors)

    def sweep(self, couple: float) -> float:
        """The angle in rad of the arc of a couple in N·m."""
        return float(min(SWEEP * couple / self.full_scale, MAX_SWEEP))


class ShownLoad(Protocol):
    """A force, a couple, or both, in all samples."""

    @property
    def scales(self) -> tuple[ArrowScale, ...]:
        """How each of its vectors is drawn."""

    def vectors(self, rows: Rows, poses: PartPoses) -> Iterator[tuple[Array, Array]]:
        """For each of `scales` the points (n, 3) at which it acts in ground's frame, and the vectors (n, 3)."""


def loads(scene: SceneDescription) -> Iterator[ShownLoad]:
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


class _Applied:
    """A force or a couple of the file, evaluated at the times of the samples."""

    def __init__(self, scene: SceneDescription, force: AppliedForce) -> None:
        self._force, self._scene = force, scene
        largest = weight(scene)
        if not any(component.state for component in force.vector):
            vectors = [self._vector(time, np.zeros(0)) for time in np.linspace(0.0, PREVIEW_TIME, 101)]
            largest = float(np.linalg.norm(vectors, axis=1).max()) or 1.0
        self.scales = (ArrowScale("forces", force.name, force.couple, palette.APPLIED, scene.extent.size, largest),)

    def vectors(self, rows: Rows, poses: PartPoses) -> Iterator[tuple[Array, Array]]:
        values = np.array([self._vector(*row) for row in zip(rows.motion_times.tolist(), rows.of("y"), strict=True)])
        yield poses.point(self._force.at), poses.direction(self._force.axes_of, values)

    def _vector(self, time: float, y: Array) -> Array:
        mechanism, vector = self._scene.mechanism, self._force.vector
        try:
            return np.asarray(self._force.axes @ [value_at(mechanism, one, time, y) for one in vector])
        except InputError:
            return np.zeros(3)


class _Wrench:
    """The wrench commanded on a part."""

    def __init__(self, scene: SceneDescription, part: str) -> None:
        self._part, self._slice = part, scene.wrenches[part]
        full, size = weight(scene), scene.extent.size
        self.scales = (
            ArrowScale("wrenches", part, False, palette.COMMANDED, size, full),
            ArrowScale("wrenches", part, True, palette.COMMANDED, size, 0.25 * full * size),
        )

    def vectors(self, rows: Rows, poses: PartPoses) -> Iterator[tuple[Array, Array]]:
        force, couple, own_force, own_couple, point = np.split(rows.of("inputs")[:, self._slice], 5, axis=1)
        rotated = poses.rotations(self._part)
        origin = poses.point(Attachment(self._part, np.zeros(3)))
        at = origin + np.einsum("nij,nj->ni", rotated, point)
        yield at, force + np.einsum("nij,nj->ni", rotated, own_force)
        yield at, couple + np.einsum("nij,nj->ni", rotated, own_couple)


class _Effort:
    """The effort commanded on a joint, as it acts on the child."""

    def __init__(self, scene: SceneDescription, joint: Joint) -> None:
        self._joint, self._slice = joint, scene.u[joint.name]
        size, limit = scene.extent.size, joint.effort_limit
        radius = max(2.6 * joint_radius(scene.mechanism, joint, size) / size, 0.06)
        full = {False: limit or weight(scene), True: limit or 0.25 * weight(scene) * size}
        self.scales = tuple(
            ArrowScale("efforts", joint.name, couple, palette.COMMANDED, size, full[couple], radius if couple else 0.1)
            for couple in sorted({coordinate.rotation for coordinate in joint.kind.coordinates})
        )

    def vectors(self, rows: Rows, poses: PartPoses) -> Iterator[tuple[Array, Array]]:
        joint, sums = self._joint, (np.zeros((len(rows), 3)), np.zeros((len(rows), 3)))
        for coordinate, values in zip(joint.kind.coordinates, rows.of("inputs")[:, self._slice].T, strict=True):
            part, frame = (joint.child, joint.child_pose) if coordinate.on_child else (joint.parent, joint.parent_pose)
            direction = poses.direction(part, frame.rotation @ joint.direction(coordinate))
            sums[int(coordinate.rotation)][:] += direction * values[:, None]
        at = poses.point(Attachment(joint.child, joint.child_pose.position))
        for scale in self.scales:
            yield at, sums[int(scale.couple)]


class _Reaction:
    """The force through a joint on the child."""

    def __init__(self, scene: SceneDescription, index: int, joint: Joint) -> None:
        self._index, self._joint = index, joint
        style = ArrowScale("reactions", joint.name, False, palette.REACTION, scene.extent.size, weight(scene))
        self.scales = (style,)

    def vectors(self, rows: Rows, poses: PartPoses) -> Iterator[tuple[Array, Array]]:
        forces = rows.of("reactions")[:, 6 * self._index : 6 * self._index + 3]
        yield poses.point(Attachment(self._joint.child, self._joint.child_pose.position)), forces
