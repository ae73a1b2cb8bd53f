"""From the force elements of a file to the records that the dynamics reads."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mbd_sim.errors import InputError, Problem
from mbd_sim.geometry.pose import Pose
from mbd_sim.mechanism.attachments import end_of
from mbd_sim.mechanism.force_elements import AppliedForce, Damper, Spring
from mbd_sim.mechanism.laws import ElasticLaw, GreenStrain, Linear
from mbd_sim.mechanism.records import GROUND, Attachment
from mbd_sim.mechanism.source import Location, Source
from mbd_sim.mechanism_file.builders.law_builder import REACH, curve, damper_of
from mbd_sim.mechanism_file.schema import force_schema as schema

Places = Mapping[str, Mapping[str, Pose] | None]
Tie = schema.SpringSpec | schema.ElasticBarSpec | schema.DamperSpec


@dataclass(frozen=True)
class ForceElements:
    """What acts on the parts of a mechanism, besides gravity and what is in joints."""

    springs: tuple[Spring, ...]
    dampers: tuple[Damper, ...]
    applied: tuple[AppliedForce, ...]


def force_elements(
    records: Mapping[str, schema.AnyForceSpec], places: Places, source: Source, problems: list[Problem]
) -> ForceElements:
    """The force elements of a file; what is wrong with the others is added to `problems`."""
    springs: list[Spring] = []
    dampers: list[Damper] = []
    applied: list[AppliedForce] = []
    for name, record in records.items():
        if isinstance(record, Tie):
            ends = _ends(name, record, places, source, problems)
            if ends is None:
                continue
            if isinstance(record, schema.DamperSpec):
                dampers.append(Damper(name, *ends, damper_of(record), record.along == "line"))
            else:
                springs.append(_spring(name, record, ends, source, problems))
        elif element := _applied(name, record, places, source, problems):
            applied.append(element)
    return ForceElements(tuple(springs), tuple(dampers), tuple(applied))


def _ends(
    name: str, record: Tie, places: Places, source: Source, problems: list[Problem]
) -> tuple[Attachment, Attachment] | None:
    location: Location = ("forces", name, "between")
    first, second = (_frame(text, (*location, i), places, source, problems) for i, text in enumerate(record.between))
    if first is None or second is None:
        return None
    if first[0].part == second[0].part:
        remedy = "Name points of two different parts."
        problems.append(source.problem(location, f"connects '{first[0].part}' with itself", remedy))
        return None
    return first[0], second[0]


def _spring(
    name: str,
    record: schema.SpringSpec | schema.ElasticBarSpec,
    ends: tuple[Attachment, Attachment],
    source: Source,
    problems: list[Problem],
) -> Spring:
    law = _law(record)
    location: Location = ("forces", name)
    if isinstance(record, schema.ElasticBarSpec):
        return Spring(name, *ends, law, record.length, record.damping)
    if law == Linear(0.0) and not record.damping:
        remedy = "Give it 'stiffness', 'force' or 'table', or 'damping'."
        problems.append(source.problem(location, "has neither stiffness nor damping", remedy))
    if record.mass and GROUND not in (ends[0].part, ends[1].part):
        message = "a spring with a mass of its own must have one end on ground"
        remedy = "Remove its mass, and weld a particle of half the mass to the part at each end."
        problems.append(source.problem((*location, "mass"), message, remedy))
    return Spring(name, *ends, law, record.length, record.damping, record.mass)


def _law(record: schema.SpringSpec | schema.ElasticBarSpec) -> ElasticLaw | GreenStrain:
    if isinstance(record, schema.ElasticBarSpec):
        green = record.strain == "green"
        return GreenStrain(record.stiffness, record.length) if green else Linear(record.stiffness)
    if record.force is None and record.table is None:
        return Linear(record.stiffness)
    return curve(record.force, record.table, -record.length, REACH * max(1.0, record.length))


def _applied(
    name: str,
    record: schema.PointForceSpec | schema.CoupleSpec,
    places: Places,
    source: Source,
    problems: list[Problem],
) -> AppliedForce | None:
    location: Location = ("forces", name)
    key, text = ("on", record.on) if isinstance(record, schema.CoupleSpec) else ("at", record.at)
    at = _frame(text, (*location, key), places, source, problems)
    own = record.axes == "part"  # a word of the file's language, even where a part is called so
    axes = at if own else _frame(record.axes, (*location, "axes"), places, source, problems)
    if at is None or axes is None:
        return None
    if at[0].part == GROUND:
        problems.append(source.problem((*location, key), "acts on ground, which does not move", "Name a part."))
        return None
    rotation = np.eye(3) if own else axes[1].rotation
    return AppliedForce(name, at[0], record.vector, isinstance(record, schema.CoupleSpec), axes[0].part, rotation)


def _frame(
    text: str, location: Location, places: Places, source: Source, problems: list[Problem]
) -> tuple[Attachment, Pose] | None:
    """A point of a part as a text names it, and the frame that stands there."""
    try:
        part, pose = end_of(text, places)
    except InputError as error:
        problems.append(source.problem_of(location, error))
        return None
    return Attachment(part, np.array(pose.position)), pose
