"""The box that a mechanism and its motion fill: it determines the camera, the grid and the sizes of markers."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from mbd_sim.base.errors import DivergedError
from mbd_sim.base.geometry.pose import Array, Pose, identity_pose, unpack_poses
from mbd_sim.mechanism.elements.parts import GROUND, Part, Shape
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.pictures.shapes.meshes import part_triangles
from mbd_sim.pictures.shapes.solids import half_sizes
from mbd_sim.simulation.kernel.memory import KernelMemory

if TYPE_CHECKING:
    from mbd_sim.simulation.model.model import Model

PREVIEW_TIME = 5.0  # s
PREVIEW_STEPS, SLOT_STEPS, TIME_STEPPING_STEPS = 5_000, 1_000, 100
PREVIEW_FRAMES = 100
VIEWER = (1.0, -1.3, 1.1)  # from where mechanisms are seen
PLANE_TOLERANCE = 1e-6  # of the sines between axes and the normal of a plane


@dataclass(frozen=True, eq=False)
class Extent:
    """The box from `lower` to `upper` (3,) that the motion fills, in ground's frame in m.

    `size` is the length in m of the mechanism at the start; markers are sized relative to it. `normal` (3,) is the unit
    normal of the plane of motion, None for spatial mechanisms. `travel` holds the smallest and the largest displacement
    in m of each prismatic and cylindrical joint. `up` (3,) is the axis of ground that a page shows upward.
    """

    lower: Array
    upper: Array
    size: float
    normal: Array | None
    travel: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    up: Array = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))

    @property
    def center(self) -> Array:
        """The center of the box, (3,)."""
        return (self.lower + self.upper) / 2.0

    @property
    def toward(self) -> Array | None:
        """The unit normal (3,) of the plane of motion that points to the viewer; None for spatial mechanisms."""
        if self.normal is None:
            return None
        return self.normal * (1.0 if self.normal @ np.array(VIEWER) > 0.0 else -1.0)

    def in_front(self, points: Array, moved: Array) -> Array:
        """Points (..., n, 3), of a plane mechanism those that are `moved` (n,) to the front of all parts.

        Where bodies of some thickness touch, the point would be hidden between them.
        """
        if (toward := self.toward) is None:
            return points
        front = float(np.sum(np.maximum(self.lower * toward, self.upper * toward)))
        return points + np.where(moved, front - points @ toward, 0.0)[..., None] * toward


def extent_of(model: Model) -> Extent:
    """Find the extent from the start and the first seconds of motion without efforts, which take milliseconds.

    The motion counts up to three times the box of the start, so that parts that fly away do not take the camera along.
    """
    source = model.mechanism.source.file
    corners = {name: _corners(part) for name, part in model.mechanism.parts.items()}
    for name, part in model.mechanism.parts.items():
        if part.meshes and not part.shapes:  # meshes are read only where they must be
            corners[name] = _mesh_corners(part, source, corners[name])
    fixed = [pose.position for pose in model.mechanism.ground_points.values()]
    fixed += [joint.parent_pose.position for joint in model.mechanism.all_joints.values() if joint.parent == GROUND]
    times, states = _preview(model)
    frames = [model.pose_array(time, y) for time, y in zip(times, states, strict=True)]
    points = [_points_in_ground(frame, model.part_names, corners) for frame in frames]
    start = np.vstack([points[0], *fixed]) if fixed else points[0]
    lower, upper = start.min(axis=0), start.max(axis=0)
    size = max(float(np.max(upper - lower)), 1e-6)
    limits = (lower + upper) / 2.0 - 1.5 * size, (lower + upper) / 2.0 + 1.5 * size
    reached = np.clip(np.vstack(points), *limits)
    return Extent(
        np.minimum(lower, reached.min(axis=0)),
        np.maximum(upper, reached.max(axis=0)),
        size,
        plane_normal(model.mechanism, model.poses(0.0, model.start)),
        _travel(model, frames, size),
        upward(model.mechanism.gravity),
    )


def upward(gravity: Array) -> Array:
    """The axis (3,) of ground that is upward: z, unless gravity acts along another axis, as in imported assemblies."""
    along = np.flatnonzero(np.abs(gravity) > PLANE_TOLERANCE * np.linalg.norm(gravity))
    found = np.array([0.0, 0.0, 1.0])
    if len(along) == 1:
        found = np.zeros(3)
        found[along] = -np.sign(gravity[along])
    return found


def _preview(model: Model) -> tuple[list[float], list[Array]]:
    """Times and states at the start and in the seconds after it, without efforts; less of costly contacts."""
    memory, step = KernelMemory(model, model.mechanism.step), model.mechanism.step
    times, states = [0.0], [memory.y.copy()]
    last = min(round(PREVIEW_TIME / step), _most_steps(model))
    stride = max(last // PREVIEW_FRAMES, 1)
    with suppress(DivergedError):  # contacts without a solution
        memory.find_modes()
        while memory.steps < last and memory.advance(stride):
            times.append(memory.time)
            states.append(memory.y.copy())
    return times, states


def _most_steps(model: Model) -> int:
    """Up to which a preview takes at most about a second."""
    if model.one_sided is None:
        return PREVIEW_STEPS
    if model.method.time_stepping:
        return TIME_STEPPING_STEPS
    return PREVIEW_STEPS if model.one_sided.features is None else SLOT_STEPS


def _travel(model: Model, frames: list[Array], size: float) -> dict[str, tuple[float, float]]:
    """The range of displacements of each joint, in m; at most the size of the mechanism on both sides of the start."""
    rows = np.array(frames)
    poses = {name: unpack_poses(rows[:, index]) for index, name in enumerate(model.part_names)}
    poses[GROUND] = np.zeros((len(frames), 3)), np.tile(np.eye(3), (len(frames), 1, 1))
    travel = {}
    for name, joint in model.mechanism.all_joints.items():
        if not joint.kind.slides_along_axis:
            continue
        parent, child = (
            poses[part][0] + poses[part][1] @ frame.position
            for part, frame in ((joint.parent, joint.parent_pose), (joint.child, joint.child_pose))
        )
        axes = poses[joint.parent][1] @ joint.parent_pose.rotation @ joint.axis
        displacement = np.sum((child - parent) * axes, axis=1)
        displacement = np.clip(displacement, displacement[0] - size, displacement[0] + size)
        travel[name] = (float(displacement.min()), float(displacement.max()))
    return travel


def _points_in_ground(frame: Array, names: tuple[str, ...], corners: dict[str, Array]) -> Array:
    poses = zip(names, *unpack_poses(frame), strict=True)
    points = [position + corners[name] @ rotation.T for name, position, rotation in poses]
    return np.vstack(points or [np.zeros((1, 3))])


def _corners(part: Part) -> Array:
    """Points (n, 3) in the part's frame that bound it."""
    points = [part.center, *(pose.position for pose in part.points.values())]
    for shape in part.shapes:
        points += list(_box_corners(shape))
    return np.array(points)


def bounding_points(part: Part, source: str) -> Array:
    """Points (n, 3) in the part's frame, whose box encloses its shapes, or its meshes where it has none; may be empty.

    :param source: the file of the mechanism, from whose folder the files of meshes are found.
    """
    points = [np.zeros((0, 3)), *map(_box_corners, (*part.shapes, *(part.collisions or ())))]
    if len(points) == 1:
        points += [triangles.reshape(-1, 3) for _, triangles in part_triangles(part, source)]
    return np.vstack(points)


def _box_corners(shape: Shape) -> Array:
    """The corners (8, 3) of the box around a shape."""
    signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
    return np.asarray(shape.pose.position + (signs * half_sizes(shape)) @ shape.pose.rotation.T)


def _mesh_corners(part: Part, source: str, corners: Array) -> Array:
    """Points (n, 3) in the part's frame that bound it and its meshes."""
    meshes = [triangles.reshape(-1, 3) for _, triangles in part_triangles(part, source)]
    return np.vstack([corners, *(end for points in meshes for end in (points.min(axis=0), points.max(axis=0)))])


def plane_normal(mechanism: Mechanism, poses: Mapping[str, Pose]) -> Array | None:
    """The unit normal (3,) of the plane in which all joints move; None where there is no such plane."""
    turns: list[Array] = []
    slides: list[Array] = []
    for joint in mechanism.all_joints.values():
        axis = frame_of(poses, joint.parent, joint.parent_pose).rotation @ joint.axis
        if joint.kind.planar_freedoms is None:
            return None
        if joint.kind.rotates:
            turns.append(axis)
        elif joint.kind.slides:
            slides.append(axis)
    if not turns and not slides:
        return None
    # With slides alone there may be several such planes: prefer the vertical one through x.
    for normal in turns[:1] or list(np.eye(3)[[1, 2, 0]]) + [unit for s in slides if (unit := _across(s)) is not None]:
        turned = all(float(np.linalg.norm(np.cross(axis, normal))) < PLANE_TOLERANCE for axis in turns)
        if turned and all(abs(float(axis @ normal)) < PLANE_TOLERANCE for axis in slides):
            return np.asarray(normal)
    return None


def frame_of(poses: Mapping[str, Pose], part: str, frame: Pose) -> Pose:
    """A frame of a part, or of ground, in ground's frame."""
    return (identity_pose() if part == GROUND else poses[part]) @ frame


def _across(axis: Array) -> Array | None:
    across = np.cross([0.0, 0.0, 1.0], axis)
    length = float(np.linalg.norm(across))
    return across / length if length > PLANE_TOLERANCE else None
