"""The direction of view, and the projection from meters in space to points on the sheet."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mbd_sim.geometry.pose import Array, Pose, identity_pose
from mbd_sim.mechanism.records import GROUND, Mechanism

AZIMUTH, ELEVATION = np.radians(-62.0), np.radians(24.0)  # of the eye, for spatial mechanisms
TOLERANCE = 1e-6


@dataclass(frozen=True, eq=False)
class View:
    """An orthographic view: unit vectors (3,) to the `right`, `up`, and `toward` the eye, in ground's frame.

    `planar` means that all motion is perpendicular to `toward`.
    """

    right: Array
    up: Array
    toward: Array
    planar: bool


@dataclass(frozen=True, eq=False)
class Page:
    """A view at a scale, in points per meter."""

    view: View
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


def view_of(mechanism: Mechanism, poses: Mapping[str, Pose]) -> View:
    """The view along the common axis of a planar mechanism, otherwise an oblique one."""
    normal = plane_normal(mechanism, poses)
    if normal is None:
        toward = np.array([np.cos(ELEVATION) * np.cos(AZIMUTH), np.cos(ELEVATION) * np.sin(AZIMUTH), np.sin(ELEVATION)])
        right = np.array([-np.sin(AZIMUTH), np.cos(AZIMUTH), 0.0])
        return View(right, np.cross(toward, right), toward, planar=False)
    vertical = np.array([0.0, 0.0, 1.0])
    if np.linalg.norm(np.cross(normal, vertical)) < TOLERANCE:
        return View(np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]), vertical, planar=True)
    right = np.cross(vertical, normal)
    right /= np.linalg.norm(right)
    first = right[np.flatnonzero(np.abs(right) > TOLERANCE)[0]]  # x to the right, or else y
    toward = normal if first > 0.0 else -normal
    right = right if first > 0.0 else -right
    return View(right, np.cross(toward, right), toward, planar=True)


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
        turned = all(float(np.linalg.norm(np.cross(axis, normal))) < TOLERANCE for axis in turns)
        if turned and all(abs(float(axis @ normal)) < TOLERANCE for axis in slides):
            return np.asarray(normal)
    return None


def frame_of(poses: Mapping[str, Pose], part: str, frame: Pose) -> Pose:
    """A frame of a part, or of ground, in ground's frame."""
    return (identity_pose() if part == GROUND else poses[part]) @ frame


def _across(axis: Array) -> Array | None:
    across = np.cross([0.0, 0.0, 1.0], axis)
    length = float(np.linalg.norm(across))
    return across / length if length > TOLERANCE else None
