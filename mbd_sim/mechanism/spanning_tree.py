"""The spanning tree of a mechanism: which joint leads to which part from ground outwards, and which close loops.

Parts at the ends of the tree that their joints move without inertia are found here as well. References to parts and to
their points, written as `part` or `part.point`, are resolved.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from mbd_sim.base.errors import InputError, may_suggest, nearest, quoted
from mbd_sim.base.geometry.batch import per_variant
from mbd_sim.base.geometry.pose import Array, Pose, identity_pose
from mbd_sim.base.linear_algebra import norm
from mbd_sim.mechanism.elements.parts import GROUND, Joint, Part
from mbd_sim.mechanism.values.names import in_quotes, readings


@dataclass(frozen=True)
class SpanningTree:
    """The joints of the tree by name from ground outwards, and the joints and parts outside it.

    `outboard` are the parts on the far side of each joint of the tree, seen from ground; `reversed_joints` have their
    parent there. `closing` joints close loops; those among them that need coordinates split one of their parts, see
    `Joint`: `split` has this part by the name of the joint. `unreached` parts are not connected to ground.
    """

    joints: tuple[str, ...]
    outboard: Mapping[str, str]
    reversed_joints: frozenset[str]
    closing: tuple[str, ...]
    unreached: tuple[str, ...]
    split: Mapping[str, str] = field(default_factory=dict)


def spanning_tree(
    parts: Mapping[str, Part], joints: Iterable[Joint], preferred: Sequence[str] = (), cut: Iterable[str] = ()
) -> SpanningTree:
    """Search breadth first from ground, in declared order, so that loops are cut as far from ground as possible.

    :param preferred: joints that should be in the tree, the most important ones first: one of them closes a loop only
        if the loop consists of preferred joints.
    :param cut: joints that should close loops; one of them is in the tree only if nothing else connects its parts.
    """
    joints, cut = list(joints), frozenset(cut)
    forest = _forest({joint.name: joint for joint in joints}, preferred)
    search = _BreadthFirstSearch(sorted(joints, key=lambda joint: joint.name in cut), forest)
    search.explore(cut)
    for joint in joints:
        if joint.name in cut:
            for part in (joint.parent, joint.child):
                if part in search.reached:
                    search.cross(joint, part)
                    search.explore(cut)
    reached = search.reached
    return SpanningTree(
        joints=tuple(search.outboard),
        outboard=search.outboard,
        reversed_joints=frozenset(search.reversed_joints),
        closing=tuple(
            j.name for j in joints if j.name not in search.outboard and j.parent in reached and j.child in reached
        ),
        unreached=tuple(name for name in parts if name not in reached),
    )


def loop_through(carrier: Mapping[str, str], joints: Mapping[str, Joint], closing: str) -> list[str]:
    """The joints of a tree that form a loop with a closing joint; `carrier` is the joint that leads to each part."""

    def way(part: str) -> dict[str, None]:
        """The joints from a part to ground, in this order."""
        found: dict[str, None] = {}
        while part != GROUND:
            joint = joints[carrier[part]]
            found[joint.name] = None
            part = joint.parent if part == joint.child else joint.child
        return found

    first, second = way(joints[closing].parent), way(joints[closing].child)
    return [name for name in first if name not in second] + [name for name in second if name not in first]


class _BreadthFirstSearch:
    """A breadth-first search from ground. A reached part brings all parts with it that the `forest` connects to it."""

    def __init__(self, joints: Iterable[Joint], forest: Collection[str]) -> None:
        self._forest = forest
        self._joints_of: dict[str, list[Joint]] = {}
        for joint in joints:
            self._joints_of.setdefault(joint.parent, []).append(joint)
            self._joints_of.setdefault(joint.child, []).append(joint)
        self.outboard: dict[str, str] = {}
        self.reversed_joints: set[str] = set()
        self.reached: set[str] = {GROUND}
        self._queue: deque[str] = deque()
        self._enqueue(GROUND)

    def explore(self, without: Collection[str]) -> None:
        """Reach all parts that joints connect to those reached so far."""
        while self._queue:
            part = self._queue.popleft()
            for joint in self._joints_of.get(part, []):
                if joint.name not in without:
                    self.cross(joint, part)

    def cross(self, joint: Joint, part: str) -> None:
        """Take a joint of a reached part into the tree if the part at its other end is new."""
        if (other := self._reach(joint, part)) is not None:
            self._enqueue(other)

    def _enqueue(self, part: str) -> None:
        """Queue a reached part and all parts that the forest connects to it."""
        waiting = [part]
        while waiting:
            part = waiting.pop()
            self._queue.append(part)
            connected = [joint for joint in self._joints_of.get(part, []) if joint.name in self._forest]
            waiting += [other for joint in connected if (other := self._reach(joint, part)) is not None]

    def _reach(self, joint: Joint, part: str) -> str | None:
        other = joint.child if part == joint.parent else joint.parent
        if other in self.reached:
            return None
        self.outboard[joint.name] = other
        if part == joint.child:
            self.reversed_joints.add(joint.name)
        self.reached.add(other)
        return other


def _forest(joints: Mapping[str, Joint], preferred: Sequence[str]) -> frozenset[str]:
    """The preferred joints without those that close a loop with preferred joints before them (Kruskal's algorithm)."""
    leader: dict[str, str] = {}

    def root(part: str) -> str:
        while part in leader:
            part = leader[part]
        return part

    chosen = set()
    for name in preferred:
        first, second = root(joints[name].parent), root(joints[name].child)
        if first != second:
            leader[first] = second
            chosen.add(name)
    return frozenset(chosen)


INERTIA_ROUND_OFF = 1e-13  # of an inertia, relative to the largest that the mass could have in the joint


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
    least = _least_inertia(
        part.mass, part.center, part.inertia, pose.position, pose.rotation, directions, rotations, joint.travel
    )
    return bool(least <= INERTIA_ROUND_OFF)


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
    reach = norm(center) + norm(position) + abs(travel)
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


GROUND_WORDS = ("world", "earth", "environment", "inertial")
PointsByPart = Mapping[str, Mapping[str, Pose] | None]  # None: the part's points are unknown, any name is accepted


def resolve_reference(text: str, points_by_part: PointsByPart) -> tuple[str, Pose]:
    """The part that a reference names, and the pose of the point in the part's frame (the identity without a point).

    :raises InputError: there is no such part or point, or there are two.
    """
    part, point = split_reference(text, points_by_part)
    points = points_by_part[part]
    return part, identity_pose() if point is None or points is None else points[point]


def split_reference(
    text: str, names_by_part: Mapping[str, Mapping[str, object] | None], what: str = "point"
) -> tuple[str, str | None]:
    """The part that a reference names, and `what` of the part it names, if it does.

    :raises InputError: there is no such part or name, or there are two.
    """
    possible = [(part, name) for part, name in readings(text) if part in names_by_part]
    valid = [one for one in possible if one[1] is None or _has(names_by_part[one[0]], one[1])]
    if len(valid) > 1:
        written = " or ".join(f"{in_quotes(part)}.{name}" if name else in_quotes(part) for part, name in valid)
        raise InputError(f"{quoted(text)} can mean two things", f"Put the name of the part in quotes: {written}.")
    if valid:
        return valid[0]
    if possible:
        part, name = possible[-1]
        known = nearest(name or "", names_by_part[part] or ()) or f"'{part}' has no points: add one under its 'points'."
        missing = (
            f"'{part}' has no {what} {quoted(name)}" if name else f"no {what} is named after the '.' of {quoted(text)}"
        )
        raise InputError(missing, known)
    part, dot, _ = (word.strip() for word in text.partition("."))
    if not part:
        raise InputError(f"no part is named before the '.' of {quoted(text)}", "Write part.point.")
    raise InputError(f"there is no part {quoted(part)}", _known_part(part, names_by_part, may_be_point=not dot))


def _has(names: Mapping[str, object] | None, name: str) -> bool:
    return names is None or name in names


def _known_part(name: str, names_by_part: Mapping[str, Mapping[str, object] | None], may_be_point: bool) -> str:
    """A remedy for the unknown name of a part, which may be that of a point."""
    if may_be_point and may_suggest():
        for part, points in names_by_part.items():
            if name in (points or {}):
                return f"Did you mean its point '{part}.{name}'?"
    return "Did you mean 'ground'?" if name.lower() in GROUND_WORDS else nearest(name, names_by_part)
