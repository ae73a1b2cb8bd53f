"""Values of a mechanism's file replaced, named as errors name them: `parameters.l`, `joints.elbow.damping`."""

from __future__ import annotations

import copy
import fnmatch
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any

from pydantic import BaseModel

from mbd_sim.errors import MechanismError, Problem, nearest
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.mechanism.source import Location, Source, dotted
from mbd_sim.mechanism_file.builders.mechanism_builder import build
from mbd_sim.mechanism_file.validation import validate

_STEP = re.compile(r"\.?(?:'([^']+)'|([^.\[\]']+))|\[(\d+)\]")
_SECTIONS = ("gravity", "parameters", "parts", "joints", "forces", "constraints", "ground", "integrator")


def with_values(mechanism: Mechanism, changes: Mapping[str, float | str]) -> Mechanism:
    """The mechanism with other values, in SI units or as the file would have them: `0.5`, `"30 deg"`, `"2*l"`.

    A parameter of the file may be called by its name alone.

    :raises MechanismError: there is no such key, or a value does not fit.
    """
    data, lines = copy.copy(mechanism.source.data), mechanism.source.lines
    problems = []
    for name, value in changes.items():
        try:
            data = _set(data, location_of(mechanism, name), value)
        except LookupError as error:
            message, remedy = error.args
            problems.append(Problem(message, remedy, key=name, file=mechanism.source.file))
    if problems:
        raise MechanismError(problems)
    source = Source(data, lines, mechanism.source.file, mechanism.source.text)
    file, parameters = validate(source)
    return build(file, parameters, source)


def location_of(mechanism: Mechanism, name: str) -> Location:
    """Where in the file a name points to.

    :raises LookupError: it cannot be a key; the error holds a message and a remedy.
    """
    data = mechanism.source.data
    location: list[str | int] = []
    position = 0
    while position < len(name):
        found = _STEP.match(name, position)
        if found is None or (position == 0 and found[3]):
            raise LookupError("is not a key of a mechanism file", "Write for example joints.elbow.damping.")
        location.append(int(found[3]) if found[3] else found[1] or found[2])
        position = found.end()
    if len(location) == 1 and location[0] in (data.get("parameters") or {}):
        return ("parameters", *location)
    if not location or location[0] not in _SECTIONS:
        first = str(location[0]) if location else ""
        raise LookupError("names nothing in the file", nearest(first, [*(data.get("parameters") or {}), *_SECTIONS]))
    return tuple(location)


def value_of(mechanism: Mechanism, name: str) -> float | None:
    """The number in SI units that a key has now, also where the file leaves it out; None where it is not a number.

    :raises MechanismError: there is no such key.
    """
    try:
        location = location_of(mechanism, name)
        if location[0] == "parameters" and len(location) == 2:
            return mechanism.parameters[str(location[1])]
        found: Any = validate(mechanism.source)[0]
        for step in location:
            found = _inside(found, step)
    except LookupError as error:
        message, remedy = error.args if len(error.args) == 2 else ("names nothing in the file", "")
        raise MechanismError([Problem(message, remedy, key=name, file=mechanism.source.file)]) from error
    return float(found) if isinstance(found, int | float) and not isinstance(found, bool) else None


def matching(mechanism: Mechanism, patterns: Collection[str]) -> list[str]:
    """The keys of numbers of the file that match any of some patterns such as `joints.*.damping`, in its order."""
    file, _ = validate(mechanism.source)
    names = [f"parameters.{name}" for name in mechanism.parameters]
    names += [dotted(location) for location in _numbers(file, ()) if location[0] != "parameters"]
    return [
        name for name in names if any(fnmatch.fnmatchcase(name, pattern.replace("[", "[[]")) for pattern in patterns)
    ]


def _numbers(data: Any, location: Location) -> Iterator[Location]:
    """Where numbers stand; expressions of time hold numbers as well, which are no keys of the file."""
    if isinstance(data, Mapping | BaseModel):
        for key, value in data.items() if isinstance(data, Mapping) else data:
            yield from _numbers(value, (*location, key))
    elif isinstance(data, list | tuple):
        for index, value in enumerate(data):
            yield from _numbers(value, (*location, index))
    elif isinstance(data, float):
        yield location


def _inside(found: Any, step: str | int) -> Any:
    if isinstance(step, int):
        if isinstance(found, Sequence) and not isinstance(found, str) and step < len(found):
            return found[step]
        raise LookupError(f"has no entry {step}", "")
    if isinstance(found, Mapping):
        if step in found:
            return found[step]
        raise LookupError(f"there is no '{step}'", nearest(step, found))
    if step in getattr(type(found), "model_fields", {}):
        return getattr(found, step)
    raise LookupError(f"has no '{step}'", nearest(step, getattr(type(found), "model_fields", ())))


def _set(data: Any, location: Location, value: float | str) -> Any:
    """A copy with one value set; what it does not touch is shared."""
    if not location:
        return value
    step, rest = location[0], location[1:]
    if isinstance(step, int):
        if not isinstance(data, list):
            raise LookupError(f"is no list that could have an entry {step}", "")
        if step >= len(data):
            raise LookupError(f"has no entry {step}", f"The last one is {len(data) - 1}.")
        return [*data[:step], _set(data[step], rest, value), *data[step + 1 :]]
    if not isinstance(data, Mapping):
        raise LookupError(f"has no '{step}'", "")
    if rest and step not in data:
        if step == "gravity":
            return {**data, step: _set([0.0, 0.0, -9.81], rest, value)}
        raise LookupError(f"there is no '{step}'", nearest(step, data))
    return {**data, step: _set(data.get(step), rest, value)}
