"""A frame placed in another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.linear_algebra import product
from mbd_sim.base.short_repr import short_repr

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, init=False)
class Pose:
    """A frame placed in another: `position` (3,) in m, `rotation` (3, 3) orthonormal."""

    position: Array
    rotation: Array

    __repr__ = short_repr

    def __init__(self, position: Array, rotation: Array) -> None:
        own = self.__dict__  # in half the time of what a frozen dataclass generates
        own["position"], own["rotation"] = position, rotation

    def __matmul__(self, inner: Pose) -> Pose:
        return Pose(self.position + product(self.rotation, inner.position), product(self.rotation, inner.rotation))

    def inverse(self) -> Pose:
        """The pose of the outer frame in the inner frame."""
        return Pose(product(-self.rotation.T, self.position), self.rotation.T)


def identity_pose() -> Pose:
    """The pose of a frame that coincides with its outer frame."""
    return Pose(np.zeros(3), np.eye(3))


def pack_poses(positions: Array, rotations: Array) -> Array:
    """Pose rows (..., 12), as kernels write them: the position in m, then the rotation matrix column by column."""
    columns = np.swapaxes(rotations, -1, -2)
    return np.concatenate([positions, columns.reshape(*columns.shape[:-2], 9)], axis=-1)


def unpack_poses(rows: Array) -> tuple[Array, Array]:
    """Positions (..., 3) in m and rotation matrices (..., 3, 3), as views of pose rows (..., 12): see `pack_poses`."""
    return rows[..., :3], rows[..., 3:].reshape(*rows.shape[:-1], 3, 3).swapaxes(-1, -2)
