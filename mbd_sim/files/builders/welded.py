"""Which parts move relative to others: those that fixed joints weld together never touch."""

from __future__ import annotations

from collections.abc import Iterable

from mbd_sim.mechanism.elements.parts import GROUND, Joint


def welded_groups(joints: Iterable[Joint]) -> dict[str, str]:
    """The first part of each group that fixed joints connect, by the names of its parts; ground is always first.

    Parts without a fixed joint are left out.
    """
    groups: dict[str, list[str]] = {}
    for joint in joints:
        if joint.type == "fixed":
            first, second = (groups.get(part, [part]) for part in (joint.parent, joint.child))
            if first is not second:
                merged = first + second
                groups |= dict.fromkeys(merged, merged)
    return {part: GROUND if GROUND in group else group[0] for part, group in groups.items()}


def free_parts(parts: Iterable[str], joints: Iterable[Joint], support: str) -> list[str]:
    """Those of some parts that are welded neither to ground nor to a support."""
    groups = welded_groups(joints)
    held = {GROUND, groups.get(support, support)}
    return [part for part in parts if groups.get(part, part) not in held]
