"""The joints of an SDF as joints and couplings of a mechanism file.

A joint has a frame, in which its axes are given by default. Gearboxes and mimicking joints become couplings of
coordinates.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from mbd_sim.base.errors import nearest, quoted
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.linear_algebra import norm, product
from mbd_sim.files.sdf.links import Values, direction
from mbd_sim.files.sdf.scopes import MODEL, Scope, ScopedFrame, key_of, link_of, world_pose
from mbd_sim.files.text.xml import Element, rows

TYPES = {
    "fixed": "fixed",
    "revolute": "revolute",
    "continuous": "revolute",
    "prismatic": "prismatic",
    "screw": "screw",
    "ball": "spherical",
    "universal": "universal",
    "revolute2": "universal",
}
GEARBOX = "gearbox"
OLD_AXES = ("1.0", "1.1", "1.2", "1.3", "1.4")  # versions whose axes are by default in the axes of the model
READ = ("pose", "sensor", "parent", "child", "axis", "axis2", "screw_thread_pitch", "thread_pitch")


def joint_of(values: Values, node: ScopedFrame) -> dict[str, Any]:
    """The record of a joint without `between`."""
    element, key = node.element, key_of(node.element)
    kind = element.attributes.get("type", "")
    if kind not in TYPES:
        message = f"unknown type {quoted(kind)}" if kind else "'type' is missing"
        values.reading.report(element, f"{key}.type", message, nearest(kind, [*TYPES, GEARBOX]))
        return {"type": "fixed"}
    record: dict[str, Any] = {"type": TYPES[kind]}
    for child in element.children:
        if child.tag not in READ:
            values.reading.leave_out_at(f"<{child.tag}> of joints", child, key)
    axes = [axis for tag in ("axis", "axis2") if (axis := element.first(tag)) is not None]
    match record["type"]:
        case "fixed" | "spherical":
            return record
        case "universal":
            found = [axis_of(values, node, axis) for axis in axes]
            if len(found) != 2:
                values.reading.report(element, key, f"{kind} joints have two axes", "Give <axis> and <axis2>.")
                return {"type": "fixed"}
            record["axes"] = [rows(axis) for axis in found]
            each = [_coordinate(values, axis, key, kind) for axis in axes]
            for name, otherwise in (("stiffness", 0.0), ("rest", 0.0), ("damping", 0.0), ("limits", None)):
                if any(name in one for one in each):
                    record[name] = [one.get(name, otherwise) for one in each]
            for name in ("friction", "effort_limit", "velocity_limit"):
                if any(name in one for one in each):
                    values.reading.leave_out_at(f"{name.replace('_', ' ')} of universal joints", element, key)
            return record
    record["axis"] = rows(axis_of(values, node, axes[0]) if axes else direction(None))
    if record["type"] == "screw":
        record["lead"] = _lead(values, element, key)
    coordinate = _coordinate(values, axes[0], key, kind) if axes else {}
    if record["type"] == "screw":
        for name in ("friction", "velocity_limit"):
            if coordinate.pop(name, None) is not None:
                values.reading.leave_out_at(f"{name.replace('_', ' ')} of screws", element, key)
    return record | coordinate


def axis_of(values: Values, node: ScopedFrame, axis: Element) -> Array:
    """The direction (3,) of an axis in the frame of its joint.

    :raises MechanismError: the frame in which it is expressed does not exist.
    """
    key = f"{key_of(node.element)}.{axis.tag}"
    xyz = axis.first("xyz")
    numbers = None if xyz is None else values.numbers_in(xyz, f"{key}.xyz", 3)
    if numbers is not None and (not any(numbers) or not all(map(math.isfinite, numbers))):
        values.reading.report(xyz or axis, f"{key}.xyz", "must not be zero", "Write for example 0 0 1.")
        numbers = None
    vector = direction(numbers)
    named = "" if xyz is None else xyz.attributes.get("expressed_in", "")
    if values.flag(axis, "use_parent_model_frame", key) or (not named and version_of(values, node) in OLD_AXES):
        named = MODEL
    if not named:
        return vector
    frame = world_pose(node.scope.require(named, xyz or axis, f"{key}.xyz.expressed_in"))
    return np.asarray(product(product(world_pose(node).rotation.T, frame.rotation), vector))


def version_of(values: Values, node: ScopedFrame) -> str:
    """The version of the file in which a joint stands, which may have been included."""
    scope: Scope | None = node.scope
    while scope is not None:
        if version := scope.element.attributes.get("sdf_version"):
            return version
        scope = scope.outer
    return values.version


def _lead(values: Values, joint: Element, key: str) -> float:
    """Travel for one turn in m: `<screw_thread_pitch>`, or in older files -2π over `<thread_pitch>` in rad/m."""
    if joint.first("screw_thread_pitch") is None and joint.first("thread_pitch") is not None:
        pitch = values.number(joint, "thread_pitch", key)
        if not pitch:
            values.reading.report(joint.first("thread_pitch") or joint, key, "must not be zero", "Give rad/m.")
            return 1.0
        return -2.0 * math.pi / pitch
    return values.number(joint, "screw_thread_pitch", key, 1.0)


def _coordinate(values: Values, axis: Element, key: str, kind: str) -> dict[str, Any]:
    """Limits, damping, friction and spring of one coordinate."""
    where, record = f"{key}.{axis.tag}", dict[str, Any]()
    limit, dynamics = axis.first("limit"), axis.first("dynamics")
    if limit is not None:
        lower = values.bound(limit, "lower", f"{where}.limit", -math.inf)
        upper = values.bound(limit, "upper", f"{where}.limit", math.inf)
        if kind != "continuous" and (lower > -math.inf or upper < math.inf):
            if lower < upper:
                record["limits"] = {"lower": max(lower, -FAR), "upper": min(upper, FAR)}
            else:
                values.reading.leave_out_at("limits without a range between them, taken as unlimited", limit, where)
        for name in ("effort", "velocity"):
            value = values.bound(limit, name, f"{where}.limit", math.inf)
            if 0.0 < value < math.inf:
                record[f"{name}_limit"] = value
            elif value == 0.0:
                values.reading.leave_out_at(f"{name} limits of 0, taken as unlimited", limit, where)
    if dynamics is not None:
        place = f"{where}.dynamics"
        if stiffness := values.number_from_zero(dynamics, "spring_stiffness", place):
            record["stiffness"] = stiffness
            if rest := values.number(dynamics, "spring_reference", place):
                record["rest"] = rest
        if damping := values.number_from_zero(dynamics, "damping", place):
            record["damping"] = damping
        if friction := values.number_from_zero(dynamics, "friction", place):
            record["friction"] = {"coulomb": friction}
    return record


FAR = 1e6  # m or rad, the end of a range that has only one


SINGLE = ("revolute", "continuous", "prismatic", "screw")
PARALLEL = 1e-3  # rad, within which the axes of a gearbox are those of its joints

Names = Mapping[int, str]  # of joints in the mechanism, by their id


def mimics_of(values: Values, joint: ScopedFrame, names: Names) -> list[dict[str, Any]]:
    """The couplings that `<mimic>` means: q = multiplier · (q' - reference) + offset, with q' of another joint."""
    found = []
    for tag in ("axis", "axis2"):
        axis = joint.element.first(tag)
        mimic = None if axis is None else axis.first("mimic")
        if mimic is None:
            continue
        key = f"{key_of(joint.element)}.{tag}.mimic"
        leader = joint.scope.require(mimic.attributes.get("joint", ""), mimic, f"{key}.joint")
        ends = [
            _named_coordinate(joint, tag, names),
            _named_coordinate(leader, mimic.attributes.get("axis", "axis"), names),
        ]
        multiplier = values.number(mimic, "multiplier", key)
        if None in ends or ends[0] == ends[1] or not multiplier:
            message = "does not name another joint with one coordinate, and a multiplier that is not 0"
            values.reading.report(mimic, key, message, "Give 'joint' and <multiplier>.")
            continue
        offset = values.number(mimic, "offset", key) - multiplier * values.number(mimic, "reference", key)
        terms = {ends[0]: 1.0, ends[1]: -multiplier}
        law = {"value": offset} if offset else {}
        found.append({"type": "coupling", "terms": terms, **law, "follower": ends[0]})
    return found


def _named_coordinate(joint: ScopedFrame | None, axis: str, names: Names) -> str | None:
    """The name of the coordinate about an axis of a joint."""
    if joint is None or id(joint) not in names:
        return None
    kind = joint.element.attributes.get("type", "")
    if TYPES.get(kind) == "universal":
        return names[id(joint)] + (".second" if axis == "axis2" else ".first")
    return names[id(joint)] if kind in SINGLE and axis == "axis" else None


def gearbox_of(
    values: Values,
    joint: ScopedFrame,
    joints: Sequence[ScopedFrame],
    names: Names,
    end: Callable[[ScopedFrame, str], ScopedFrame | None],
) -> dict[str, Any] | None:
    """θ₂ = -ratio · θ₁, with the rotations of the gearbox's parent and child relative to its reference body.

    θ₁ is about `<axis>`, θ₂ about `<axis2>`. Revolute joints about the same axes connect both with the reference body.
    """
    key, element = key_of(joint.element), joint.element
    reference = element.first("gearbox_reference_body")
    if reference is None:
        values.reading.report(element, key, "<gearbox_reference_body> is missing", "Add it.")
        return None
    body = link_of(joint.scope.require(reference.text.strip(), reference, f"{key}.gearbox_reference_body"))
    ratio = values.number(element, "gearbox_ratio", key, 1.0)
    terms: dict[str, float] = {}
    for tag, side, factor in (("axis", "parent", ratio), ("axis2", "child", 1.0)):
        link, axis = end(joint, side), element.first(tag) or element.first("axis")
        if axis is None:
            values.reading.report(element, key, f"<{tag}> is missing", "Add it.")
            return None
        direction = product(world_pose(joint).rotation, axis_of(values, joint, axis))
        found = _rotation(values, joints, end, body, link, direction)
        if found is None:
            message = f"no revolute joint about <{tag}> connects its {side} with the reference body"
            values.reading.report(element, key, message, "Add that joint; the gearbox only couples two rotations.")
            return None
        connecting, sign = found
        name = names[id(connecting)]
        terms[name] = terms.get(name, 0.0) + factor * sign
    return {"type": "coupling", "terms": terms}


def _rotation(
    values: Values,
    joints: Sequence[ScopedFrame],
    end: Callable[[ScopedFrame, str], ScopedFrame | None],
    body: ScopedFrame | None,
    link: ScopedFrame | None,
    direction: Array,
) -> tuple[ScopedFrame, float] | None:
    """The joint between a body and a link most nearly about a direction in the world, and the sign of its angle."""
    found: list[tuple[float, ScopedFrame, float]] = []
    for joint in joints:
        if joint.element.attributes.get("type") not in ("revolute", "continuous"):
            continue
        ends = end(joint, "parent"), end(joint, "child")
        axis = joint.element.first("axis")
        if axis is None or ends not in ((body, link), (link, body)):
            continue
        own = product(world_pose(joint).rotation, axis_of(values, joint, axis))
        cosine = float(product(own, direction))
        sign = (1.0 if cosine > 0.0 else -1.0) * (1.0 if ends == (body, link) else -1.0)
        found.append((norm(own - cosine * direction), joint, sign))
    sine, nearest, sign = min(found, key=lambda one: one[0], default=(np.inf, None, 0.0))
    return (nearest, sign) if nearest is not None and sine <= PARALLEL else None
