"""Joints of an SDF as joints of a mechanism file. A joint has a frame, in which its axes are given by default."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mbd_sim.errors import nearest, quoted
from mbd_sim.geometry.pose import Array
from mbd_sim.sdf.frame_graph import MODEL, Node, Scope, key_of, world_pose
from mbd_sim.sdf.values import Values, direction
from mbd_sim.urdf.value_reader import rows
from mbd_sim.urdf.xml_elements import Element

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
READ = ("pose", "parent", "child", "axis", "axis2", "screw_thread_pitch", "thread_pitch")


def joint_of(values: Values, node: Node) -> dict[str, Any]:
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


def axis_of(values: Values, node: Node, axis: Element) -> Array:
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
    return np.asarray(world_pose(node).rotation.T @ frame.rotation @ vector)


def version_of(values: Values, node: Node) -> str:
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
