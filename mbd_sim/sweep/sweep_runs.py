"""The runs of a sweep: a chunk of them as one ensemble, in this process or in any other."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbd_sim.errors import MechanismError
from mbd_sim.geometry.pose import Array
from mbd_sim.load import parse_mechanism
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.simulation.ensemble import Ensemble
from mbd_sim.sweep.sweep_plan import EFFORT

CHUNK = 256  # runs that are computed together

Table = dict[str, NDArray[Any]]


@dataclass(frozen=True)
class Settings:
    """How each run is computed. It can be sent to another machine: the mechanism is its file's `text`.

    `every` s the extremes are looked at and, with `histories`, the coordinates are kept.
    """

    text: str
    file: str
    until: float
    every: float
    method: str | None = None
    step: float | None = None
    histories: bool = False

    def mechanism(self) -> Mechanism:
        """The mechanism of the file."""
        return parse_mechanism(self.text, self.file)


@dataclass(frozen=True)
class Chunk:
    """Some runs in a row: the `first` of them, and what differs in each."""

    first: int
    changes: Sequence[Mapping[str, float]]


@dataclass
class Results:
    """Tables with a row a run, and with a row a run and time; `problems` are runs that could not be built."""

    runs: Table = field(default_factory=dict)
    histories: Table = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)


def chunks(changes: Sequence[Mapping[str, float]]) -> list[Chunk]:
    """The runs in chunks, the same ones wherever they are computed."""
    return [Chunk(first, changes[first : first + CHUNK]) for first in range(0, len(changes), CHUNK)]


def compute(settings: Settings, chunk: Chunk, threads: int | None = 1) -> Results:
    """The results of a chunk.

    Runs that cannot share one set of equations, as with other directions of axes, are computed one by one; one that
    cannot be built at all is a problem, and its row holds nan.
    """
    mechanism = settings.mechanism()
    try:
        return _together(settings, mechanism, chunk, threads)
    except MechanismError as error:
        if len(chunk.changes) == 1:
            return _missing(mechanism, chunk, error)
    ones = (Chunk(chunk.first + place, [change]) for place, change in enumerate(chunk.changes))
    return gathered(compute(settings, one, threads) for one in ones)


def gathered(parts: Iterator[Results] | Sequence[Results]) -> Results:
    """The tables of some chunks, one after the other."""
    parts = list(parts)

    def joined(tables: Sequence[Table]) -> Table:
        return {name: np.concatenate([table[name] for table in tables]) for name in tables[0]} if tables else {}

    return Results(
        joined([part.runs for part in parts]),
        joined([part.histories for part in parts if part.histories]),
        [problem for part in parts for problem in part.problems],
    )


def _together(settings: Settings, mechanism: Mechanism, chunk: Chunk, threads: int | None) -> Results:
    values = [{name: v for name, v in change.items() if not name.startswith(EFFORT)} for change in chunk.changes]
    ensemble = Ensemble(mechanism, values, method=settings.method, step=settings.step, threads=threads)
    _set_efforts(ensemble, chunk)
    steps, every = round(settings.until / ensemble.step_size), max(1, round(settings.every / ensemble.step_size))
    names = ensemble.model.coordinate_names
    at = _coordinates(ensemble)
    least, most, kept = at.copy(), at.copy(), [at]
    while ensemble.steps < steps:
        ensemble.step(min(every, steps - ensemble.steps))
        at = _coordinates(ensemble)
        least, most = np.minimum(least, at), np.maximum(most, at)
        if settings.histories:
            kept.append(at)
    table = _head(chunk)
    energies = ensemble.energies
    table |= {"finite": ensemble.alive}
    for place, name in enumerate(names):
        columns = (at[:, place], ensemble.u[:, place], least[:, place], most[:, place])
        table |= dict(zip((f"{name}.{what}" for what in _WHAT), columns, strict=True))
    table |= {name: getattr(energies, name) for name in _ENERGIES} | {"error_estimate": ensemble.error_estimates}
    times = np.minimum(np.arange(len(kept)) * every, steps) * ensemble.step_size
    return Results(table, _histories(chunk, names, times, kept) if settings.histories else {})


_WHAT = ("position", "velocity", "least", "most")
_ENERGIES = ("kinetic", "potential", "dissipated", "work_applied", "work_drives", "total", "residual")


def result_names(mechanism: Mechanism) -> list[str]:
    """The columns of numbers that a run results in."""
    columns = [f"{name}.{what}" for name in mechanism.coordinate_names for what in _WHAT]
    return [*columns, *_ENERGIES, "error_estimate"]


def _head(chunk: Chunk) -> Table:
    table: Table = {"run": chunk.first + np.arange(len(chunk.changes))}
    for name in chunk.changes[0]:
        table[name] = np.array([change[name] for change in chunk.changes])
    return table


def _missing(mechanism: Mechanism, chunk: Chunk, error: MechanismError) -> Results:
    table = _head(chunk) | {"finite": np.array([False])}
    table |= {name: np.array([np.nan]) for name in result_names(mechanism)}
    return Results(table, {}, [f"run {chunk.first}: {error}"])


def _set_efforts(ensemble: Ensemble, chunk: Chunk) -> None:
    efforts = [name for name in chunk.changes[0] if name.startswith(EFFORT)]
    if efforts:
        rows = {name.removeprefix(EFFORT): np.array([change[name] for change in chunk.changes]) for name in efforts}
        ensemble.set_efforts(rows)


def _coordinates(ensemble: Ensemble) -> Array:
    """(runs, nv): see `Model.coordinates`."""
    if not ensemble.model.quaternions:
        return ensemble.q
    return np.array([ensemble.model.coordinates(y) for y in ensemble.state])


def _histories(chunk: Chunk, names: Sequence[str], times: Array, kept: Sequence[Array]) -> Table:
    runs = len(chunk.changes)
    values = np.stack(kept, axis=1).reshape(runs * len(times), -1)
    table: Table = {"run": np.repeat(chunk.first + np.arange(runs), len(times)), "time": np.tile(times, runs)}
    return table | {name: values[:, place] for place, name in enumerate(names)}
