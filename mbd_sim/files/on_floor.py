"""Puts a robot on a floor: its parts touch the plane z = 0 of ground, and its base is where the lowest of them does.

Everything is written into the data of the file, so that recordings and converted files have it.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from mbd_sim.analysis.mechanics.kinematics import Kinematics
from mbd_sim.base.errors import listed
from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.base.linear_algebra import norm, product
from mbd_sim.files.checks.override import with_values
from mbd_sim.mechanism.elements.actuators import CoordinatePort
from mbd_sim.mechanism.elements.contacts import Ball, Cluster, Contact, ContactBody, EllipsoidBody, Face, Rim
from mbd_sim.mechanism.elements.parts import GROUND, Joint
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.spanning_tree import split_reference
from mbd_sim.mechanism.touching import first_of, welded
from mbd_sim.mechanism.values.names import in_quotes, unique_name

FLOOR, FRICTION = "floor", 1.0
MOST = 80  # gaps of a floor, beyond which only the ends of the tree touch it
UP = np.array([0.0, 0.0, 1.0])
UPRIGHT = 1e-9  # by how much the square of what a base rises may differ from 1


def on_floor(mechanism: Mechanism, changes: Mapping[str, Any] | None = None) -> Mechanism:
    """The mechanism on the floor of its file, or else on a new one, and with its bases where they touch that.

    Contacts with what is welded to ground act too. Bases are lifted so that nothing is in the floor; to a new one they
    are also lowered. Where many shapes would touch, only parts at the ends of the tree do, which a remark says.

    :param changes: values of the file to replace before the bases are lifted, see `with_values`.
    :raises MechanismError: nothing can touch a floor, the loops cannot be closed, or a value is not valid.
    """
    contacts: Mapping[str, Any] = mechanism.source.data.get("contacts") or {}
    floors = [name for name, record in contacts.items() if _is_plane_of_ground(record)]
    scenery = _on_scenery(mechanism, contacts)
    waiting = [name for name in [*floors, *scenery] if contacts[name].get("active") is False]
    is_new = not floors and not scenery
    if is_new:
        floors = [unique_name(FLOOR, contacts)]
        contacts = {**contacts, floors[0]: {"parts": "all", "plane": GROUND, "friction": FRICTION}}
        mechanism = with_values(mechanism, {"contacts": contacts})
    elif waiting:
        mechanism = with_values(mechanism, {f"contacts.{in_quotes(name)}.active": True for name in waiting})
    mechanism = _with_few_gaps(mechanism, floors, scenery)
    if changes:
        mechanism = with_values(mechanism, changes)
    return _lifted(mechanism, lowers=is_new)


def _on_scenery(mechanism: Mechanism, contacts: Mapping[str, Any]) -> dict[str, str]:
    """The contacts with parts that are welded to ground and carry no joints, each with the part that touches these."""
    joints, groups = mechanism.joints.values(), welded(mechanism.joints.values())
    carrying = {joint.inboard for joint in joints if joint.type != "fixed"}
    names = dict.fromkeys(mechanism.parts)
    found: dict[str, str] = {}
    for name, record in contacts.items():
        if isinstance(record, dict) and "between" in record and "active" in record:
            ends = [split_reference(end, names)[0] for end in record["between"] if end.split(".")[0] != GROUND]
            still = [part for part in ends if first_of(groups, part) == GROUND and part not in carrying]
            moving = [part for part in ends if first_of(groups, part) != GROUND]
            if still and moving:
                found[name] = moving[0]
    return found


def _is_plane_of_ground(record: Any) -> bool:
    return isinstance(record, dict) and str(record.get("plane") or "").split(".")[0] == GROUND and "parts" in record


def _is_floor(contact: Contact) -> bool:
    return isinstance(contact.second, Face) and contact.second.at.part == GROUND


def _with_few_gaps(mechanism: Mechanism, floors: list[str], scenery: Mapping[str, str]) -> Mechanism:
    """The mechanism of which only the ends of the tree touch floors and scenery, if all parts do with many gaps."""
    contacts: Mapping[str, Any] = mechanism.source.data["contacts"]
    changed: dict[str, Any] = {}
    remarks: list[str] = []
    ends = _ends(mechanism.joints.values())
    inner = {name: part for name, part in scenery.items() if part not in ends}
    if inner and len(inner) < len(scenery) and _gaps(mechanism, scenery) > MOST:
        changed |= {name: {**contacts[name], "active": False} for name in inner}
        parts = list(dict.fromkeys(inner.values()))
        remarks.append(
            f"{listed(parts)}, not at the ends of the tree, touch only planes: with all parts, the first start would "
            f"take long. Change that in contacts: 'active' of {listed(list(inner))}."
        )
    for name in floors:
        record = contacts[name]
        if record.get("parts") != "all" or "without" in record or _gaps(mechanism, [name]) <= MOST:
            continue
        solid = [part.name for part in mechanism.parts.values() if part.touching]
        chosen, other = [part for part in solid if part in ends], [part for part in solid if part not in ends]
        if chosen and other:
            changed[name] = {**record, "without": other}
            remarks.append(
                f"only {listed(chosen)}, at the ends of the tree, touch the {name}: with all parts, the first start "
                f"would take long. Change that in contacts.{name}, 'without' {listed(other)}."
            )
    if not changed:
        return mechanism
    mechanism = with_values(mechanism, {"contacts": {**contacts, **changed}})
    return replace(mechanism, source=replace(mechanism.source, remarks=(*mechanism.source.remarks, *remarks)))


def _gaps(mechanism: Mechanism, names: Collection[str]) -> int:
    """The number of points in which contacts can touch."""
    return sum(contact.slots or 1 for contact in mechanism.contacts if contact.name in names)


def _ends(joints: Iterable[Joint]) -> set[str]:
    """The parts beyond which no joint moves anything."""
    joints = list(joints)
    groups = welded(joints)
    inner = {first_of(groups, joint.inboard) for joint in joints if joint.type != "fixed"}
    return {part for joint in joints if first_of(groups, part := joint.outboard_part) not in inner}


def _lifted(mechanism: Mechanism, lowers: bool) -> Mechanism:
    """The mechanism with its bases moved along z, so that nothing is in a floor, and the lowest point on it."""
    kinematics = Kinematics(mechanism)
    poses = kinematics.poses()
    bases = _bases(mechanism, poses)
    if not bases:
        return mechanism
    carried = _carriers(mechanism, bases)
    heights: dict[str, float] = {}
    for contact in filter(_is_floor, mechanism.contacts):
        face = contact.second
        assert isinstance(face, Face)
        if (rise := float(product(face.normal, UP))) > 0.0:
            for body in contact.first.bodies if isinstance(contact.first, Cluster) else (contact.first,):
                base, lift = carried.get(body.at.part, ""), -_gap(body, face, poses[body.at.part]) / rise
                heights[base] = max(lift, heights.get(base, -np.inf))
    changes: dict[str, Any] = {}
    for base, rises in bases.items():
        lift = heights.get(base, 0.0)
        if lift > 0.0 or (lowers and lift < 0.0):
            start = kinematics.start[kinematics.layout.q[base]][: 3 if len(rises) == 3 else None].copy()
            start[: len(rises)] += lift * rises
            moved = [float(value) for value in start]
            changes[f"joints.{in_quotes(base)}.position"] = moved if len(moved) > 1 else moved[0]
    return with_values(mechanism, changes) if changes else mechanism


def _bases(mechanism: Mechanism, poses: Mapping[str, Pose]) -> dict[str, Array]:
    """The joints that move what they carry straight up, and by how much of each displacement: (n,) for a rise of 1.

    They are free joints on ground, and planar and prismatic ones that nothing holds or moves there, or on others that
    only slide.
    """
    found: dict[str, Array] = {}
    sliding = {GROUND: np.eye(3)}
    ports = [actuator.port for actuator in mechanism.actuators]
    moved = {port.coordinate for port in ports if isinstance(port, CoordinatePort)}
    for joint in mechanism.tree_joints():
        if joint.inboard not in sliding or joint.reversed or joint.drive:
            continue
        held = any(joint.stiffness) or any(joint.limits) or not moved.isdisjoint(joint.motion_names)
        axes = product(sliding[joint.inboard], joint.parent_pose.rotation)
        if joint.type == "free":
            along = np.eye(3)
        elif joint.type == "planar" and not held:
            along = np.array([joint.second, np.cross(joint.axis, joint.second)])
        elif joint.type == "prismatic" and not held:
            along = np.array([joint.axis])
            sliding[joint.outboard_part] = poses[joint.outboard_part].rotation
        else:
            continue
        rises: Array = product(product(along, axes.T), UP)
        if abs(float(product(rises, rises)) - 1.0) <= UPRIGHT:
            found[joint.name] = rises
    return found


def _carriers(mechanism: Mechanism, bases: Mapping[str, Array]) -> dict[str, str]:
    """The base nearest to ground that carries each part."""
    found: dict[str, str] = {}
    for joint in mechanism.tree_joints():
        found[joint.outboard_part] = found.get(joint.inboard) or (joint.name if joint.name in bases else "")
    return found


def _gap(body: ContactBody, face: Face, pose: Pose) -> float:
    """How far in m a body is above a plane of ground."""
    normal = face.normal
    center: Array = pose.position + product(pose.rotation, body.at.point)
    height = float(product(normal, center - face.at.point))
    match body:
        case Ball(radius=radius):
            return height - radius
        case Rim(radius=radius, axis=axis):
            return height - radius * norm(np.cross(normal, product(pose.rotation, axis)))
        case EllipsoidBody(radii=radii, axes=axes):
            return height - norm(np.array(radii) * (product((product(pose.rotation, axes)).T, normal)))
    return height
