"""Angles in a mechanism file that were probably meant in degrees."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from mbd_sim.mechanism.source import Location, Source, dotted

SECTIONS = ("ground", "parts", "joints", "constraints", "contacts", "forces", "actuators")


def large_bare_angles(source: Source) -> list[tuple[str, float]]:
    """Keys and values of angles in rad that the file writes without a unit, and that exceed a full turn."""
    if not isinstance(source.data, dict):
        return []
    numbers = (found for section in SECTIONS for found in _numbers(source.data.get(section), (section,)))
    return [
        (dotted(location), float(value))
        for location, value in numbers
        if abs(value) > 2.0 * math.pi and location in source.lines and _unit(source, location) == "rad"
    ]


def _unit(source: Source, location: Location) -> str:
    from mbd_sim.mechanism_file.json_schema import unit_at  # with the schema, which few files need here

    return unit_at(source.data, location)


def _numbers(value: Any, location: Location) -> Iterator[tuple[Location, float]]:
    if isinstance(value, dict | list):
        for key, inner in value.items() if isinstance(value, dict) else enumerate(value):
            yield from _numbers(inner, (*location, key))
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield location, value
