"""Points and directions of parts for many samples at once, in ground's frame."""

from __future__ import annotations

import numpy as np

from mbd_sim.geometry.pose import Array
from mbd_sim.geometry.rotation import quaternions
from mbd_sim.mechanism.records import GROUND, Attachment
from mbd_sim.viewer.sample_rows import Rows
from mbd_sim.viewer.scene_description import SceneDescription

MIN_LENGTH = 1e-9  # m, below which two points count as one


class PartPoses:
    """The poses of the parts in each of n samples."""

    def __init__(self, scene: SceneDescription, rows: Rows) -> None:
        self._index = {name: index for index, name in enumerate(scene.part_names)}
        self._rows = rows

    def point(self, at: Attachment) -> Array:
        """A point of a part in ground's frame, (n, 3)."""
        if at.part == GROUND:
            return np.broadcast_to(at.point, (len(self._rows), 3))
        index = self._index[at.part]
        return np.asarray(self._rows.positions[:, index] + self._rows.rotations[:, index] @ at.point)

    def direction(self, part: str, direction: Array) -> Array:
        """A direction (3,) or (n, 3) in the frame of a part, in ground's axes (n, 3)."""
        along = np.broadcast_to(direction, (len(self._rows), 3))
        if part == GROUND:
            return along
        rotated: Array = np.einsum("nij,nj->ni", self._rows.rotations[:, self._index[part]], along)
        return rotated

    def rotations(self, part: str) -> Array:
        """The rotation matrices (n, 3, 3) of a part."""
        if part == GROUND:
            return np.broadcast_to(np.eye(3), (len(self._rows), 3, 3))
        return self._rows.rotations[:, self._index[part]]


def line_transforms(starts: Array, stops: Array, across: Array) -> tuple[Array, Array]:
    """Lengths (n,) of the lines from start to stop, and quaternions (n, 4) x, y, z, w that rotate z onto them.

    x is as close to `across` (3,) as possible, so that a drawn object does not spin about its line.
    """
    line = stops - starts
    length = np.linalg.norm(line, axis=1)
    nonzero = length > MIN_LENGTH
    z = np.where(nonzero[:, None], line / np.where(nonzero, length, 1.0)[:, None], [0.0, 0.0, 1.0])
    x = across - (z @ across)[:, None] * z
    short = np.linalg.norm(x, axis=1) < 1e-3
    if np.any(short):
        other = np.eye(3)[int(np.argmin(np.abs(across)))]
        x[short] = other - (z[short] @ other)[:, None] * z[short]
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    return length, quaternions(np.stack([x, np.cross(z, x), z], axis=2))


def transverse_direction(scene: SceneDescription, direction: Array) -> Array:
    """A direction (3,) across a line along `direction` (3,): the normal of the plane of motion where there is one."""
    normal = scene.extent.normal
    if normal is not None:
        return normal
    return np.asarray(np.eye(3)[int(np.argmin(np.abs(direction)))])
