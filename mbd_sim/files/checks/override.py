"""Replaces values of a mechanism's file by their keys, as error messages write them: `joints.elbow.damping`."""

from __future__ import annotations

import fnmatch
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from mbd_sim.base.errors import InputError, MechanismError, Problem, nearest
from mbd_sim.files.text.spelling import FORMER_KEYS, as_written, synonym
from mbd_sim.files.text.units import factor, parse_value, si_factor, split_unit
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.values.names import split_key
from mbd_sim.mechanism.values.source import Location, Source, dotted

if TYPE_CHECKING:
    from mbd_sim.files.schema.file import MechanismFile

_SECTIONS = (
    "tolerance",
    "gravity",
    "limits",
    "parameters",
    "functions",
    "parts",
    "joints",
    "forces",
    "actuators",
    "bases",
    "constraints",
    "contacts",
    "sensors",
    "sensor_seed",
    "ground",
    "integrator",
)


def with_values(mechanism: Mechanism, changes: Mapping[str, Any], *, mend_loops: bool = True) -> Mechanism:
    """The mechanism with other values, each a number in SI units or as in the file: `"30 deg"`, `"2*l"`, `[0, 0, 1]`.

    :param changes: the values by their keys; a parameter of the file may be given by its name alone.
    :param mend_loops: whether loops that are exact only to the digits of the file are made exact, as in a file.
    :raises MechanismError: a key does not exist, or a value is not valid there.
    """
    source, locations, problems = mechanism.source, {}, []
    changes = {name: (value.tolist() if hasattr(value, "tolist") else value) for name, value in changes.items()}
    for name in changes:
        try:
            locations[name] = location_of(mechanism, name)
            _require_known_shape(source, locations[name])
            _require_declared(source, locations[name])
            _require_like_unit(source, locations[name], changes[name])
        except MechanismError as error:
            problems += error.problems
        except InputError as error:
            problems.append(_problem(mechanism, name, error))
    if problems:
        raise MechanismError(problems)
    if any(_changes_shape(source, location) for location in locations.values()):
        source = _repeated_again(mechanism, changes)
        changes = source.changes
        locations = {name: location_of(mechanism, name) for name in changes}
    data = source.data
    for name, location in locations.items():
        try:
            data = _replaced(data, location, changes[name])
        except InputError as error:
            problems.append(_problem(mechanism, name, error))
    if problems:
        raise MechanismError(problems)
    source = replace(source, data=data, changed=True, changes={**source.changes, **changes})
    from mbd_sim.files.builders.mechanism import build

    return build(*_validated(source), source, mend_loops=mend_loops)


def _validated(source: Source) -> tuple[MechanismFile, dict[str, float]]:
    # Imported here because the schema takes most of the time of a start, and most runs change nothing.
    from mbd_sim.files.checks.validation import validate

    return validate(source)


def _changes_shape(source: Source, location: Location) -> bool:
    """Whether the entries of the file depend on the value at a location."""
    if source.template is None and not source.shaping:
        return False
    return location[0] == "functions" or (
        location[0] == "parameters" and location[1:2] != () and location[1] in source.shaping
    )


def _require_known_shape(source: Source, location: Location) -> None:
    if source.template is None and source.shaping and _changes_shape(source, location):
        raise InputError(
            "cannot be changed here: it determines the number of entries of a file that extends a URDF",
            "Change it in the file.",
        )


def _require_declared(source: Source, location: Location) -> None:
    """Refuse new parameters and functions, which nothing in the file uses."""
    section = location[0]
    if section in ("parameters", "functions") and len(location) > 1:
        declared = source.data.get(section) or {}
        if location[1] not in declared:
            kind = str(section).removesuffix("s")
            remedy = nearest(str(location[1]), declared) or f"The file has no {section}."
            raise InputError(f"there is no {kind} '{location[1]}'", remedy)


def _require_like_unit(source: Source, location: Location, value: Any) -> None:
    """Refuse a parameter with a unit of another dimension than the unit that it has in the file."""
    if location[0] != "parameters" or len(location) != 2 or not isinstance(value, str):
        return
    written = (source.data.get("parameters") or {}).get(location[1])
    if isinstance(written, str) and (own := split_unit(written)[1]) and (unit := split_unit(value)[1]):
        factor(unit, own)


def _repeated_again(mechanism: Mechanism, changes: Mapping[str, Any]) -> Source:
    """The source with repetitions by the changed parameters; its `changes` are those still to be made."""
    source, data = mechanism.source, mechanism.source.template
    every = {**source.changes, **changes}
    for name, value in every.items():
        location = location_of(mechanism, name)
        if location[0] in ("parameters", "functions"):
            data = _replaced(data, location, value)
    from mbd_sim.files.checks.repetition import expanded
    from mbd_sim.files.text.mesh_files import with_mesh_hulls
    from mbd_sim.files.text.mesh_solids import with_mesh_solids

    again = expanded(Source(data, source.template_lines, source.file, source.text))
    again = with_mesh_solids(with_mesh_hulls(again, True))
    again.changes = every
    return again


def location_of(mechanism: Mechanism, key: str) -> Location:
    """The location in the file's data that a key names.

    :raises MechanismError: it is not a key of a mechanism file.
    """
    data = mechanism.source.data
    parameters = data.get("parameters") or {}
    try:
        location = split_key(key)
        if len(location) == 1 and location[0] in parameters:
            return ("parameters", *location)
        if not location or location[0] not in _SECTIONS:
            first = str(location[0]) if location else ""
            raise InputError("is not a key of this file", _similar(first, [*parameters, *_SECTIONS]))
    except InputError as error:
        raise MechanismError([_problem(mechanism, key, error)]) from error
    return tuple(location)


def value_of(mechanism: Mechanism, key: str) -> float | None:
    """The number in SI units that a key has now, given or by default; None if its value is not a number.

    :raises MechanismError: there is no such key.
    """
    return values_of(mechanism, [key])[key]


def values_of(mechanism: Mechanism, keys: Collection[str]) -> dict[str, float | None]:
    """`value_of` for several keys; the file is validated once."""
    if not keys:
        return {}
    file, _ = _validated(mechanism.source)
    return {key: _value_in(file, mechanism, key) for key in keys}


def _value_in(file: MechanismFile, mechanism: Mechanism, key: str) -> float | None:
    try:
        location = location_of(mechanism, key)
        if location[0] == "parameters" and len(location) == 2:
            return float(_entry(mechanism.parameters, location[1]))
        value: Any = file
        for step in location:
            value = _entry(value, step)
    except InputError as error:
        raise MechanismError([_problem(mechanism, key, error)]) from error
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None


def number_at(mechanism: Mechanism, key: str, value: object, names: Mapping[str, float]) -> float:
    """The number in SI units that a value of a key stands for: a number, or a text such as `"30 deg"` or `"2*l"`.

    :param names: the values of the names that an expression may refer to.
    :raises InputError: it is no number, or its unit is not one of this key: that of the file, converted to it, must be
        valid in its place.
    """
    number, unit = parse_value(value, names, None), split_unit(value)[1] if isinstance(value, str) else ""
    if not unit:
        return number
    present = value_of(mechanism, key)
    if present is None:
        raise InputError(f"'{key}' is not a number in the file", "Name a number, such as joints.elbow.damping.")
    try:
        with_values(mechanism, {key: f"{present / si_factor(unit)!r} {unit}"})
    except MechanismError as error:
        raise InputError(error.problems[0].message, error.problems[0].remedy) from error
    from mbd_sim.files.checks.json_schema import unit_at  # with the schema

    return parse_value(value, names, unit_at(mechanism.source.data, location_of(mechanism, key)) or None)


def matching(mechanism: Mechanism, patterns: Collection[str]) -> list[str]:
    """The keys of the file's numbers that match any of the patterns, such as `joints.*.damping`, in its order."""
    file, _ = _validated(mechanism.source)
    keys = [f"parameters.{name}" for name in mechanism.parameters]
    keys += [dotted(location) for location in _numbers(file, ()) if location[0] not in ("parameters", "ranges")]
    wanted = [_current_spelling(pattern).replace("[", "[[]") for pattern in patterns]
    return [key for key in keys if any(fnmatch.fnmatchcase(key, pattern) for pattern in wanted)]


def _current_spelling(pattern: str) -> str:
    section, dot, key = pattern.rpartition(".")
    return f"{section}{dot}{FORMER_KEYS.get(key, key)}"


def _problem(mechanism: Mechanism, key: str, error: InputError) -> Problem:
    return Problem(error.message, error.remedy, key=key, file=mechanism.source.file)


def _numbers(data: Any, location: Location) -> Iterator[Location]:
    """The locations of numbers; those inside expressions of time are not keys of the file."""
    if isinstance(data, Mapping) or hasattr(type(data), "model_fields"):
        for key, value in data.items() if isinstance(data, Mapping) else data:
            yield from _numbers(value, (*location, key))
    elif isinstance(data, list | tuple):
        for index, value in enumerate(data):
            yield from _numbers(value, (*location, index))
    elif isinstance(data, float):
        yield location


def _entry(container: Any, step: str | int) -> Any:
    """The value under a key or an index of a mapping, a list or a record."""
    if isinstance(step, int):
        if not isinstance(container, Sequence) or isinstance(container, str):
            raise InputError(f"is not a list, and so has no entry {step}", "Leave the index out.")
        if step >= len(container):
            raise InputError(f"has no entry {step}", f"The last entry is {len(container) - 1}.")
        return container[step]
    if isinstance(container, Mapping):
        if step in container:
            return container[step]
        raise InputError(f"there is no '{step}'", _similar(step, container))
    keys = getattr(type(container), "model_fields", {})
    if (key := as_written(step, keys)) in keys:
        return getattr(container, key)
    raise InputError(f"has no '{step}'", _similar(step, keys))


def _similar(word: str, known: Collection[str]) -> str:
    """A remedy that names a key which a word stands for, or resembles."""
    return f"Did you mean '{found}'?" if (found := synonym(word, known)) else nearest(word, known)


def _replaced(data: Any, location: Location, value: float | str) -> Any:
    """A copy with one value replaced, which shares everything else with the original."""
    if not location:
        return value
    step, rest = location[0], location[1:]
    if isinstance(step, int):
        if not isinstance(data, list):
            raise InputError(f"is not a list, and so has no entry {step}", "Leave the index out.")
        if step >= len(data):
            raise InputError(f"has no entry {step}", f"The last entry is {len(data) - 1}.")
        return [*data[:step], _replaced(data[step], rest, value), *data[step + 1 :]]
    if not isinstance(data, Mapping):
        raise InputError(f"has no '{step}'", "It has no keys: name the value itself.")
    step = as_written(step, data)
    if rest and step not in data:
        if step == "gravity":
            return {**data, step: _replaced([0.0, 0.0, -9.81], rest, value)}
        if step == "integrator":  # of which every key has a default
            return {**data, step: _replaced({}, rest, value)}
        raise InputError(f"there is no '{step}'", nearest(step, data))
    return {**data, step: _replaced(data.get(step), rest, value)}
