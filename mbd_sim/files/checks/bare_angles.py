"""Angles that were probably meant in degrees: they have no unit, and exceed a full turn."""

from __future__ import annotations

import ast
import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, TypeGuard

from mbd_sim.base.errors import InputError
from mbd_sim.files.text.units import factor, split_unit
from mbd_sim.mechanism.values.expression import parsed
from mbd_sim.mechanism.values.names import split_key
from mbd_sim.mechanism.values.source import Location, Source, dotted, value_at

TURN = 2.0 * math.pi
SECTIONS = ("parameters", "ranges", "ground", "parts", "joints", "constraints", "contacts", "forces", "actuators")
BOUNDED = ("sin", "cos", "tanh", "sign")  # functions that do not exceed 1


def bare_argument_remark(text: str, values: Iterable[object]) -> str:
    """A sentence on the largest of the values of an angle in an argument that are numbers; empty if all are usual."""
    value = max((value for value in values if _is_large(value)), key=abs, default=None)
    if value is None:
        return ""
    return (
        f"{text}: {value:g} is in rad ({_degrees(value)}), because it has no unit. Write {value:g}deg or {value:g}rad."
    )


def bare_angle_remarks(source: Source) -> list[str]:
    """A sentence on each angle that a file, or a change of its values, gives without a unit."""
    if not isinstance(source.data, dict):
        return []
    written = source.data.get("parameters")
    bare = {name: value for name, value in written.items() if _is_large(value)} if isinstance(written, dict) else {}
    numbers = (found for section in SECTIONS for found in _angles(source.data.get(section), (section,), bare))
    return [
        f"{dotted(location)} is {value:g} rad ({_degrees(value)}), because {what} has no unit. Write {remedy}."
        for location, value, what, remedy in numbers
        if _is_written(source, location) and is_angle(source, location)
    ]


def _degrees(value: float) -> str:
    return f"{math.degrees(value):.4g}°"


def _is_large(value: Any) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool) and TURN < abs(value) < math.inf


def _is_written(source: Source, location: Location) -> bool:
    key = dotted(location).removeprefix("parameters.")
    changed = (dotted(tuple(split_key(name))).removeprefix("parameters.") for name in source.changes)
    return location in source.lines or any(key == name or key.startswith((f"{name}.", f"{name}[")) for name in changed)


def is_angle(source: Source, location: Location) -> bool:
    """Whether the value at a location of a file is an angle in rad; a parameter is one if it has the unit of one."""
    from mbd_sim.files.checks.json_schema import unit_at  # with the schema, which few files need here
    from mbd_sim.files.text.yaml_text import parse_source

    if location[0] == "ranges":
        location = ("parameters", location[1])
    if location[0] != "parameters":
        return unit_at(source.data, location) == "rad"
    data = parse_source(source.text).data if source.changed and source.text else source.data
    written = value_at(data, location)
    try:
        return isinstance(written, str) and factor(split_unit(written)[1] or "m", "rad") > 0.0
    except InputError:
        return False


def _angles(value: Any, location: Location, bare: Mapping[str, float]) -> Iterator[tuple[Location, float, str, str]]:
    """The locations and values of large numbers, what has the number there, and how to write it."""
    if isinstance(value, dict | list):
        for key, inner in value.items() if isinstance(value, dict) else enumerate(value):
            yield from _angles(inner, (*location, key), bare)
    elif _is_large(value):
        yield location, float(value), "it", f"{value:g} deg or {value:g} rad"
    elif isinstance(value, str) and (name := value.strip("${}+- ")) in bare:
        remedy = f"{name}: {bare[name]:g} deg or {name}: {bare[name]:g} rad"
        yield location, -bare[name] if value.count("-") == 1 else bare[name], f"the parameter '{name}'", remedy
    elif isinstance(value, str) and "drive" in location and (number := _largest_term(value)):
        yield location, number, "it", f"${{{value}}} deg if it is in degrees"


def _largest_term(text: str) -> float:
    """The largest number among the terms of an expression that no growing function multiplies: 90 in 90*sin(2*t)."""
    try:
        terms = [parsed(text).body]
    except InputError:
        return 0.0
    largest = 0.0
    while terms:
        match terms.pop():
            case ast.BinOp(left=left, op=ast.Add() | ast.Sub(), right=right):
                terms += [left, right]
            case ast.UnaryOp(operand=operand):
                terms.append(operand)
            case ast.Constant(value=value) if _is_large(value):
                largest = max(largest, float(value))
            case ast.BinOp(left=ast.Constant(value=value), op=ast.Mult(), right=ast.Call(func=ast.Name(id=name))) if (
                _is_large(value) and name in BOUNDED
            ):
                largest = max(largest, float(value))
    return largest
