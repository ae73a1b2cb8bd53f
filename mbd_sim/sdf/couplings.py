"""Gearboxes and mimicking joints of an SDF, as couplings of coordinates."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from mbd_sim.geometry.pose import Array
from mbd_sim.sdf.frame_graph import Node, key_of, link_of, world_pose
from mbd_sim.sdf.joints import TYPES, axis_of
from mbd_sim.sdf.values import Values

SINGLE = ("revolute", "continuous", "prismatic", "screw")
PARALLEL = 1e-3  # rad, within which the axes of a gearbox are those of its joints

Names = Mapping[int, str]  # of joints in the mechanism, by their id


def mimics_of(values: Values, joint: Node, names: Names) -> list[dict[str, Any]]:
    """The couplings that `<mimic>` means: q = multiplier · (q' - reference) + offset, with q' of another joint."""
    found = []
    for tag in ("axis", "axis2"):
        axis = joint.element.first(tag)
        mimic = None if axis is None else axis.first("mimic")
        if mimic is None:
            continue
        key = f"{key_of(joint.element)}.{tag}.mimic"
        leader = joint.scope.require(mimic.attributes.get("joint", ""), mimic, f"{key}.joint")
        ends = [_coordinate(joint, tag, names), _coordinate(leader, mimic.attributes.get("axis", "axis"), names)]
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


def _coordinate(joint: Node | None, axis: str, names: Names) -> str | None:
    """The name of the coordinate about an axis of a joint."""
    if joint is None or id(joint) not in names:
        return None
    kind = joint.element.attributes.get("type", "")
    if TYPES.get(kind) == "universal":
        return names[id(joint)] + (".second" if axis == "axis2" else ".first")
    return names[id(joint)] if kind in SINGLE and axis == "axis" else None


def gearbox_of(
    values: Values, joint: Node, joints: Sequence[Node], names: Names, end: Callable[[Node, str], Node | None]
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
        direction = world_pose(joint).rotation @ axis_of(values, joint, axis)
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
    joints: Sequence[Node],
    end: Callable[[Node, str], Node | None],
    body: Node | None,
    link: Node | None,
    direction: Array,
) -> tuple[Node, float] | None:
    """The joint between a body and a link most nearly about a direction in the world, and the sign of its angle."""
    found: list[tuple[float, Node, float]] = []
    for joint in joints:
        if joint.element.attributes.get("type") not in ("revolute", "continuous"):
            continue
        ends = end(joint, "parent"), end(joint, "child")
        axis = joint.element.first("axis")
        if axis is None or ends not in ((body, link), (link, body)):
            continue
        own = world_pose(joint).rotation @ axis_of(values, joint, axis)
        cosine = float(own @ direction)
        sign = (1.0 if cosine > 0.0 else -1.0) * (1.0 if ends == (body, link) else -1.0)
        found.append((float(np.linalg.norm(own - cosine * direction)), joint, sign))
    sine, nearest, sign = min(found, key=lambda one: one[0], default=(np.inf, None, 0.0))
    return (nearest, sign) if nearest is not None and sine <= PARALLEL else None
