"""Tendons of an MJCF: sums of coordinates, and straight lines from site to site.

A fixed tendon has the length Σ c q. Its spring becomes a potential, its damper an effort on each coordinate, and its
friction a friction clutch. A spatial tendon between two sites becomes a spring, and its range a rope and a strut.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from mbd_sim.mjcf.body_tree import key_of
from mbd_sim.mjcf.items import Item
from mbd_sim.mjcf.mechanism_data import MechanismData
from mbd_sim.urdf.xml_elements import Element


@dataclass(frozen=True, eq=False)
class Tendon:
    """A tendon with its length at the reference positions: `terms` of a fixed one, `ends` (points) of a spatial one."""

    item: Item
    name: str
    start: float
    terms: dict[str, float]
    ends: list[str]


def tendon_of(data: MechanismData, element: Element, number: int) -> Tendon | None:
    """The tendon of an element; None if it cannot be expressed, which is noted, or is wrong."""
    item = data.context.defaults.item(element, key_of(element))
    name = item.text("name") or f"tendon_{number}"
    return _fixed(data, item, name) if element.tag == "fixed" else _spatial(data, item, name)


def _fixed(data: MechanismData, item: Item, name: str) -> Tendon | None:
    terms: dict[str, float] = {}
    start = 0.0
    for element in item.element.children:
        entry = Item(item.reading, element, f"{item.key}.{element.tag}", dict.fromkeys(element.attributes, element))
        joint = data.reference(entry, "joint", [*data.joints], "joint")
        if joint is None:
            return None
        if not data.joints[joint].single:
            entry.report("joint", "has no single coordinate", "Name a hinge or a slide.")
            return None
        own, coefficient = data.names[joint], entry.number("coef")
        terms[own] = terms.get(own, 0.0) + coefficient
        start += coefficient * data.joints[joint].ref
    terms = {joint: factor for joint, factor in terms.items() if factor}
    return Tendon(item, name, start, terms, []) if terms else None


def _spatial(data: MechanismData, item: Item, name: str) -> Tendon | None:
    if any(element.tag != "site" for element in item.element.children):
        item.leave_out("tendons over geoms and pulleys")
        return None
    frames, ends = [], []
    for element in item.element.children:
        entry = Item(item.reading, element, f"{item.key}.site", dict.fromkeys(element.attributes, element))
        site = data.reference(entry, "site", [*data.sites], "site")
        if site is None:
            return None
        frames.append(data.sites[site])
        ends.append(data.point(frames[-1].part, frames[-1].pose, f"{name}_end"))
    start = sum(float(np.linalg.norm(b.start.position - a.start.position)) for a, b in pairwise(frames))
    return Tendon(item, name, start, {}, ends)


def add_tendon(data: MechanismData, tendon: Tendon, disabled: frozenset[str]) -> None:
    """Add the forces and the range of a tendon."""
    item = tendon.item
    stiffness = 0.0 if "spring" in disabled else item.number_from_zero("stiffness")
    damping = 0.0 if "damper" in disabled else item.number_from_zero("damping")
    friction = 0.0 if "frictionloss" in disabled else item.number_from_zero("frictionloss")
    rest = item.numbers("springlength", 1, 2) or [-1.0]
    rest = [tendon.start if rest[0] < 0.0 else rest[0], *rest[1:]]
    if item.number("armature"):
        item.leave_out("armature of tendons")
    if tendon.terms:
        _add_fixed(data, tendon, stiffness, damping, rest)
        if friction:
            record = {"type": "clutch", "terms": tendon.terms, "capacity": friction}
            data.add("constraints", item, f"{tendon.name}_friction", record)
    elif len(tendon.ends) == 2:
        _add_spring(data, tendon, stiffness, damping, rest)
        if friction:
            item.leave_out("friction of spatial tendons")
    elif stiffness or damping or friction:
        item.leave_out("stiffness, damping and friction of tendons over more than two sites")
    if item.limited("limited", "range", data.context.compiler.autolimits) and "limit" not in disabled:
        _add_range(data, tendon)


def _add_fixed(data: MechanismData, tendon: Tendon, stiffness: float, damping: float, rest: list[float]) -> None:
    if stiffness:
        length = " + ".join(f"({factor!r})*{name}.position" for name, factor in tendon.terms.items())
        energy = f"{0.5 * stiffness!r}*({length} - ({rest[0]!r}))**2"
        if rest[1:]:
            slack = f"min(0, {length} - ({rest[0]!r})) + max(0, {length} - ({rest[1]!r}))"
            energy = f"{0.5 * stiffness!r}*({slack})**2"
        data.add("forces", tendon.item, tendon.name, {"type": "potential", "energy": energy})
    if damping:
        rate = " + ".join(f"({factor!r})*{name}.velocity" for name, factor in tendon.terms.items())
        for name, factor in tendon.terms.items():
            record = {"type": "effort", "coordinate": name, "effort": f"{-damping * factor!r}*({rate})"}
            data.add("forces", tendon.item, f"{tendon.name}_damper_{name}", record)


def _add_spring(data: MechanismData, tendon: Tendon, stiffness: float, damping: float, rest: list[float]) -> None:
    record: dict[str, Any] = {"type": "spring", "between": tendon.ends}
    if stiffness and rest[1:]:
        record |= {"force": f"{stiffness!r}*(min(0, x) + max(0, x - {rest[1] - rest[0]!r}))", "length": rest[0]}
    elif stiffness:
        record |= {"stiffness": stiffness, "length": rest[0]}
    if damping:
        record["damping"] = damping
    if stiffness or damping:
        data.add("forces", tendon.item, tendon.name, record)


def _add_range(data: MechanismData, tendon: Tendon) -> None:
    """A range that holds at the reference positions as one-sided constraints, without rebound."""
    item = tendon.item
    lower, upper = item.numbers("range", 2) or [0.0, 0.0]
    if not lower < upper:
        item.report("range" if item.has("range") else "", "has no lower limit below an upper one", "Give 'range'.")
        return
    if not lower <= tendon.start <= upper:
        item.leave_out(f"ranges of tendons that do not hold at the start, where the length is {tendon.start:g}")
        return
    for bound, value in (("at_least", lower), ("at_most", upper)):
        if tendon.terms:
            record: dict[str, Any] = {"type": "coupling", "terms": tendon.terms, "value": value}
        elif bound == "at_least" and value <= 0.0:
            continue
        elif len(tendon.ends) == 2:
            record = {"type": "distance", "between": tendon.ends, "length": value}
        else:
            record = {"type": "cable", "through": tendon.ends, "length": value}
        data.add("constraints", item, f"{tendon.name}_{bound}", record | {"bound": bound, "restitution": 0})
