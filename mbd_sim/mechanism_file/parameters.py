"""The `parameters` of a mechanism file, which may refer to each other in any order."""

from __future__ import annotations

import keyword
from collections.abc import Mapping
from dataclasses import dataclass, field

from mbd_sim.errors import InputError, Problem, listed, nearest, quoted
from mbd_sim.mechanism.expression import CONSTANTS, FUNCTIONS, names_in
from mbd_sim.mechanism.source import Source
from mbd_sim.mechanism_file.value_parser import parse_value, split_unit


@dataclass
class Parameters:
    """The values of a file's parameters in SI units, the names of those that have none, and why they have none."""

    values: dict[str, float] = field(default_factory=dict)
    unresolved: set[str] = field(default_factory=set)
    problems: list[Problem] = field(default_factory=list)


def resolve_parameters(source: Source) -> Parameters:
    """Evaluate the file's `parameters`, each after those that it refers to."""
    result = Parameters()
    written = source.data.get("parameters")
    if not isinstance(written, dict):
        return result

    def fail(name: str, error: InputError) -> None:
        result.problems.append(source.problem(("parameters", name), error.message, error.remedy, written[name]))
        result.unresolved.add(name)

    uses: dict[str, set[str]] = {}
    for name, value in written.items():
        try:
            uses[name] = _used_names(name, value, written)
        except InputError as error:
            fail(name, error)
    for name in _dependencies_first(uses):
        if uses[name] & result.unresolved:
            result.unresolved.add(name)
            continue
        try:
            result.values[name] = parse_value(written[name], result.values, si_unit=None)
        except InputError as error:
            fail(name, error)
    left = {name: used for name, used in uses.items() if name not in result.values and name not in result.unresolved}
    result.unresolved |= set(left)
    after_a_circle = set(_dependencies_first(_users(left)))
    circle = [name for name in left if name not in after_a_circle]
    for name in circle:
        message = f"parameters refer to each other in a circle: {listed(circle)}"
        fail(name, InputError(message, "Replace one of these references by a number."))
    return result


def _used_names(name: str, value: object, written: Mapping[str, object]) -> set[str]:
    if name in CONSTANTS or name in FUNCTIONS or keyword.iskeyword(name):
        raise InputError(f"'{name}' has a meaning in expressions", "Choose another name.")
    used = names_in(split_unit(value)[0]) if isinstance(value, str) else set()
    unknown = sorted(used - set(written))
    if unknown:
        remedy = nearest(unknown[0], set(written) - {name}) or "Define it under 'parameters'."
        raise InputError(f"unknown name {quoted(unknown[0])}", remedy)
    return used


def _dependencies_first(uses: Mapping[str, set[str]]) -> list[str]:
    """The names, each after those that it uses; without names in circles and those that depend on them."""
    users = _users(uses)
    waiting = {name: len(used & uses.keys()) for name, used in uses.items()}
    order = [name for name, count in waiting.items() if not count]
    for name in order:
        for user in sorted(users[name]):
            waiting[user] -= 1
            if not waiting[user]:
                order.append(user)
    return order


def _users(uses: Mapping[str, set[str]]) -> dict[str, set[str]]:
    """The names that use each name."""
    users: dict[str, set[str]] = {name: set() for name in uses}
    for name, used in uses.items():
        for other in used & uses.keys():
            users[other].add(name)
    return users
