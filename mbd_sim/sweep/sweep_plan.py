"""What a sweep varies: values on a grid, and values drawn at random."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mbd_sim.errors import CommandError, InputError, MechanismError, listed
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.mechanism_file.override import value_of
from mbd_sim.mechanism_file.value_parser import parse_value

EFFORT = "efforts."  # before the name of a joint: a constant effort on it
MOST = 10_000_000  # runs

_Draw = Callable[[np.random.Generator, float, float, int], Array]
_LAWS: Mapping[str, tuple[str, _Draw]] = {
    "uniform": ("low, high", lambda random, a, b, n: random.uniform(a, b, n)),
    "loguniform": ("low, high", lambda random, a, b, n: np.exp(random.uniform(np.log(a), np.log(b), n))),
    "normal": ("mean, deviation", lambda random, a, b, n: random.normal(a, b, n)),
}
_CALL = re.compile(r"(\w+)\((.*)\)")
_EXAMPLES = "Write NAME=0.5:2:20 for 20 values, NAME=0.5,1,2 for these, or NAME=uniform(0.5, 2)."


@dataclass(frozen=True)
class Grid:
    """A name that takes each of some values, in SI units."""

    name: str
    values: tuple[float, ...]


@dataclass(frozen=True)
class Random:
    """A name whose value is drawn for each run by a `law` of two numbers, in SI units."""

    name: str
    law: str
    first: float
    second: float


@dataclass(frozen=True, eq=False)
class Plan:
    """`values` (runs, names) in SI units: every combination of the grids, each drawn as often as asked."""

    names: tuple[str, ...]
    values: Array

    def changes(self, first: int, beyond: int) -> list[dict[str, float]]:
        """What differs in some of the runs."""
        return [dict(zip(self.names, row, strict=True)) for row in self.values[first:beyond].tolist()]


def variation(text: str, mechanism: Mechanism) -> Grid | Random:
    """Read `NAME=START:STOP:COUNT`, `NAME=VALUE,VALUE,…` or `NAME=LAW(A, B)`; values may have units.

    :raises CommandError: it cannot be read, or the mechanism has no such number.
    """
    name, equals, rest = (part.strip() for part in text.partition("="))
    if not equals or not rest:
        raise CommandError(f"'{text}' varies nothing. {_EXAMPLES}")
    _require_number(name, mechanism)

    def number(word: str) -> float:
        try:
            return parse_value(_plain(word), mechanism.parameters, None)
        except InputError as error:
            raise CommandError(f"{text}: '{word.strip()}' {error.message}. {error.remedy}") from error

    if called := _CALL.fullmatch(rest):
        return _random(name, called[1], [number(word) for word in called[2].split(",")], text)
    if rest.count(":") == 2:
        start, stop, count = rest.split(":")
        if not count.strip().isdigit() or not 1 <= int(count) <= MOST:
            raise CommandError(f"{text}: '{count.strip()}' is no number of values. {_EXAMPLES}")
        return Grid(name, tuple(np.linspace(number(start), number(stop), int(count)).tolist()))
    if ":" in rest:
        raise CommandError(f"{text}: a range is START:STOP:COUNT. {_EXAMPLES}")
    return Grid(name, tuple(number(word) for word in rest.split(",")))


def plan(variations: Sequence[Grid | Random], draws: int = 1, seed: int = 0) -> Plan:
    """Every combination of the grids, `draws` times, with what is random drawn anew for each run.

    :raises CommandError: a name is varied twice, or there would be too many runs.
    """
    names = [one.name for one in variations]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise CommandError(f"{listed(twice)} is varied twice.")
    grids = [one for one in variations if isinstance(one, Grid)]
    runs = draws * int(np.prod([len(grid.values) for grid in grids], dtype=float))
    if not 1 <= runs <= MOST:
        raise CommandError(f"{runs} runs are not between 1 and {MOST}.")
    points = np.array(list(itertools.product(*(grid.values for grid in grids)))).reshape(runs // draws, len(grids))
    columns = dict(zip((grid.name for grid in grids), np.repeat(points, draws, axis=0).T, strict=True))
    random = np.random.default_rng(seed)
    for one in variations:
        if isinstance(one, Random):
            columns[one.name] = _LAWS[one.law][1](random, one.first, one.second, runs)
    return Plan(tuple(names), np.column_stack([columns[name] for name in names]) if names else np.zeros((runs, 0)))


def _require_number(name: str, mechanism: Mechanism) -> None:
    if name.startswith(EFFORT):
        known = mechanism.coordinate_names
        if name.removeprefix(EFFORT) not in known:
            raise CommandError(f"there is no joint '{name.removeprefix(EFFORT)}'. Joints: {listed(known)}.")
        return
    try:
        value = value_of(mechanism, name)
    except MechanismError as error:
        problem = error.problems[0]
        raise CommandError(f"'{name}' {problem.message}. {problem.remedy}") from error
    if value is None:
        raise CommandError(f"'{name}' is not a number of the file. Write for example joints.elbow.damping.")


def _random(name: str, law: str, numbers: list[float], text: str) -> Random:
    if law not in _LAWS:
        raise CommandError(f"{text}: there is no law '{law}'. Laws: {listed(list(_LAWS))}.")
    if len(numbers) != 2:
        raise CommandError(f"{text}: write {law}({_LAWS[law][0]}).")
    first, second = numbers
    if law == "loguniform" and not 0.0 < first <= second:
        raise CommandError(f"{text}: loguniform needs 0 < low <= high.")
    if law == "normal" and second < 0.0:
        raise CommandError(f"{text}: a deviation is not negative.")
    return Random(name, law, first, second)


def _plain(word: str) -> float | str:
    """A number as such, so that 1e3 is not taken for a name."""
    try:
        return float(word)
    except ValueError:
        return word
