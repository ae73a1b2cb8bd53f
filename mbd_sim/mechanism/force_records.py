"""From the force elements of a file to the records that the dynamics reads."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mbd_sim.errors import Problem
from mbd_sim.mechanism import schema_forces as schema
from mbd_sim.mechanism.ends import end_of
from mbd_sim.mechanism.model import GROUND, AppliedForce, Attachment, Pose, Spring
from mbd_sim.mechanism.source import Location, Source

Places = Mapping[str, Mapping[str, Pose] | None]


def force_elements(
    records: Mapping[str, schema.AnyForce], places: Places, source: Source, problems: list[Problem]
) -> tuple[tuple[Spring, ...], tuple[AppliedForce, ...]]:
    """The springs and the applied forces of a file; what is wrong with the others is added to `problems`."""
    springs: list[Spring] = []
    applied: list[AppliedForce] = []
    for name, record in records.items():
        location: Location = ("forces", name)
        if isinstance(record, schema.Spring):
            ends = [
                _attached(text, (*location, "between", i), places, source, problems)
                for i, text in enumerate(record.between)
            ]
            first, second = ends
            if first is None or second is None:
                continue
            if first.part == second.part:
                remedy = "Name points of two different parts."
                problems.append(source.problem((*location, "between"), f"connects '{first.part}' with itself", remedy))
                continue
            if not record.stiffness and not record.damping:
                problems.append(source.problem(location, "has neither stiffness nor damping", "Give it one of them."))
            springs.append(Spring(name, first, second, record.stiffness, record.length, record.damping))
            continue
        couple = isinstance(record, schema.Couple)
        key, text = ("on", record.on) if isinstance(record, schema.Couple) else ("at", record.at)
        at = _attached(text, (*location, key), places, source, problems)
        if at is None:
            continue
        if at.part == GROUND:
            problems.append(source.problem((*location, key), "acts on ground, which does not move", "Name a part."))
            continue
        applied.append(AppliedForce(name, at, record.vector, couple, record.axes == "part"))
    return tuple(springs), tuple(applied)


def _attached(
    text: str, location: Location, places: Places, source: Source, problems: list[Problem]
) -> Attachment | None:
    try:
        part, pose = end_of(text, places)
    except LookupError as error:
        message, remedy = error.args
        problems.append(source.problem(location, message, remedy))
        return None
    return Attachment(part, np.array(pose.position))
