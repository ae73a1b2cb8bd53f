"""Parts inside each other, and coordinates beyond stops, ropes and other one-sided constraints: found and refused."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mbd_sim.base.errors import CommandError, MechanismError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.mechanism.elements.parts import GROUND
from mbd_sim.mechanism.values.source import Location
from mbd_sim.simulation.model.model import Model

DEPTH = 1e-9  # of the size of the mechanism or its natural length, up to which a start counts as touching
REMEDY = "Change the start positions so that the gap is zero or positive."
RAISE = " A free base can be put on its floor with --floor, or load_mechanism(…, floor=True)."
ROBOTS = (".urdf", ".sdf")  # whose base is fixed unless it is freed
FREE = " Its base is fixed: --base free, or load_mechanism(…, base='free', floor=True), lets it stand on its floor."


@dataclass(frozen=True)
class Penetration:
    """How far a one-sided element is beyond its limit: its `location` in the file, a sentence's end, more remedies.

    `depth` is in natural units; `names` tell it from others of the same location.
    """

    location: Location
    names: tuple[str, ...]
    depth: float
    text: str
    remedy: str = ""


def penetrations(model: Model, time: float, y: Array, inputs: Array) -> list[Penetration]:
    """The gaps of a state that are negative by more than round-off, of two bodies the deepest."""
    if model.one_sided is None:
        return []
    functions = model.equations.one_sided
    assert functions is not None
    readings = model.one_sided.readings(time, y, inputs)
    one_sided, found = functions.equations, []
    limit = DEPTH * max(1.0, model.equations.constraints.size / one_sided.units.length)
    gaps = zip(one_sided.gaps, readings.gaps.tolist(), one_sided.gap_units, strict=True)
    reported = set[tuple[Location, tuple[str, str]]]()
    for gap, distance, unit in sorted(gaps, key=lambda each: each[1]):
        if gap.clutch or gap.numbers is not None or not distance < -limit * unit:
            continue
        if gap.bodies is not None:
            if (gap.row.owner, gap.bodies) in reported:
                continue
            reported.add((gap.row.owner, gap.bodies))
        row, depth, far = gap.row, f"{-distance:.4g} {gap.row.unit}".strip(), -distance / unit
        names: tuple[str, ...] = (row.quantity,)
        location, remedy = row.owner, ""
        match row.owner[0]:
            case "contacts":
                assert gap.bodies is not None
                names = first, second = gap.bodies
                text, remedy = f"'{first}' is {depth} inside '{second}'", _raised(model, second)
            case "joints":
                location, text = (*row.owner, "limits"), f"the joint is {depth} beyond its {row.quantity}"
            case _:
                text = f"the {row.quantity} is {depth} beyond the bound"
        found.append(Penetration(location, names, far, text, remedy))
    if model.one_sided.features is not None:
        for contact, depth_in_m in model.one_sided.features.depths(time, y, inputs):
            if depth_in_m > limit * one_sided.units.length:
                first, second = contact.names
                text, far = f"'{first}' is {depth_in_m:.4g} m inside '{second}'", depth_in_m / one_sided.units.length
                found.append(
                    Penetration(("contacts", contact.name), (first, second), far, text, _raised(model, second))
                )
    return found


def _raised(model: Model, obstacle: str) -> str:
    """How a robot is put on a plane of ground that it is inside; nothing for other obstacles."""
    if obstacle.partition(".")[0] != GROUND:
        return ""
    joints = model.mechanism.all_joints.values()
    has_free_base = any(joint.type == "free" and GROUND in (joint.parent, joint.child) for joint in joints)
    if has_free_base:
        return RAISE
    return FREE if model.mechanism.source.file.lower().endswith(ROBOTS) else ""


def require_free_start(model: Model) -> None:
    """Refuse a mechanism that starts inside an obstacle.

    :raises MechanismError: the elements are named, with the depths.
    """
    source, inputs = model.mechanism.source, model.inputs
    problems = [
        source.problem(each.location, f"at the start {each.text}", REMEDY + each.remedy)
        for each in penetrations(model, 0.0, model.start, inputs)
    ]
    if problems:
        raise MechanismError(problems)


def require_outside(model: Model, time: float, y: Array, inputs: Array) -> None:
    """Refuse a state inside an obstacle.

    :raises CommandError: the first elements are named, with the depths.
    """
    if found := penetrations(model, time, y, inputs):
        raise CommandError(_first_of(found), "Give positions in which they are apart or touch.")


def _first_of(found: Sequence[Penetration]) -> str:
    words = [f"{'.'.join(map(str, each.location))}: {each.text}" for each in found[:3]]
    return f"{'; '.join(words)}{f', and {len(found) - 3} more' if len(found) > 3 else ''}"


def require_no_deeper(model: Model, time: float, y: Array, before: Array, inputs: Array, names: str) -> None:
    """Refuse live values with which parts are deeper inside each other, or farther beyond bounds, than before.

    Depths that time stepping leaves between two steps stay as they are.

    :param before: the inputs with the present live values.
    :param names: of the values, for the error.
    :raises CommandError: the first elements are named, with the depths.
    """
    if not _may_be_deeper(model, time, y, before, inputs):
        return
    present = {(each.location, each.names): each.depth for each in penetrations(model, time, y, before)}
    found = penetrations(model, time, y, inputs)
    if deeper := [each for each in found if each.depth > 2.0 * present.get((each.location, each.names), 0.0)]:
        remedy = "Give a value with which they are apart or touch, or move the mechanism first."
        raise CommandError(f"{names}: with this, {_first_of(deeper)}", remedy)


def _may_be_deeper(model: Model, time: float, y: Array, before: Array, inputs: Array) -> bool:
    """Whether other inputs may make a gap negative, without the equations, which a model from the cache lacks."""
    one_sided = model.one_sided
    if one_sided is None:
        return False
    old, new = (one_sided.readings(time, y, each).gaps for each in (before, inputs))
    limits = np.where(one_sided.clutches | one_sided.slots, np.inf, DEPTH * one_sided.gap_units)
    if np.any((new < -limits) & (new < old)):
        return True
    features = one_sided.features
    return features is not None and features.are_moved(time, y, before, inputs)
