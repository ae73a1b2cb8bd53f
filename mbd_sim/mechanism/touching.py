"""The shapes of a mechanism that touch, as other formats name them: pairs of shapes, and shapes with a plane.

Parts that fixed joints weld together never touch.

A contact of the mechanism is one gap; those of the corners of one shape belong together.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from mbd_sim.base.geometry.pose import Pose, identity_pose
from mbd_sim.mechanism.elements.contacts import Cluster, Contact, Face
from mbd_sim.mechanism.elements.parts import GROUND, Joint, Part, Shape
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.values.names import reference


@dataclass(frozen=True, eq=False)
class TouchingPair:
    """A shape by its part and its place among those that touch there, and its partner: another one, or a plane.

    `contact` is one of its contacts in the mechanism, which has its name and its law.
    """

    contact: Contact
    first: tuple[str, int]
    second: tuple[str, int] | Face


def shape_names(part: Part) -> list[str]:
    """The name by which contacts know each shape of a part that can touch, of those without a name of their own too."""
    solid = [number for number, shape in enumerate(part.touching) if not shape.hole]
    names = [f"{part.name}.{shape.name or f'shape{number}'}" for number, shape in enumerate(part.touching, start=1)]
    if len(solid) == 1:
        names[solid[0]] = part.name
    return names


def touching_pairs(mechanism: Mechanism) -> tuple[list[TouchingPair], list[str]]:
    """The pairs of shapes in contact, each once, and the names of contacts of points, cams, or inside others."""
    places = dict(_named_places(mechanism.parts))
    found: dict[tuple[str, str, str], TouchingPair] = {}
    others: dict[str, None] = {}
    for contact in mechanism.contacts:
        for first in contact.first.names if isinstance(contact.first, Cluster) else contact.names[:1]:
            second = contact.second if isinstance(contact.second, Face) else places.get(contact.names[1])
            if first not in places or second is None or contact.inside:
                others[contact.name] = None
                continue
            pair = TouchingPair(contact, places[first], second)
            found.setdefault((contact.name, first, contact.names[1]), pair)
    return list(found.values()), list(others)


def _named_places(parts: Mapping[str, Part]) -> Iterator[tuple[str, tuple[str, int]]]:
    for part in parts.values():
        for number, (name, shape) in enumerate(zip(shape_names(part), part.touching, strict=True)):
            if not shape.hole:
                yield name, (part.name, number)
                if shape.name:
                    yield f"{part.name}.{shape.name}", (part.name, number)
                    yield reference(part.name, shape.name), (part.name, number)


def shape_at(mechanism: Mechanism, place: tuple[str, int]) -> Shape:
    """The shape at a place."""
    part, number = place
    return mechanism.parts[part].touching[number]


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
