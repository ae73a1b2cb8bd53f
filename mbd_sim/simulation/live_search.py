"""Finds the numbers of the equations that depend on named values of a mechanism file, by changing these."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mbd_sim.errors import InputError, MechanismError, Problem, nearest
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.mechanism_cache import cached, records_digest
from mbd_sim.mechanism_file.override import location_of, matching, values_of, with_values

if TYPE_CHECKING:
    from mbd_sim.dynamics.symbolic_parameters import EquationData

_PROBE_FACTORS = (1.01, 0.99)  # applied to a value to find the numbers that depend on it
_PROBES_OF_ZERO = (1e-3, -1e-3)


@dataclass(frozen=True, slots=True)
class LiveNumbers:
    """The live values at the start by key, and `indices`, `columns` and values as in `SymbolicParameters`."""

    current: dict[str, float]
    indices: NDArray[np.intp]
    columns: NDArray[np.intp]
    values: Array


def live_numbers(mechanism: Mechanism, names: Sequence[str]) -> LiveNumbers:
    """The live values of these names, from the cache if they were searched for before: see `LiveValues`.

    :raises MechanismError: a name does not exist or cannot change, or a pattern matches nothing.
    """
    if mechanism.source.changed:
        return _searched(mechanism, names)
    return cached(lambda: _searched(mechanism, names), "live values", records_digest(mechanism), *names)


def _searched(mechanism: Mechanism, names: Sequence[str]) -> LiveNumbers:
    from mbd_sim.dynamics.symbolic_parameters import StructureError, equation_data, varying_parameters

    base, file = equation_data(mechanism), mechanism.source.file
    matches = {name: _matches(mechanism, name) for name in names}
    problems = [
        Problem("no number of the file has such a key", nearest(name, matching(mechanism, ["*"])), name, file=file)
        for name, found in matches.items()
        if not found
    ]
    keys = _each_once(mechanism, [key for found in matches.values() for key in found])
    values = values_of(mechanism, keys)
    given = {_location(mechanism, name) for name in names if "*" not in name}
    numbers: dict[str, EquationData] = {}
    for key in keys:
        try:
            numbers[key] = _probed(mechanism, key, values[key], base)
        except StructureError as error:
            if _location(mechanism, key) in given:
                remedy = _remedy_of_list(mechanism, key) or "Change the file and start again."
                problems.append(Problem(f"cannot change during a run: {error}", remedy, key, file=file))
    if problems:
        raise MechanismError(problems)
    parameters = varying_parameters(base, list(numbers.values()))
    current = {key: values[key] or 0.0 for key in numbers}
    return LiveNumbers(current, parameters.indices, parameters.columns, parameters.base)


def names_with_matches(mechanism: Mechanism, names: Sequence[str]) -> list[str]:
    """The names without those patterns that no number of the file matches; from the cache if known."""

    def search() -> list[str]:
        return [name for name in names if _matches(mechanism, name)]

    if mechanism.source.changed:
        return search()
    return cached(search, "live names", records_digest(mechanism), *names)


def _matches(mechanism: Mechanism, name: str) -> list[str]:
    return matching(mechanism, [name]) if "*" in name else [name]


def _each_once(mechanism: Mechanism, keys: Iterable[str]) -> list[str]:
    """The keys without those that name the same value by another name: `l` and `parameters.l`."""
    first: dict[object, str] = {}
    for key in keys:
        first.setdefault(_location(mechanism, key), key)
    return list(first.values())


def _location(mechanism: Mechanism, key: str) -> object:
    """Where a value is, or the key of one that does not exist: its problem is reported with its value."""
    try:
        return location_of(mechanism, key)
    except InputError:
        return key


def _remedy_of_list(mechanism: Mechanism, key: str) -> str:
    """What to name in place of a list of numbers; empty if the key is none."""
    if not matching(mechanism, [f"{key}[*]"]):
        return ""
    return f"Name one of its numbers, such as '{key}[0]', or '{key}[*]' for all of them."


def _probed(mechanism: Mechanism, key: str, value: float | None, base: EquationData) -> EquationData:
    """The numbers of the mechanism with another value at a key than the present one.

    :raises StructureError: the value is not a number, is built into the equations, or is not used by them.
    """
    from mbd_sim.dynamics.symbolic_parameters import StructureError, equation_data, varying_parameters

    if value is None:
        raise StructureError("it is not a number")
    probes = [factor * value for factor in _PROBE_FACTORS] if value else list(_PROBES_OF_ZERO)
    refusal = None
    for probe in probes:
        try:
            numbers = equation_data(with_values(mechanism, {key: probe}))
        except MechanismError as error:
            refusal = error
            continue
        if not len(varying_parameters(base, [numbers]).base):
            raise StructureError("the equations of motion do not depend on it")
        return numbers
    assert refusal is not None
    raise StructureError(f"no value near {value:g} is possible: {refusal.problems[0].message}") from refusal
