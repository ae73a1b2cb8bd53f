"""The spanning tree of a mechanism: which joint leads to which part, from ground outwards."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from mbd_sim.mechanism.model import GROUND, Joint, Part


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


def spanning_tree(parts: Mapping[str, Part], joints: Iterable[Joint]) -> SpanningTree:
    """Breadth first from ground, in declared order, so that loops are cut as far from ground as possible."""
    joints = list(joints)
    at: dict[str, list[Joint]] = {}
    for joint in joints:
        at.setdefault(joint.parent, []).append(joint)
        at.setdefault(joint.child, []).append(joint)
    outboard: dict[str, str] = {}
    inboard: dict[str, str] = {}
    reached, front = {GROUND}, [GROUND]
    reversed_joints = set()
    while front:
        grown = []
        for part in front:
            for joint in at.get(part, []):
                other = joint.child if part == joint.parent else joint.parent
                if other in reached:
                    continue
                outboard[joint.name], inboard[joint.name] = other, part
                if part == joint.child:
                    reversed_joints.add(joint.name)
                reached.add(other)
                grown.append(other)
        front = grown
    return SpanningTree(
        joints=tuple(outboard),
        outboard=outboard,
        inboard=inboard,
        moving=frozenset(joint.name for joint in joints if joint.type != "fixed"),
        reversed_joints=frozenset(reversed_joints),
        closing=tuple(j.name for j in joints if j.name not in outboard and j.parent in reached and j.child in reached),
        unreached=tuple(name for name in parts if name not in reached),
    )
