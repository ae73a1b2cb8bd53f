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
from mbd_sim.files.checks.override import with_values
from mbd_sim.mechanism.elements.contacts import Ball, Cluster, Contact, ContactBody, EllipsoidBody, Face, Rim
from mbd_sim.mechanism.elements.parts import GROUND, Joint
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.touching import first_of, welded
from mbd_sim.mechanism.values.names import in_quotes, unique_name

FLOOR, FRICTION = "floor", 1.0
MOST = 20  # gaps of a floor, beyond which only the ends of the tree touch it
UP = np.array([0.0, 0.0, 1.0])


def on_floor(mechanism: Mechanism, changes: Mapping[str, Any] | None = None) -> Mechanism:
    """The mechanism on the floor of its file, or else on a new one, and with each free base where it touches that.

    Bases are lifted so that nothing is in the floor; to a new one they are also lowered. Where many shapes would touch,
    only parts at the ends of the tree do, which a remark says.

    :param changes: values of the file to replace before the bases are lifted, see `with_values`.
    :raises MechanismError: nothing can touch a floor, the loops cannot be closed, or a value is not valid.
    """
    contacts: Mapping[str, Any] = mechanism.source.data.get("contacts") or {}
    floors = [name for name, record in contacts.items() if _is_plane_of_ground(record)]
    if not floors:
        name = unique_name(FLOOR, contacts)
        contacts = {**contacts, name: {"parts": "all", "plane": GROUND, "friction": FRICTION}}
        mechanism = with_values(mechanism, {"contacts": contacts})
    elif waiting := [name for name in floors if contacts[name].get("active") is False]:
        mechanism = with_values(mechanism, {f"contacts.{in_quotes(name)}.active": True for name in waiting})
    mechanism = _with_few_gaps(mechanism, floors or [name])
    if changes:
        mechanism = with_values(mechanism, changes)
    return _lifted(mechanism, lowers=not floors)


def _is_plane_of_ground(record: Any) -> bool:
    return isinstance(record, dict) and str(record.get("plane") or "").split(".")[0] == GROUND and "parts" in record


def _is_floor(contact: Contact) -> bool:
    return isinstance(contact.second, Face) and contact.second.at.part == GROUND


def _with_few_gaps(mechanism: Mechanism, floors: list[str]) -> Mechanism:
    """The mechanism of which only the ends of the tree touch floors, if all parts do and these have many gaps."""
    contacts: Mapping[str, Any] = mechanism.source.data["contacts"]
    changed: dict[str, Any] = {}
    remarks: list[str] = []
    for name in floors:
        record = contacts[name]
        own = [contact for contact in mechanism.contacts if contact.name == name]
        if record.get("parts") != "all" or "without" in record or sum(each.slots or 1 for each in own) <= MOST:
            continue
        solid = [part.name for part in mechanism.parts.values() if part.touching]
        ends = _ends(mechanism.joints.values())
        chosen, other = [part for part in solid if part in ends], [part for part in solid if part not in ends]
        if chosen and other:
            changed[name] = {**record, "without": other}
            remarks.append(
                f"only {listed(chosen)}, at the ends of the tree, touch the {name}: with all parts, each step would "
                f"take many times as long. Change that in contacts.{name}, 'without' {listed(other)}."
            )
    if not changed:
        return mechanism
    mechanism = with_values(mechanism, {"contacts": {**contacts, **changed}})
    return replace(mechanism, source=replace(mechanism.source, remarks=(*mechanism.source.remarks, *remarks)))


def _ends(joints: Iterable[Joint]) -> set[str]:
    """The parts beyond which no joint moves anything."""
    joints = list(joints)
    groups = welded(joints)
    inner = {first_of(groups, joint.inboard) for joint in joints if joint.type != "fixed"}
    return {part for joint in joints if first_of(groups, part := joint.outboard_part) not in inner}


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
        face = contact.second
        assert isinstance(face, Face)
        if (rise := float(face.normal @ UP)) > 0.0:
            for body in contact.first.bodies if isinstance(contact.first, Cluster) else (contact.first,):
                base, lift = carried.get(body.at.part, ""), -_gap(body, face, poses[body.at.part]) / rise
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


def _gap(body: ContactBody, face: Face, pose: Pose) -> float:
    """How far in m a body is above a plane of ground."""
    normal = face.normal
    center: Array = pose.position + pose.rotation @ body.at.point
    height = float(normal @ (center - face.at.point))
    match body:
        case Ball(radius=radius):
            return height - radius
        case Rim(radius=radius, axis=axis):
            return height - radius * float(np.linalg.norm(np.cross(normal, pose.rotation @ axis)))
        case EllipsoidBody(radii=radii, axes=axes):
            return height - float(np.linalg.norm(np.array(radii) * ((pose.rotation @ axes).T @ normal)))
    return height
