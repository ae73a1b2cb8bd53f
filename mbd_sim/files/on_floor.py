"""Puts a robot on a floor: its parts touch the plane z = 0 of ground, and its base is where the lowest of them does.

Everything is written into the data of the file, so that recordings and converted files have it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from mbd_sim.analysis.mechanics.kinematics import Kinematics
from mbd_sim.base.errors import listed
from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.files.builders.welded import welded_groups
from mbd_sim.files.checks.override import with_values
from mbd_sim.mechanism.elements.contacts import Ball, Contact, Face, Rim
from mbd_sim.mechanism.elements.parts import GROUND, Joint
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.values.names import in_quotes, reference, unique_name

FLOOR, FRICTION = "floor", 1.0
MOST = 48  # corners, rims and balls of a robot against the floor, beyond which only the ends of its tree touch it
UP = np.array([0.0, 0.0, 1.0])


def on_floor(mechanism: Mechanism, changes: Mapping[str, Any] | None = None) -> Mechanism:
    """The mechanism on a floor, unless its file has one, and with each free base where its lowest point touches.

    With many shapes only the parts at the ends of the tree touch a new floor, which a remark says. Bases are lifted out
    of a floor of the file, but not lowered to it.

    :param changes: values of the file to replace before the bases are lifted, see `with_values`.
    :raises MechanismError: nothing can touch a floor, the loops cannot be closed, or a value is not valid.
    """
    given = any(_is_floor(contact) for contact in mechanism.contacts)
    if not given:
        mechanism = _with_floor(mechanism)
    if changes:
        mechanism = with_values(mechanism, changes)
    return _lifted(mechanism, lowers=not given)


def _is_floor(contact: Contact) -> bool:
    return isinstance(contact.second, Face) and contact.second.at.part == GROUND


def _with_floor(mechanism: Mechanism) -> Mechanism:
    contacts: Mapping[str, Any] = mechanism.source.data.get("contacts") or {}
    name = unique_name(FLOOR, contacts)

    def touching(parts: str | list[str]) -> Mechanism:
        record = {"parts": parts, "plane": GROUND, "friction": FRICTION}
        return with_values(mechanism, {"contacts": {**contacts, name: record}})

    whole = touching("all")
    found = dict.fromkeys(contact.first.at.part for contact in whole.contacts if contact.name == name)
    if len(whole.contacts) - len(mechanism.contacts) <= MOST:
        return whole
    ends = _ends(mechanism.joints.values())
    chosen, other = [part for part in found if part in ends], [part for part in found if part not in ends]
    if not chosen or not other:
        return whole
    floored = touching([reference(part) for part in chosen])
    text = (
        f"only {listed(chosen)}, at the ends of the tree, touch the {name}; {listed(other)} do not, because each of "
        f"their corners makes every step slower. To change that, give contacts.{name}.parts."
    )
    return replace(floored, source=replace(floored.source, remarks=(*floored.source.remarks, text)))


def _ends(joints: Iterable[Joint]) -> set[str]:
    """The parts beyond which no joint moves anything."""
    joints = list(joints)
    groups = welded_groups(joints)
    inner = {groups.get(joint.inboard, joint.inboard) for joint in joints if joint.type != "fixed"}
    outer = [joint.outboard_part for joint in joints]
    return {part for part in outer if groups.get(part, part) not in inner}


def _lifted(mechanism: Mechanism, lowers: bool) -> Mechanism:
    """The mechanism with its free bases moved along z, so that nothing is in a floor, and the lowest point on it."""
    free = (joint for joint in mechanism.joints.values() if joint.type == "free" and not joint.drive)
    bases = [joint for joint in free if joint.parent == GROUND]
    if not bases:
        return mechanism
    kinematics = Kinematics(mechanism)
    poses, carried = kinematics.poses(), _carriers(mechanism)
    heights: dict[str, float] = {}
    for contact in filter(_is_floor, mechanism.contacts):
        base = carried.get(contact.first.at.part, "")
        assert isinstance(contact.second, Face)
        rise = float(contact.second.normal @ UP)
        if rise > 0.0:
            lift = -_gap(contact, contact.second, poses[contact.first.at.part]) / rise
            heights[base] = max(lift, heights.get(base, -np.inf))
    changes: dict[str, Any] = {}
    for joint in bases:
        lift = heights.get(joint.name, 0.0)
        if lift > 0.0 or (lowers and lift < 0.0):
            start = kinematics.start[kinematics.layout.q[joint.name]][:3]
            position = start + joint.parent_pose.rotation.T @ (lift * UP)
            changes[f"joints.{in_quotes(joint.name)}.position"] = [float(value) for value in position]
    return with_values(mechanism, changes) if changes else mechanism


def _carriers(mechanism: Mechanism) -> dict[str, str]:
    """The joint nearest to ground that carries each part."""
    found: dict[str, str] = {}
    for joint in mechanism.tree_joints():
        found[joint.outboard_part] = found.get(joint.inboard, joint.name)
    return found


def _gap(contact: Contact, face: Face, pose: Pose) -> float:
    """How far in m a ball or a rim is above a plane of ground."""
    body, normal = contact.first, face.normal
    center: Array = pose.position + pose.rotation @ body.at.point
    height = float(normal @ (center - face.at.point))
    match body:
        case Ball(radius=radius):
            return height - radius
        case Rim(radius=radius, axis=axis):
            return height - radius * float(np.linalg.norm(np.cross(normal, pose.rotation @ axis)))
    return height
