"""Builds rotation matrices from rotations as written in a file."""

from __future__ import annotations

import numpy as np

from mbd_sim.geometry.pose import Array
from mbd_sim.geometry.rotation import about, from_quaternion, from_rpy, unit
from mbd_sim.mechanism_file.schema.base_schema import RotationSpec


def rotation_matrix(rotation: RotationSpec | None) -> Array:
    """The matrix (3, 3) of a rotation; the identity for None."""
    if rotation is None:
        return np.eye(3)
    if rotation.rpy is not None:
        return from_rpy(*rotation.rpy)
    if rotation.quaternion is not None:
        return from_quaternion(unit(rotation.quaternion))
    assert rotation.axis is not None and rotation.angle is not None
    return about(unit(rotation.axis), rotation.angle)
