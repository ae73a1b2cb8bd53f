"""Rotation matrices, unit quaternions (w, x, y, z) and roll-pitch-yaw angles; rotations are right-handed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mbd_sim.base.geometry.batch import array, per_variant, uniform
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.linear_algebra import cross, norm, norms
from mbd_sim.base.linear_algebra import product as matrix_product
from mbd_sim.base.rounded import sine_cosine


def skew(v: Array) -> Array:
    """The matrix (3, 3) of the cross product: `skew(v) @ w` is v × w."""
    skewed: Array = array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    return skewed


def unit(v: Sequence[float] | Array) -> Array:
    """The vector scaled to length 1; very long and very short vectors do not overflow."""
    scaled = array(v)
    scaled = scaled / np.max(np.abs(scaled))
    found: Array = uniform(scaled / np.sqrt(matrix_product(scaled, scaled)))
    return found


def unit_or_zero(v: Array) -> Array:
    """The vector scaled to length 1, or zero if its length is below 1e-12."""
    length = norm(v)
    return v / length if length > 1e-12 else np.zeros_like(v)


@per_variant
def about(axis: Array, angle: float) -> Array:
    """The rotation matrix (3, 3) about a unit `axis` by `angle` in rad (Rodrigues' formula)."""
    k, (sine, cosine) = skew(axis), sine_cosine(angle)
    rotation: Array = np.eye(3) + sine * k + (1.0 - cosine) * matrix_product(k, k)
    return rotation


@per_variant
def from_quaternion(quaternion: Array) -> Array:
    """The rotation matrix (3, 3) of a unit quaternion (w, x, y, z)."""
    w, v = quaternion[0], quaternion[1:]
    k = skew(v)
    rotation: Array = np.eye(3) + 2.0 * (w * k + matrix_product(k, k))
    return rotation


@per_variant
def to_quaternion(rotation: Array) -> Array:
    """The unit quaternion (w, x, y, z) with w ≥ 0 of a rotation matrix (3, 3) (Shepperd's method)."""
    r = rotation
    squares = np.array([1.0 + np.trace(r), *(1.0 + 2.0 * r[i, i] - np.trace(r) for i in range(3))])
    largest = int(np.argmax(squares))
    if largest == 0:
        q = np.array([squares[0], r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
    else:
        i, j, k = largest - 1, largest % 3, (largest + 1) % 3
        q = np.empty(4)
        q[0] = r[k, j] - r[j, k]
        q[1 + i], q[1 + j], q[1 + k] = squares[largest], r[j, i] + r[i, j], r[k, i] + r[i, k]
    q /= norm(q)
    return q if q[0] >= 0.0 else -q


def product(first: Array, second: Array) -> Array:
    """The quaternion (w, x, y, z) of the rotation `second` followed by `first`."""
    v, w = first[1:], second[1:]
    scalar = first[0] * second[0] - matrix_product(v, w)
    return np.array([scalar, *(first[0] * w + second[0] * v + np.cross(v, w))])


def of_vector(vector: Array) -> Array:
    """The unit quaternion (w, x, y, z) of a rotation vector (3,): axis times angle in rad."""
    angle = norm(vector)
    sine, cosine = sine_cosine(0.5 * angle)
    return np.array([cosine, *((sine / angle if angle else 0.5) * vector)])


def rotation_vector(quaternion: Array) -> Array:
    """Axis times angle (3,) in rad, at most π long, of a unit quaternion (w, x, y, z)."""
    w, v = (quaternion[0], quaternion[1:]) if quaternion[0] >= 0.0 else (-quaternion[0], -quaternion[1:])
    sine = norm(v)
    return v * (2.0 * np.arctan2(sine, w) / sine if sine > 1e-9 else 2.0)


def quaternions(matrices: Array) -> Array:
    """The unit quaternions (n, 4) in the order (x, y, z, w) of ROS and Rerun, of rotation matrices (n, 3, 3).

    Each matrix uses the one of four formulas with the largest divisor (Shepperd's method).
    """
    m = matrices
    xx, yy, zz = m[:, 0, 0], m[:, 1, 1], m[:, 2, 2]
    x, y, z = m[:, 2, 1] - m[:, 1, 2], m[:, 0, 2] - m[:, 2, 0], m[:, 1, 0] - m[:, 0, 1]
    xy, yz, zx = m[:, 0, 1] + m[:, 1, 0], m[:, 1, 2] + m[:, 2, 1], m[:, 2, 0] + m[:, 0, 2]
    ways = np.stack(
        [
            np.stack([1.0 + xx - yy - zz, xy, zx, x], axis=1),
            np.stack([xy, 1.0 - xx + yy - zz, yz, y], axis=1),
            np.stack([zx, yz, 1.0 - xx - yy + zz, z], axis=1),
            np.stack([x, y, z, 1.0 + xx + yy + zz], axis=1),
        ],
        axis=1,
    )
    best = np.argmax(np.diagonal(ways, axis1=1, axis2=2), axis=1)
    chosen: Array = ways[np.arange(len(m)), best]
    chosen /= norms(chosen)[:, None]
    return chosen


@per_variant
def aligning_z(axis: Array) -> Array:
    """A rotation matrix (3, 3) that maps z to the unit `axis`; its entries are exact for coordinate axes."""
    if np.count_nonzero(axis) == 1:
        index, sign = int(np.flatnonzero(axis)[0]), float(np.sign(axis[np.flatnonzero(axis)[0]]))
        columns = np.zeros((3, 3))
        columns[index, 2] = sign
        columns[(index + 1) % 3, 0] = 1.0
        columns[(index + 2) % 3, 1] = sign
        return columns
    x = cross(np.eye(3)[int(np.argmin(np.abs(axis)))], axis)
    x /= norm(x)
    return np.column_stack([x, cross(axis, x), axis])


@per_variant
def from_rpy(roll: float, pitch: float, yaw: float) -> Array:
    """The matrix (3, 3) of rotations about fixed x by roll, fixed y by pitch, fixed z by yaw, in rad, as in URDF."""
    x, y, z = np.eye(3)
    turned: Array = matrix_product(matrix_product(about(z, yaw), about(y, pitch)), about(x, roll))
    return turned


def to_rpy(rotation: Array) -> tuple[float, float, float]:
    """Roll, pitch and yaw in rad of a rotation matrix (3, 3); the inverse of `from_rpy`.

    Roll is computed with yaw undone, so that the angles stay consistent as the pitch approaches a right angle.
    """
    r = rotation
    yaw = np.arctan2(r[1, 0], r[0, 0])
    pitch = np.arctan2(-r[2, 0], np.hypot(r[0, 0], r[1, 0]))
    sine, cosine = np.sin(yaw), np.cos(yaw)
    roll = np.arctan2(sine * r[0, 2] - cosine * r[1, 2], cosine * r[1, 1] - sine * r[0, 1])
    return float(roll), float(pitch), float(yaw)
