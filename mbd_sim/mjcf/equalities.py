"""Equality constraints of an MJCF: joints that close loops, and couplings of coordinates.

MuJoCo's equalities are soft; here they are exact, and hold at the reference positions of the joints.
"""

from __future__ import annotations

import numpy as np

from mbd_sim.errors import listed
from mbd_sim.geometry.pose import Pose
from mbd_sim.geometry.rotation import from_quaternion, unit
from mbd_sim.mjcf.body_tree import WORLD, key_of
from mbd_sim.mjcf.items import Item
from mbd_sim.mjcf.joint_reader import BodyJoint
from mbd_sim.mjcf.mechanism_data import Frame, MechanismData
from mbd_sim.mjcf.tendons import Tendon
from mbd_sim.urdf.xml_elements import Element


def add_equality(data: MechanismData, element: Element, tendons: dict[str, Tendon]) -> None:
    """Add what an element of `<equality>` means."""
    context = data.context
    item = context.defaults.item(element, key_of(element), tag="equality")
    if item.choice("active", ("true", "false"), "true") == "false":
        item.leave_out("equalities that are not active")
        return
    match element.tag:
        case "connect":
            _close(data, item, "spherical")
        case "weld":
            _close(data, item, "fixed")
        case "joint":
            _couple_joints(data, item)
        case "tendon":
            _couple_tendons(data, item, tendons)
        case _:
            item.leave_out(f"<{element.tag}> equalities")


def _close(data: MechanismData, item: Item, kind: str) -> None:
    if (frames := _frames(data, item, kind)) is None:
        return
    own = item.text("name") or item.element.tag
    ends = [data.point(frame.part, frame.pose, own) for frame in frames]
    if frames[0].part == frames[1].part:
        item.report("", "connects a body with itself", "Name two bodies.")
        return
    data.add("joints", item, own, {"type": kind, "between": ends, "cut": True})


def _frames(data: MechanismData, item: Item, kind: str) -> tuple[Frame, Frame] | None:
    """The frames that coincide, in their parts."""
    if item.has("site1") or item.has("site2"):
        names = [data.reference(item, f"site{number}", [*data.sites], "site") for number in (1, 2)]
        if names[0] is None or names[1] is None:
            return None
        return data.sites[names[0]], data.sites[names[1]]
    known = [*data.bodies]
    first = data.reference(item, "body1", known, "body")
    second = data.reference(item, "body2", known, "body") if item.has("body2") else WORLD
    if first is None or second is None:
        return None
    one, other = data.bodies[first], data.bodies[second]
    if kind == "spherical":
        if not item.has("anchor"):
            item.report("", "'anchor' is missing", "Give the point, in the frame of body1.")
        inner = Pose(np.array(item.numbers("anchor", 3) or [0.0] * 3), np.eye(3))
    else:
        given = item.numbers("relpose", 7) or [0.0] * 7
        explicit = any(given[3:])
        inner = (
            Pose(np.array(given[:3]), from_quaternion(unit(given[3:])))
            if explicit
            else one.start.inverse() @ other.start
        )
        return Frame(one.part, inner, one.start @ inner), other
    outer = other.start.inverse() @ one.start @ inner
    return Frame(one.part, inner, one.start @ inner), Frame(other.part, Pose(outer.position, np.eye(3)), other.start)


def _couple_joints(data: MechanismData, item: Item) -> None:
    joints: list[BodyJoint] = []
    for attribute in ("joint1", "joint2"):
        if attribute == "joint2" and not item.has(attribute):
            continue
        name = data.reference(item, attribute, [*data.joints], "joint")
        if name is None:
            return
        if not data.joints[name].single:
            item.report(attribute, "has no single coordinate", "Name a hinge or a slide.")
            return
        joints.append(data.joints[name])
    sums = [({data.names[joint.name]: 1.0}, joint.ref) for joint in joints]
    _add_coupling(data, item, sums)


def _couple_tendons(data: MechanismData, item: Item, tendons: dict[str, Tendon]) -> None:
    sums = []
    for attribute in ("tendon1", "tendon2"):
        if attribute == "tendon2" and not item.has(attribute):
            continue
        name = data.reference(item, attribute, [*tendons], "tendon")
        if name is None:
            return
        tendon = tendons[name]
        if len(tendon.ends) == 2 and not item.has("tendon2"):
            length = tendon.start + (item.numbers("polycoef", 1, 5) or [0.0])[0]
            record = {"type": "distance", "between": tendon.ends, "length": length}
            data.add("constraints", item, item.text("name") or name, record)
            return
        if not tendon.terms:
            item.leave_out("equalities of tendons that are not fixed")
            return
        sums.append((tendon.terms, tendon.start))
    _add_coupling(data, item, sums)


def _add_coupling(data: MechanismData, item: Item, sums: list[tuple[dict[str, float], float]]) -> None:
    """y - y₀ = Σ cᵢ (x - x₀)ⁱ for sums of coordinates y and x, which are y₀ and x₀ at the reference positions."""
    coefficients = item.numbers("polycoef", 1, 5) or [0.0, 1.0]
    (terms, start), *others = sums
    value: float | str = start + coefficients[0]
    if others:
        inner, offset = others[0]
        if any(coefficients[2:]):
            shifted = f"({_sum_text(inner)} - {_signed(offset)})"
            powers = [f"{_signed(c)}*{shifted}**{i}" for i, c in enumerate(coefficients) if c and i]
            value = " + ".join([f"{value!r}", *powers])
        else:
            slope = [*coefficients, 0.0][1]
            value = start + coefficients[0] - slope * offset
            terms = dict(terms)
            for name, factor in inner.items():
                terms[name] = terms.get(name, 0.0) - slope * factor
    terms = {name: factor for name, factor in terms.items() if factor}
    if not terms:
        item.report("polycoef", f"leaves nothing to constrain for {listed([*sums[0][0]])}", "Remove the equality.")
        return
    if len(terms) == 1 and not isinstance(value, str):
        item.leave_out("equalities of a single coordinate, for which a joint can have a constant drive")
        return
    record = {"type": "coupling", "terms": terms} | ({"value": value} if value else {})
    data.add("constraints", item, item.text("name") or f"{next(iter(terms))}_equality", record)


def _sum_text(terms: dict[str, float]) -> str:
    return " + ".join(f"{_signed(factor)}*{name}.position" for name, factor in terms.items())


def _signed(value: float) -> str:
    """A number that may stand after an operator."""
    return f"({value!r})" if value < 0.0 else f"{value!r}"
