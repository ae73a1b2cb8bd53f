"""The spanning tree of a mechanism: which joint leads to which part from ground outwards, and which close loops."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from mbd_sim.mechanism.records import GROUND, Joint, Part


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
    search = _Search(sorted(joints, key=lambda joint: joint.name in cut), forest)
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


class _Search:
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
