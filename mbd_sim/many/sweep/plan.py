"""The plan of a sweep: the varied values, and the quantities that are computed of each run.

Values are on a grid, or drawn at random. Quantities are chosen by name, and computed for all runs at once from their
states at one time. Their last, least, most and root-mean-square values are taken over the samples of the runs.
"""

from __future__ import annotations

import itertools
import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from operator import attrgetter

import numpy as np

from mbd_sim.base.errors import CommandError, InputError, MbdSimError, MechanismError, listed, nearest
from mbd_sim.base.geometry.pose import Array
from mbd_sim.files.checks.bare_angles import bare_argument_remark, is_angle
from mbd_sim.files.checks.override import location_of, number_at, value_of
from mbd_sim.files.text.units import parse_value
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.values.names import split_assignment
from mbd_sim.simulation.contact.records import ContactChange, ContactEvent
from mbd_sim.simulation.ensemble.ensemble import Ensemble
from mbd_sim.simulation.model.state_records import EnsembleDrive, EnsembleEnergies, EnsembleMotion, Losses, Reaction

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
            raise CommandError(f"{text}: '{word.strip()}': {error.message}", error.remedy) from error

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
        raise CommandError(f"{name}: {problem.message}", problem.remedy) from error
    if value is None:
        raise CommandError(f"'{name}' is not a number in the file", "Name a number, for example joints.elbow.damping.")


def _random(name: str, distribution: str, numbers: list[float], text: str) -> Random:
    if distribution not in _DISTRIBUTIONS:
        known = listed(list(_DISTRIBUTIONS))
        raise CommandError(f"{text}: there is no distribution '{distribution}'", f"Valid: {known}.")
    if len(numbers) != 2:
        raise CommandError(
            f"{text}: a distribution has two numbers", f"Write {distribution}({_DISTRIBUTIONS[distribution][0]})."
        )
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


AXES = ("x", "y", "z")
EVENTS = "events."


class EventCounts:
    """Counts the events at the contacts of one run."""

    def __init__(self) -> None:
        self.of: Counter[ContactChange] = Counter()

    def impact(self, time: float, before: float, after: float) -> None:
        """Nothing: the impulses of an impact come as events."""

    def event(self, event: ContactEvent) -> None:
        """Count an event."""
        self.of[event.change] += 1


class Sample:
    """The states of all runs at one time; what several quantities need is computed once."""

    def __init__(self, ensemble: Ensemble, counts: Sequence[EventCounts]) -> None:
        self._ensemble, self._counts = ensemble, counts
        self._motions: dict[str, EnsembleMotion] = {}

    @cached_property
    def positions(self) -> Array:
        """The coordinates (runs, nv): see `Model.coordinates`."""
        return coordinates(self._ensemble)

    @cached_property
    def velocities(self) -> Array:
        """The generalized speeds (runs, nv)."""
        return np.asarray(self._ensemble.u)

    @cached_property
    def energies(self) -> EnsembleEnergies:
        """The energy audit."""
        return self._ensemble.energies

    @cached_property
    def losses(self) -> Losses:
        """The energies that impacts and dry friction have dissipated."""
        return self._ensemble.losses

    @cached_property
    def drives(self) -> Mapping[str, EnsembleDrive]:
        """The driven coordinates."""
        return self._ensemble.drives()

    @cached_property
    def reactions(self) -> Mapping[str, Reaction]:
        """The loads of the joints."""
        return self._ensemble.reactions()

    def motion(self, frame: str) -> EnsembleMotion:
        """The motion of a part or of one of its points."""
        if frame not in self._motions:
            self._motions[frame] = self._ensemble.motion(frame)
        return self._motions[frame]

    def events(self, change: ContactChange) -> Array:
        """The number (runs,) of events of a kind so far."""
        return np.array([float(counts.of[change]) for counts in self._counts])


Quantity = Callable[[Sample], Array]


def coordinates(ensemble: Ensemble) -> Array:
    """The coordinates (members, nv): see `Model.coordinates`."""
    if not ensemble.model.quaternions:
        return np.asarray(ensemble.q)
    return np.array([ensemble.model.coordinates(y) for y in ensemble.state])


def quantities(mechanism: Mechanism) -> dict[str, Quantity]:
    """Every quantity of a mechanism that a sweep can sample, by its name; in SI units, vectors in ground's axes."""
    found: dict[str, Quantity] = {}
    for index, name in enumerate(mechanism.coordinate_names):
        found[f"positions.{name}"] = partial(_coordinate, index)
        found[f"velocities.{name}"] = partial(_speed, index)
    for record in (("energies", EnsembleEnergies), ("losses", Losses)):
        found |= {f"{record[0]}.{entry}": attrgetter(f"{record[0]}.{entry}") for entry in record[1]._fields}
    for name in mechanism.driven_names:
        found |= {f"drives.{name}.{entry}": partial(_drive, name, entry) for entry in EnsembleDrive._fields}
    for joint in (*mechanism.joints, *mechanism.closing):
        for vector in Reaction._fields:
            found[f"reactions.{joint}.{vector}"] = partial(_reaction, joint, vector, None)
            for axis, letter in enumerate(AXES):
                found[f"reactions.{joint}.{vector}.{letter}"] = partial(_reaction, joint, vector, axis)
    for part, body in mechanism.parts.items():
        for frame in (part, *(f"{part}.{point}" for point in body.points)):
            found |= {f"points.{frame}.{letter}": partial(_place, frame, axis) for axis, letter in enumerate(AXES)}
            found[f"points.{frame}.speed"] = partial(_size, frame, "velocity")
            found[f"points.{frame}.acceleration"] = partial(_size, frame, "acceleration")
    return found | {f"{EVENTS}{change.name.lower()}": partial(_events, change) for change in ContactChange}


def named_quantities(mechanism: Mechanism, names: Sequence[str]) -> dict[str, Quantity]:
    """The quantities of these names.

    :raises MbdSimError: there is no such quantity; the nearest name is suggested.
    """
    known = quantities(mechanism)
    for name in names:
        if name not in known:
            raise MbdSimError(
                f"there is no quantity '{name}'",
                f"{nearest(name, known)} Quantities are positions.…, velocities.…, "
                "energies.…, losses.…, drives.…, reactions.…, points.… and events.….",
            )
    return {name: known[name] for name in names}


def _coordinate(index: int, sample: Sample) -> Array:
    return sample.positions[:, index]


def _speed(index: int, sample: Sample) -> Array:
    return sample.velocities[:, index]


def _drive(name: str, entry: str, sample: Sample) -> Array:
    values: Array = getattr(sample.drives[name], entry)
    return values


def _reaction(joint: str, vector: str, axis: int | None, sample: Sample) -> Array:
    """A component of the load of a joint, or its absolute value."""
    values: Array = getattr(sample.reactions[joint], vector)
    return _lengths(values) if axis is None else values[:, axis]


def _place(frame: str, axis: int, sample: Sample) -> Array:
    return sample.motion(frame).position[:, axis]


def _size(frame: str, vector: str, sample: Sample) -> Array:
    values: Array = getattr(sample.motion(frame), vector)
    return _lengths(values)


def _lengths(vectors: Array) -> Array:
    return np.asarray(np.linalg.norm(vectors, axis=1))


def _events(change: ContactChange, sample: Sample) -> Array:
    return sample.events(change)


STATISTICS = ("final", "least", "most", "rms")


class Statistics:
    """Statistics of named quantities of an ensemble; of events only their numbers.

    The samples have equal distances in time, and count equally in the root mean square.
    """

    def __init__(self, quantities: Mapping[str, Quantity], ensemble: Ensemble) -> None:
        """Take the first sample; events are counted from here on."""
        self._quantities, self._ensemble = quantities, ensemble
        self._counts = [EventCounts() for _ in range(len(ensemble))]
        if any(name.startswith(EVENTS) for name in quantities):
            ensemble.observe_contacts(self._counts)
        self._last = self._sampled()
        self._least, self._most, self._squares, self._samples = self._last, self._last, self._last**2, 1

    def sample(self) -> None:
        """Take a sample of the present states."""
        self._last = self._sampled()
        self._least, self._most = np.minimum(self._least, self._last), np.maximum(self._most, self._last)
        self._squares, self._samples = self._squares + self._last**2, self._samples + 1

    def columns(self) -> dict[str, Array]:
        """A column (runs,) for each of `column_names`."""
        statistics = (self._last, self._least, self._most, np.sqrt(self._squares / self._samples))
        found: dict[str, Array] = {}
        for row, name in enumerate(self._quantities):
            columns = [values[row] for values in statistics]
            found |= dict(zip(column_names([name]), columns, strict=False))
        return found

    def _sampled(self) -> Array:
        """(quantities, runs)."""
        sample = Sample(self._ensemble, self._counts)
        values = [quantity(sample) for quantity in self._quantities.values()]
        return np.array(values).reshape(len(values), len(self._ensemble))


def column_names(quantities: Iterable[str]) -> list[str]:
    """The names of the columns of quantities: one for the number of events, otherwise one for each statistic."""
    return [
        column
        for name in quantities
        for column in ([name] if name.startswith(EVENTS) else [f"{name}.{statistic}" for statistic in STATISTICS])
    ]
