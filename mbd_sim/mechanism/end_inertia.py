"""Parts at the ends of a spanning tree that their joints move without inertia."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from mbd_sim.geometry.batch import per_variant
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.records import Joint, Part
from mbd_sim.mechanism.spanning_tree import SpanningTree

ROUND_OFF = 1e-13  # of an inertia, relative to the largest that the mass could have in the joint


def ends_without_inertia(parts: Mapping[str, Part], joints: Mapping[str, Joint], tree: SpanningTree) -> list[str]:
    """The joints that move nothing but one part of a loop, which has no inertia in some motion of the joint.

    Such as a particle on the axis of a hinge. The coordinate of such a joint has no equation of motion of its own.
    """
    carriers = {inboard(joints[name], part) for name, part in tree.outboard.items()}
    closed = {part for name in tree.closing for part in (joints[name].parent, joints[name].child)}
    ends = [(joints[name], parts[part]) for name, part in tree.outboard.items() if part in closed - carriers]
    return [joint.name for joint, part in ends if not joint.drive and moves_no_inertia(joint, part)]


def inboard(joint: Joint, outboard: str) -> str:
    """The other part of a joint."""
    return joint.parent if outboard == joint.child else joint.child


def moves_no_inertia(joint: Joint, part: Part) -> bool:
    """Whether a part has no inertia in some motion of a joint that connects it, in all positions."""
    is_child = part.name == joint.child
    coordinates = joint.kind.coordinates
    if joint.type == "universal":  # only one of its axes does not move in the part
        coordinates = tuple(coordinate for coordinate in coordinates if coordinate.on_child == is_child)
    if not coordinates:
        return False
    pose = joint.child_pose if is_child else joint.parent_pose
    rotations = [coordinate.rotation for coordinate in coordinates]
    directions = [joint.direction(coordinate) for coordinate in coordinates]
    travel = joint.lead / (2.0 * np.pi) if joint.type == "screw" else 0.0
    least = _least_inertia(
        part.mass, part.center, part.inertia, pose.position, pose.rotation, directions, rotations, travel
    )
    return bool(least <= ROUND_OFF)


@per_variant
def _least_inertia(
    mass: float,
    center: Array,
    inertia: Array,
    position: Array,
    rotation: Array,
    directions: Sequence[Array],
    rotations: Sequence[bool],
    travel: float,
) -> float:
    """The least principal value of the part's inertia in the speeds of the joint, relative to the largest possible.

    :param position: of the joint's frame in the part, with its axes `rotation`.
    :param directions: of the speeds in that frame; `rotations` says which of these are angular.
    :param travel: along its direction per rad, of a screw.
    """
    turning, moving, largest = [], [], []
    arm = center - position
    reach = np.linalg.norm(center) + np.linalg.norm(position) + abs(travel)
    for direction, rotates in zip(directions, rotations, strict=True):
        axis = rotation @ direction
        turning.append(axis if rotates else np.zeros(3))
        moving.append(np.cross(axis, arm) + travel * axis if rotates else axis)
        largest.append(np.trace(inertia) + mass * reach**2 if rotates else mass)
    if min(largest) <= 0.0:
        return 0.0
    w, v = np.array(turning), np.array(moving)
    matrix = (w @ inertia @ w.T + mass * v @ v.T) / np.sqrt(np.outer(largest, largest))
    return float(np.linalg.eigvalsh(matrix)[0])
