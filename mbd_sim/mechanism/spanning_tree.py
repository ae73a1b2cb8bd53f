"""The spanning tree of a mechanism: which joint leads to which part, from ground outwards, and which close loops."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from mbd_sim.mechanism.records import GROUND, Joint, Part


@dataclass(frozen=True)
class SpanningTree:
    """`joints` by name from ground outwards; what does not fit a tree is named beside it."""

    joints: tuple[str, ...]
    outboard: Mapping[str, str]
    inboard: Mapping[str, str]
    moving: frozenset[str]
    reversed_joints: frozenset[str]
    closing: tuple[str, ...]
    unreached: tuple[str, ...]

    def massless(self, parts: Mapping[str, Part]) -> list[str]:
        """The joints that move and carry no mass at all."""
        carried = {name: part.mass for name, part in parts.items()} | {GROUND: 0.0}
        empty = []
        for joint in reversed(self.joints):
            mass = carried[self.outboard[joint]]
            if joint in self.moving and mass == 0.0:
                empty.append(joint)
            carried[self.inboard[joint]] += mass
        return empty


def spanning_tree(
    parts: Mapping[str, Part], joints: Iterable[Joint], wanted: Sequence[str] = (), cut: Iterable[str] = ()
) -> SpanningTree:
    """Breadth first from ground, in declared order, so that loops are cut as far from ground as possible.

    :param wanted: joints that belong into the tree, the most important ones first: none of them is cut but where they
        form a loop among themselves.
    :param cut: joints that close loops where they can.
    """
    joints, cut = list(joints), frozenset(cut)
    at: dict[str, list[Joint]] = {}
    for joint in sorted(joints, key=lambda joint: joint.name in cut):
        at.setdefault(joint.parent, []).append(joint)
        at.setdefault(joint.child, []).append(joint)
    bound = _forest({joint.name: joint for joint in joints}, wanted)
    outboard: dict[str, str] = {}
    inboard: dict[str, str] = {}
    reached: set[str] = set()
    reversed_joints = set()

    def reach(part: str) -> list[str]:
        """A part, with all that is bound to it."""
        gained, waiting = [], [part]
        reached.add(part)
        while waiting:
            part = waiting.pop()
            gained.append(part)
            waiting += [other for joint in at.get(part, []) if joint.name in bound for other in cross(joint, part)]
        return gained

    def cross(joint: Joint, part: str) -> list[str]:
        """The part at the other end of a joint, where it is new."""
        other = joint.child if part == joint.parent else joint.parent
        if other in reached:
            return []
        outboard[joint.name], inboard[joint.name] = other, part
        if part == joint.child:
            reversed_joints.add(joint.name)
        reached.add(other)
        return [other]

    queue = deque(reach(GROUND))

    def explore(without: frozenset[str]) -> None:
        while queue:
            part = queue.popleft()
            for joint in at.get(part, []):
                if joint.name not in without:
                    queue.extend(gained for other in cross(joint, part) for gained in reach(other))

    explore(cut)
    for joint in joints:  # over those to cut only where there is no other way
        for part in (joint.parent, joint.child):
            if joint.name in cut and part in reached:
                queue.extend(gained for other in cross(joint, part) for gained in reach(other))
                explore(cut)
    return SpanningTree(
        joints=tuple(outboard),
        outboard=outboard,
        inboard=inboard,
        moving=frozenset(joint.name for joint in joints if joint.type != "fixed"),
        reversed_joints=frozenset(reversed_joints),
        closing=tuple(j.name for j in joints if j.name not in outboard and j.parent in reached and j.child in reached),
        unreached=tuple(name for name in parts if name not in reached),
    )


def _forest(joints: Mapping[str, Joint], wanted: Sequence[str]) -> frozenset[str]:
    """The wanted joints that form no loop with those before them (Kruskal)."""
    leader: dict[str, str] = {}

    def root(part: str) -> str:
        while part in leader:
            part = leader[part]
        return part

    chosen = set()
    for name in wanted:
        first, second = root(joints[name].parent), root(joints[name].child)
        if first != second:
            leader[first] = second
            chosen.add(name)
    return frozenset(chosen)
