"""Which parts move relative to others: those that fixed joints weld together never touch."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from mbd_sim.base.geometry.pose import Pose, identity_pose
from mbd_sim.mechanism.elements.parts import GROUND, Joint


def welded(joints: Iterable[Joint]) -> dict[str, tuple[str, Pose]]:
    """The first part of the group that fixed joints connect to a part, and the pose of the part there, by its name.

    Ground is always first. Parts without a fixed joint are left out.
    """
    beside: dict[str, dict[str, Pose]] = {}
    for joint in joints:
        if joint.type == "fixed":
            pose = joint.parent_pose @ joint.child_pose.inverse()
            beside.setdefault(joint.parent, {}).setdefault(joint.child, pose)
            beside.setdefault(joint.child, {}).setdefault(joint.parent, pose.inverse())
    found: dict[str, tuple[str, Pose]] = {}
    for first in sorted(beside, key=lambda part: part != GROUND):
        waiting = [] if first in found else [(first, identity_pose())]
        while waiting:
            part, pose = waiting.pop(0)
            if part not in found:
                found[part] = first, pose
                waiting += [(other, pose @ step) for other, step in beside[part].items()]
    return found


def free_parts(parts: Iterable[str], joints: Iterable[Joint], support: str) -> list[str]:
    """Those of some parts that are welded neither to ground nor to a support."""
    groups = welded(joints)
    held = {GROUND, first_of(groups, support)}
    return [part for part in parts if first_of(groups, part) not in held]


def first_of(groups: Mapping[str, tuple[str, Pose]], part: str) -> str:
    """The first part of a part's group: itself, if it is welded to none."""
    return groups[part][0] if part in groups else part


def neighbor_groups(joints: Iterable[Joint]) -> set[frozenset[str]]:
    """The pairs of groups, by their first parts, that joints connect, but for free ones; ground has no neighbors."""
    joints = list(joints)
    groups = welded(joints)
    pairs = (
        frozenset((first_of(groups, joint.parent), first_of(groups, joint.child)))
        for joint in joints
        if joint.type not in ("fixed", "free")
    )
    return {pair for pair in pairs if len(pair) == 2 and GROUND not in pair}
