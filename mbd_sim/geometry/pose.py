"""A frame placed in another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Pose:
    """A frame placed in another: `position` (3,) in metres, `rotation` (3, 3) orthonormal."""

    position: Array
    rotation: Array

    def __matmul__(self, inner: Pose) -> Pose:
        return Pose(self.position + self.rotation @ inner.position, self.rotation @ inner.rotation)

    def inverse(self) -> Pose:
        """The outer frame placed in the inner one."""
        return Pose(-self.rotation.T @ self.position, self.rotation.T)


def identity_pose() -> Pose:
    """A frame that coincides with its outer frame."""
    return Pose(np.zeros(3), np.eye(3))
