"""The freedoms of joints as twists (6,) = [ω; v at ground's origin] in ground's axes, and gaps of closing joints."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mbd_sim.base.geometry import rotation as rot
from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.mechanism.elements.parts import Joint


def rotation_about(axis: Array, point: Array) -> Array:
    """The twist of a rotation about an axis (3,) through a point (3,)."""
    return np.concatenate([axis, np.cross(point, axis)])


def translation_along(direction: Array) -> Array:
    """The twist of a translation."""
    return np.concatenate([np.zeros(3), direction])


def twists_of(joint: Joint, first: Pose, second: Pose) -> list[Array]:
    """The twist of the child relative to the parent for each coordinate.

    :param first: the frame of the joint on its parent, and `second` that on its child, in ground's frame.
    """
    found = []
    for coordinate in joint.kind.coordinates:
        on_child = coordinate.on_child or coordinate.direction == "second"
        direction = (second if on_child and coordinate.rotation else first).rotation @ joint.direction(coordinate)
        twist = rotation_about(direction, second.position) if coordinate.rotation else translation_along(direction)
        if joint.type == "screw":
            twist = twist + translation_along(direction) * joint.lead / (2.0 * np.pi)
        found.append(twist)
    return found


def motion(joint: Joint, q: Array) -> Pose:
    """The child's frame in the parent's for coordinates q (nq,)."""
    axis, zero, kind = joint.axis, np.zeros(3), joint.type
    match kind:
        case "revolute":
            return Pose(zero, rot.about(axis, float(q[0])))
        case "prismatic":
            return Pose(axis * q[0], np.eye(3))
        case "screw":
            return Pose(axis * (q[0] * joint.lead / (2.0 * np.pi)), rot.about(axis, float(q[0])))
        case "cylindrical":
            return Pose(axis * q[0], rot.about(axis, float(q[1])))
        case "universal":
            return Pose(zero, rot.about(axis, float(q[0])) @ rot.about(joint.second, float(q[1])))
        case "planar":
            place = joint.second * q[0] + np.cross(axis, joint.second) * q[1]
            return Pose(place, rot.about(axis, float(q[2])))
        case "spherical":
            return Pose(zero, rot.from_quaternion(q))
        case "free":
            return Pose(np.asarray(q[:3]), rot.from_quaternion(q[3:]))
    return Pose(zero, np.eye(3))


def displaced(joint: Joint, q: Array, change: Array) -> Array:
    """The coordinates (nq,) after a small displacement (nv,) along the speeds."""
    start = joint.kind.quaternion
    if start is None:
        return q + change
    turned = rot.product(q[start:], rot.of_vector(change[start:]))
    return np.concatenate([q[:start] + change[:start], turned / np.linalg.norm(turned)])


def gap_of(joint: Joint, first: Pose, second: Pose) -> tuple[Array, Array]:
    """How far two frames are from a position that a joint allows: rows (m,), and their derivatives (m, 6) by a twist.

    The twist is that of the second frame relative to the first one, with the velocity of its origin. Rows are in rad,
    and in m.
    """
    turn, shift = _error(joint, first, second), second.position - first.position
    axis = first.rotation @ joint.axis
    all_three = np.eye(3)
    sides = rot.aligning_z(rot.unit(axis))[:, :2].T if joint.axis.any() else all_three
    none = np.zeros((0, 3))
    by_turn, by_shift = {
        "revolute": (sides, all_three),
        "prismatic": (all_three, sides),
        "screw": (sides, sides),
        "cylindrical": (sides, sides),
        "universal": (none, all_three),
        "planar": (sides, axis[None, :]),
        "spherical": (none, all_three),
        "free": (none, none),
        "fixed": (all_three, all_three),
    }[joint.type]
    rows = np.concatenate([by_turn @ turn, by_shift @ shift])
    slopes = np.vstack([np.pad(by_turn, ((0, 0), (0, 3))), np.pad(by_shift, ((0, 0), (3, 0)))])
    if joint.type == "universal":
        other = second.rotation @ joint.second
        rows = np.append(rows, axis @ other - joint.axis @ joint.second)
        slopes = np.vstack([slopes, [*np.cross(other, axis), 0.0, 0.0, 0.0]])
    if joint.type == "screw":
        pitch = joint.lead / (2.0 * np.pi)
        rows = np.append(rows, advance(joint, first, second))
        slopes = np.vstack([slopes, [*(-pitch * axis), *axis]])
    return rows, slopes


def advance(joint: Joint, first: Pose, second: Pose) -> float:
    """The displacement of a screw less that of its angle, in whichever turn it is least."""
    axis, side = first.rotation @ joint.axis, rot.aligning_z(joint.axis)[:, 0]
    start, end = first.rotation @ side, second.rotation @ side
    angle = float(np.arctan2(np.cross(start, end) @ axis, start @ end))
    found = float(axis @ (second.position - first.position)) - joint.lead * angle / (2.0 * np.pi)
    return found - joint.lead * round(found / joint.lead) if joint.lead else found


def displacement(joint: Joint, first: Pose, second: Pose) -> Array:
    """The twist (6,), about ground's origin, from a position that a joint allows to the one that it has."""
    rows, slopes = gap_of(joint, first, second)
    turn, shift = np.split(np.linalg.lstsq(slopes, rows, rcond=None)[0], 2) if len(rows) else (np.zeros(3), np.zeros(3))
    return np.concatenate([turn, shift - np.cross(turn, second.position)])


def _error(joint: Joint, first: Pose, second: Pose) -> Array:
    """The rotation vector (3,) in rad from the first frame to the second one, across a joint's axis if it has one."""
    if joint.type in ("fixed", "prismatic"):
        return rot.rotation_vector(rot.to_quaternion(second.rotation @ first.rotation.T))
    one, other = first.rotation @ joint.axis, second.rotation @ joint.axis
    across = np.cross(one, other)
    return across if one @ other > 0.0 else across + 2.0 * rot.aligning_z(one)[:, 0] if one.any() else across


def stacked(vectors: Sequence[Array]) -> Array:
    """Columns (6, n)."""
    return np.column_stack(vectors) if vectors else np.zeros((6, 0))
