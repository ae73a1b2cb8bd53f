"""Refuses states in which parts are inside each other, or beyond stops, ropes and other one-sided constraints."""

from __future__ import annotations

from dataclasses import dataclass

from mbd_sim.errors import CommandError, MechanismError
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.source import Location
from mbd_sim.simulation.compiled_model import Model

DEPTH = 1e-9  # of the size of the mechanism or its natural length, up to which a start counts as touching
REMEDY = "Change the start positions so that the gap is zero or positive."


@dataclass(frozen=True)
class Penetration:
    """How far a one-sided element is beyond its limit: its `location` in the file, and a sentence's end."""

    location: Location
    text: str


def penetrations(model: Model, time: float, y: Array, inputs: Array) -> list[Penetration]:
    """The gaps of a state that are negative by more than round-off."""
    if model.one_sided is None:
        return []
    functions = model.equations.one_sided
    assert functions is not None
    readings = model.one_sided.readings(time, y, inputs)
    contacts, found = functions.contacts, []
    limit = DEPTH * max(1.0, model.equations.constraints.size / contacts.units.length)
    gaps = zip(contacts.gaps, readings.gaps.tolist(), contacts.gap_units, strict=True)
    for gap, distance, unit in gaps:
        if gap.clutch or not distance < -limit * unit:
            continue
        row, depth = gap.row, f"{-distance:.4g} {gap.row.unit}".strip()
        match row.owner[0]:
            case "contacts":
                assert gap.bodies is not None
                first, second = gap.bodies
                found.append(Penetration(row.owner, f"'{first}' is {depth} inside '{second}'"))
            case "joints":
                found.append(Penetration((*row.owner, "limits"), f"the joint is {depth} beyond its {row.quantity}"))
            case _:
                found.append(Penetration(row.owner, f"the {row.quantity} is {depth} beyond the bound"))
    return found


def require_free_start(model: Model) -> None:
    """Refuse a mechanism that starts inside an obstacle.

    :raises MechanismError: the elements are named, with the depths.
    """
    source, inputs = model.mechanism.source, model.inputs
    problems = [
        source.problem(each.location, f"at the start {each.text}", REMEDY)
        for each in penetrations(model, 0.0, model.start, inputs)
    ]
    if problems:
        raise MechanismError(problems)


def require_outside(model: Model, time: float, y: Array, inputs: Array) -> None:
    """Refuse a state inside an obstacle.

    :raises CommandError: the first elements are named, with the depths.
    """
    if found := penetrations(model, time, y, inputs):
        words = [f"{'.'.join(map(str, each.location))}: {each.text}" for each in found[:3]]
        more = f", and {len(found) - 3} more" if len(found) > 3 else ""
        raise CommandError(f"{'; '.join(words)}{more}", "Give positions in which they are apart or touch.")
