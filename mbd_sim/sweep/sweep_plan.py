"""The varied values of a sweep: on a grid, or drawn at random."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mbd_sim.errors import CommandError, InputError, MechanismError, listed, nearest
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.names import split_assignment
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.mechanism_file.bare_angles import bare_argument_remark, is_angle
from mbd_sim.mechanism_file.override import location_of, number_at, value_of
from mbd_sim.mechanism_file.value_parser import parse_value

EFFORT = "efforts."  # the prefix of a joint's name for a constant effort on it
MAX_RUNS = 10_000_000

_Sample = Callable[[np.random.Generator, float, float, int], Array]
_DISTRIBUTIONS: Mapping[str, tuple[str, _Sample]] = {
    "uniform": ("low, high", lambda random, a, b, n: random.uniform(a, b, n)),
    "loguniform": ("low, high", lambda random, a, b, n: np.exp(random.uniform(np.log(a), np.log(b), n))),
    "normal": ("mean, deviation", lambda random, a, b, n: random.normal(a, b, n)),
}
_CALL = re.compile(r"(\w+)\((.*)\)")
_EXAMPLES = "Write NAME=0.5:2:20 for 20 values, NAME=0.5,1,2 for these values, or NAME=uniform(0.5, 2)."


@dataclass(frozen=True)
class Grid:
    """A name and the values that it takes, in SI units."""

    name: str
    values: tuple[float, ...]


@dataclass(frozen=True)
class Random:
    """A name whose value is drawn for each run from a distribution with two parameters, in SI units."""

    name: str
    distribution: str
    first: float
    second: float


@dataclass(frozen=True, eq=False)
class Plan:
    """The runs: `values` (runs, names) in SI units, with every combination of the grids."""

    names: tuple[str, ...]
    values: Array

    def changes(self, first: int, beyond: int) -> list[dict[str, float]]:
        """The values by name of the runs from `first` to before `beyond`."""
        return [dict(zip(self.names, row, strict=True)) for row in self.values[first:beyond].tolist()]


def variation(text: str, mechanism: Mechanism) -> Grid | Random:
    """Read `NAME=START:STOP:COUNT`, `NAME=VALUE,VALUE,…` or `NAME=DISTRIBUTION(A, B)`; values may have units.

    :raises CommandError: the text cannot be read, or the mechanism has no number of this name.
    """
    name, rest = split_assignment(text)
    if not rest:
        raise CommandError(f"'{text}' gives no values", _EXAMPLES)
    _require_number(name, mechanism)

    def number(word: str) -> float:
        try:
            if not name.startswith(EFFORT):
                return number_at(mechanism, name, _plain(word), mechanism.parameters)
            unit = mechanism.coordinate(name.removeprefix(EFFORT)).effort_unit.replace("·", "*")
            return parse_value(_plain(word), mechanism.parameters, unit)
        except InputError as error:
            raise CommandError(f"{text}: '{word.strip()}' {error.message}", error.remedy) from error

    if called := _CALL.fullmatch(rest):
        return _random(name, called[1], [number(word) for word in called[2].split(",")], text)
    if rest.count(":") == 2:
        start, stop, count = rest.split(":")
        if not count.strip().isdigit() or not 1 <= int(count) <= MAX_RUNS:
            raise CommandError(f"{text}: the number of values cannot be '{count.strip()}'", _EXAMPLES)
        return Grid(name, tuple(np.linspace(number(start), number(stop), int(count)).tolist()))
    if ":" in rest:
        raise CommandError(f"{text}: a range needs START:STOP:COUNT", _EXAMPLES)
    return Grid(name, tuple(number(word) for word in rest.split(",")))


def bare_variation_remark(text: str, mechanism: Mechanism) -> str:
    """A sentence if the text of a variation has an angle beyond a full turn without a unit, or ""."""
    name, rest = split_assignment(text)
    called, parts = _CALL.fullmatch(rest), rest.split(":")
    words = called[2].split(",") if called else parts[:2] if len(parts) > 1 else rest.split(",")
    if name.startswith(EFFORT) or not is_angle(mechanism.source, location_of(mechanism, name)):
        return ""
    return bare_argument_remark(text, [_plain(word) for word in words])


def plan(variations: Sequence[Grid | Random], draws: int = 1, seed: int = 0) -> Plan:
    """Every combination of the grids, `draws` times; random values are drawn for each run.

    :raises CommandError: a name is varied twice, or there are too many runs.
    """
    names = [one.name for one in variations]
    short = [name.removeprefix("parameters.") for name in names]
    if twice := sorted({name for name in short if short.count(name) > 1}):
        raise CommandError(f"{listed(twice)} is varied twice", "Remove one of the two.")
    grids = [one for one in variations if isinstance(one, Grid)]
    runs = draws * int(np.prod([len(grid.values) for grid in grids], dtype=float))
    if not 1 <= runs <= MAX_RUNS:
        raise CommandError(f"the number of runs must be between 1 and {MAX_RUNS}, not {runs}")
    points = np.array(list(itertools.product(*(grid.values for grid in grids)))).reshape(runs // draws, len(grids))
    columns = dict(zip((grid.name for grid in grids), np.repeat(points, draws, axis=0).T, strict=True))
    random = np.random.default_rng(seed)
    for one in variations:
        if isinstance(one, Random):
            columns[one.name] = _DISTRIBUTIONS[one.distribution][1](random, one.first, one.second, runs)
    return Plan(tuple(names), np.column_stack([columns[name] for name in names]) if names else np.zeros((runs, 0)))


def _require_number(name: str, mechanism: Mechanism) -> None:
    if name.startswith(EFFORT):
        known = mechanism.coordinate_names
        if name.removeprefix(EFFORT) not in known:
            remedy = nearest(name.removeprefix(EFFORT), known) or "No joint of this mechanism accepts efforts."
            raise CommandError(f"there is no joint '{name.removeprefix(EFFORT)}'", remedy)
        return
    try:
        value = value_of(mechanism, name)
    except MechanismError as error:
        problem = error.problems[0]
        raise CommandError(f"'{name}' {problem.message}", problem.remedy) from error
    if value is None:
        raise CommandError(f"'{name}' is not a number in the file", "Name a number, for example joints.elbow.damping.")


def _random(name: str, distribution: str, numbers: list[float], text: str) -> Random:
    if distribution not in _DISTRIBUTIONS:
        known = listed(list(_DISTRIBUTIONS))
        raise CommandError(f"{text}: there is no distribution '{distribution}'", f"Valid: {known}.")
    if len(numbers) != 2:
        raise CommandError(f"{text}: write {distribution}({_DISTRIBUTIONS[distribution][0]})")
    first, second = numbers
    if not np.all(np.isfinite(numbers)):
        raise CommandError(f"{text}: the numbers of a distribution must be finite")
    if distribution == "uniform" and not first <= second:
        raise CommandError(f"{text}: uniform needs low <= high")
    if distribution == "loguniform" and not 0.0 < first <= second:
        raise CommandError(f"{text}: loguniform needs 0 < low <= high")
    if distribution == "normal" and second < 0.0:
        raise CommandError(f"{text}: the deviation must not be negative")
    return Random(name, distribution, first, second)


def _plain(word: str) -> float | str:
    """A plain number as a float, so that 1e3 is not read as a name."""
    try:
        return float(word)
    except ValueError:
        return word
