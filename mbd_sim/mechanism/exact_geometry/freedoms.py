"""The freedoms of joints as twists (6,) = [ω; v at ground's origin] in ground's axes, and gaps of closing joints."""

from __future__ import annotations

from collections.abc import Sequence
from typing import assert_never

import numpy as np

from mbd_sim.base.geometry import rotation as rot
from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.base.linear_algebra import cross
from mbd_sim.mechanism.elements.joint_types import LoopCondition
from mbd_sim.mechanism.elements.parts import Joint

ROW_ORDER: tuple[LoopCondition, ...] = (
    "parallel axes",
    "equal orientations",
    "coincident points",
    "point on axis",
    "point in plane",
    "constant angle between axes",
    "advance by the lead",
)


def rotation_about(axis: Array, point: Array) -> Array:
    """The twist of a rotation about an axis (3,) through a point (3,)."""
    return np.concatenate([axis, cross(point, axis)])


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
        if coordinate.rotation and joint.travel:
            twist = twist + translation_along(direction) * joint.travel
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
            return Pose(axis * (q[0] * joint.travel), rot.about(axis, float(q[0])))
        case "cylindrical":
            return Pose(axis * q[0], rot.about(axis, float(q[1])))
        case "universal":
            return Pose(zero, rot.about(axis, float(q[0])) @ rot.about(joint.second, float(q[1])))
        case "planar":
            place = joint.second * q[0] + cross(axis, joint.second) * q[1]
            return Pose(place, rot.about(axis, float(q[2])))
        case "spherical":
            return Pose(zero, rot.from_quaternion(q))
        case "free":
            return Pose(np.asarray(q[:3]), rot.from_quaternion(q[3:]))
        case "fixed":
            return Pose(zero, np.eye(3))
        case _:
            assert_never(kind)


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
    sides = rot.aligning_z(rot.unit(axis))[:, :2].T if joint.axis.any() else np.eye(3)
    rows, slopes = [np.zeros(0)], [np.zeros((0, 6))]

    def add(directions: Array, error: Array, place: int) -> None:
        rows.append(directions @ error)
        by_twist = np.zeros((len(directions), 6))
        by_twist[:, place : place + 3] = directions
        slopes.append(by_twist)

    for condition in sorted(joint.kind.loop_conditions, key=ROW_ORDER.index):
        match condition:
            case "parallel axes":
                add(sides, turn, 0)
            case "equal orientations":
                add(np.eye(3), turn, 0)
            case "coincident points":
                add(np.eye(3), shift, 3)
            case "point on axis":
                add(sides, shift, 3)
            case "point in plane":
                add(axis[None, :], shift, 3)
            case "constant angle between axes":
                other = second.rotation @ joint.second
                rows.append(np.array([axis @ other - joint.axis @ joint.second]))
                slopes.append(np.array([[*cross(other, axis), 0.0, 0.0, 0.0]]))
            case "advance by the lead":
                rows.append(np.array([advance(joint, first, second)]))
                slopes.append(np.array([[*(-joint.travel * axis), *axis]]))
            case _:
                assert_never(condition)
    return np.concatenate(rows), np.concatenate(slopes)


def advance(joint: Joint, first: Pose, second: Pose) -> float:
    """The displacement of a screw less that of its angle, in whichever turn it is least."""
    axis, side = first.rotation @ joint.axis, rot.aligning_z(joint.axis)[:, 0]
    start, end = first.rotation @ side, second.rotation @ side
    angle = float(np.arctan2(cross(start, end) @ axis, start @ end))
    found = float(axis @ (second.position - first.position)) - joint.travel * angle
    return found - joint.lead * round(found / joint.lead) if joint.lead else found


def displacement(joint: Joint, first: Pose, second: Pose) -> Array:
    """The twist (6,), about ground's origin, from a position that a joint allows to the one that it has."""
    rows, slopes = gap_of(joint, first, second)
    turn, shift = np.split(np.linalg.lstsq(slopes, rows, rcond=None)[0], 2) if len(rows) else (np.zeros(3), np.zeros(3))
    return np.concatenate([turn, shift - cross(turn, second.position)])


def _error(joint: Joint, first: Pose, second: Pose) -> Array:
    """The rotation vector (3,) in rad from the first frame to the second one, across a joint's axis if it has one."""
    if "equal orientations" in joint.kind.loop_conditions:
        return rot.rotation_vector(rot.to_quaternion(second.rotation @ first.rotation.T))
    one, other = first.rotation @ joint.axis, second.rotation @ joint.axis
    across = cross(one, other)
    return across if one @ other > 0.0 else across + 2.0 * rot.aligning_z(one)[:, 0] if one.any() else across


def stacked(vectors: Sequence[Array]) -> Array:
    """Columns (6, n)."""
    return np.column_stack(vectors) if vectors else np.zeros((6, 0))
