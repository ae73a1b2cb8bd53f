"""The runs of a sweep: each chunk is computed as one ensemble, in this process or in another one.

Dask can execute the chunks in local processes or on a cluster. The results are a table with a row for each run.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.errors import CommandError, DivergedError, MbdSimError, MechanismError, nearest
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.interrupts import interruptible
from mbd_sim.base.packages import require_packages
from mbd_sim.base.worker_processes import ending_at_once, leave_interrupts_to_parent
from mbd_sim.files.load import parse_mechanism
from mbd_sim.many.sweep.plan import EFFORT, Statistics, column_names, coordinates, named_quantities
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.simulation.ensemble.ensemble import Ensemble
from mbd_sim.simulation.run.arguments import steps_in

CHUNK = 256  # runs

Table = dict[str, NDArray[Any]]


@dataclass(frozen=True)
class Settings:
    """The settings of all runs, which can be sent to another machine: the mechanism is the `text` of its file.

    The runs end at `until` in s. The coordinates are sampled every `every` s, for their extremes and, with
    `histories`, for the table of histories; so are `quantities`, see `mbd_sim.many.sweep.plan`.
    """

    text: str
    file: str
    until: float
    every: float
    method: str | None = None
    step: float | None = None
    histories: bool = False
    quantities: tuple[str, ...] = ()

    def mechanism(self) -> Mechanism:
        """The mechanism that is built from the text."""
        return parse_mechanism(self.text, self.file)


@dataclass(frozen=True)
class Chunk:
    """Consecutive runs: the number of the `first` one, and the changes of each."""

    first: int
    changes: Sequence[Mapping[str, float]]


@dataclass
class Results:
    """A table with one row for each run, one with a row for each run and time, and the errors of failed runs."""

    runs: Table = field(default_factory=dict)
    histories: Table = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)


def chunks(changes: Sequence[Mapping[str, float]]) -> list[Chunk]:
    """The runs in chunks of `CHUNK`, the same wherever they are computed."""
    return [Chunk(first, changes[first : first + CHUNK]) for first in range(0, len(changes), CHUNK)]


def compute(settings: Settings, chunk: Chunk, threads: int | None = 1) -> Results:
    """Compute the results of a chunk.

    Runs that cannot share one set of equations, for example because directions of axes differ, are computed one by
    one. A run that cannot be built is listed in `problems`, and its row contains nan.
    """
    mechanism = settings.mechanism()
    try:
        return _together(settings, mechanism, chunk, threads)
    except (MechanismError, CommandError, DivergedError) as error:
        if len(chunk.changes) == 1:
            return _missing(mechanism, settings.quantities, chunk, error)
    single_runs = (Chunk(chunk.first + index, [change]) for index, change in enumerate(chunk.changes))
    return joined(compute(settings, run, threads) for run in single_runs)


def joined(results: Iterable[Results]) -> Results:
    """The results of several chunks as one."""
    results = list(results)

    def concatenated(tables: Sequence[Table]) -> Table:
        return {name: np.concatenate([table[name] for table in tables]) for name in tables[0]} if tables else {}

    return Results(
        concatenated([chunk.runs for chunk in results]),
        concatenated([chunk.histories for chunk in results if chunk.histories]),
        [problem for chunk in results for problem in chunk.problems],
    )


def _together(settings: Settings, mechanism: Mechanism, chunk: Chunk, threads: int | None) -> Results:
    values = [{name: v for name, v in change.items() if not name.startswith(EFFORT)} for change in chunk.changes]
    ensemble = Ensemble(mechanism, values, method=settings.method, step=settings.step, threads=threads)
    _set_efforts(ensemble, chunk)
    steps, every = steps_in(settings.until, ensemble.step_size), max(1, round(settings.every / ensemble.step_size))
    names = ensemble.model.coordinate_names
    at = coordinates(ensemble)
    least, most, samples = at.copy(), at.copy(), [at]
    statistics = Statistics(named_quantities(mechanism, settings.quantities), ensemble)
    while ensemble.steps < steps:
        ensemble.step(min(every, steps - ensemble.steps))
        at = coordinates(ensemble)
        least, most = np.minimum(least, at), np.maximum(most, at)
        statistics.sample()
        if settings.histories:
            samples.append(at)
    table = _head(chunk)
    energies = ensemble.energies
    table |= {"finite": ensemble.alive}
    for index, name in enumerate(names):
        columns = (at[:, index], ensemble.u[:, index], least[:, index], most[:, index])
        table |= dict(zip((f"{name}.{suffix}" for suffix in _SUFFIXES), columns, strict=True))
    table |= {name: getattr(energies, name) for name in _ENERGIES} | {"error_estimate": ensemble.error_estimates}
    table |= statistics.columns()
    times = np.minimum(np.arange(len(samples)) * every, steps) * ensemble.step_size
    return Results(table, _histories(chunk, names, times, samples) if settings.histories else {})


_SUFFIXES = ("position", "velocity", "least", "most")
_ENERGIES = ("kinetic", "potential", "dissipated", "work_applied", "work_drives", "total", "residual")


def result_names(mechanism: Mechanism, quantities: Sequence[str] = ()) -> list[str]:
    """The names of the columns with the results of a run."""
    columns = [f"{name}.{suffix}" for name in mechanism.coordinate_names for suffix in _SUFFIXES]
    return [*columns, *_ENERGIES, "error_estimate", *column_names(quantities)]


def _head(chunk: Chunk) -> Table:
    """The columns with the number and the varied values of each run."""
    table: Table = {"run": chunk.first + np.arange(len(chunk.changes))}
    for name in chunk.changes[0]:
        table[name] = np.array([change[name] for change in chunk.changes])
    return table


def _missing(mechanism: Mechanism, quantities: Sequence[str], chunk: Chunk, error: MbdSimError) -> Results:
    table = _head(chunk) | {"finite": np.array([False])}
    table |= {name: np.array([np.nan]) for name in result_names(mechanism, quantities)}
    return Results(table, {}, [f"run {chunk.first}: {error}"])


def _set_efforts(ensemble: Ensemble, chunk: Chunk) -> None:
    efforts = [name for name in chunk.changes[0] if name.startswith(EFFORT)]
    if efforts:
        rows = {name.removeprefix(EFFORT): np.array([change[name] for change in chunk.changes]) for name in efforts}
        ensemble.set_efforts(rows)


def _histories(chunk: Chunk, names: Sequence[str], times: Array, samples: Sequence[Array]) -> Table:
    runs = len(chunk.changes)
    values = np.stack(samples, axis=1).reshape(runs * len(times), -1)
    table: Table = {"run": np.repeat(chunk.first + np.arange(runs), len(times)), "time": np.tile(times, runs)}
    return table | {name: values[:, index] for index, name in enumerate(names)}


Progress = Callable[[int], None]


class ScheduleError(MbdSimError):
    """Dask is not installed, or its scheduler cannot be reached."""


def sweep(settings: Settings, work: Sequence[Chunk], scheduler: str = "", progress: Progress | None = None) -> Results:
    """Compute all chunks; `progress` is called with the number of runs of each chunk that is done.

    :param scheduler: the address of a Dask scheduler, such as tcp://host:8786; if empty, local processes.
    :raises MissingPackageError: Dask is not installed.
    :raises ScheduleError: the scheduler cannot be reached.
    """
    if len(work) == 1 and not scheduler:
        results = compute(settings, work[0], threads=None)
        if progress is not None:
            progress(len(work[0].changes))
        return results
    require_packages("dask", purpose="A sweep of this size")
    import dask

    tasks = [dask.delayed(compute, pure=False)(settings, chunk) for chunk in work]
    if scheduler:
        return joined(_on_cluster(tasks, work, scheduler, progress))
    with _reported(progress), _local_workers() as pool:
        return joined(dask.compute(*tasks, scheduler="processes", pool=pool))


@contextmanager
def _local_workers() -> Iterator[ProcessPoolExecutor]:
    """A process for each processor. An interrupt or an error ends them at once, and not after their present chunks."""
    from dask import config
    from dask.multiprocessing import get_context
    from dask.system import CPU_COUNT

    count = config.get("num_workers", None) or CPU_COUNT
    with ending_at_once(
        ProcessPoolExecutor(count, mp_context=get_context(), initializer=leave_interrupts_to_parent)
    ) as pool:
        yield pool


@contextmanager
def _reported(progress: Progress | None) -> Iterator[None]:
    """Call `progress` when Dask's local scheduler has computed a chunk."""
    from dask.callbacks import Callback

    def done(key: Any, result: Any, *_: Any) -> None:
        if progress is not None and isinstance(result, Results):
            progress(len(result.runs["run"]))

    with Callback(posttask=done):
        yield


def _on_cluster(
    tasks: Sequence[Any], work: Sequence[Chunk], scheduler: str, progress: Progress | None
) -> list[Results]:
    require_packages("distributed", purpose="A Dask scheduler")
    from distributed import Client, as_completed

    try:
        client = Client(scheduler, timeout=5)
    except (OSError, ValueError) as error:
        raise ScheduleError(f"there is no Dask scheduler at {scheduler}: {error}") from error
    with client:
        futures = client.compute(list(tasks))
        sizes = {future.key: len(chunk.changes) for future, chunk in zip(futures, work, strict=True)}
        for future in as_completed(futures):
            if progress is not None:
                progress(sizes[future.key])
        return list(client.gather(futures))


def require_column(table_columns: Sequence[str], name: str) -> None:
    """Refuse a result that does not exist.

    :raises MbdSimError: with the nearest name.
    """
    if name not in table_columns:
        raise MbdSimError(f"there is no result '{name}'", nearest(name, table_columns))


@interruptible()
def draw(path: Path, table: Table, varied: Sequence[str], shown: str, title: str) -> None:
    """Plot the result `shown` into a file.

    Without varied values it is a histogram, with one a line, with two on a full grid a color map, and otherwise colored
    points over the first two.

    :raises MbdSimError: the result does not exist, or the file cannot be written.
    """
    require_column(list(table), shown)
    require_packages("matplotlib", purpose="A plot of a sweep")
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 4.6), layout="constrained")
    axes = figure.add_subplot()
    axes.set_title(title)
    if not varied:
        axes.hist(table[shown], bins=40)
        axes.set_xlabel(shown)
    elif len(varied) == 1:
        x, y = table[varied[0]], table[shown]
        order = np.argsort(x, kind="stable")
        repeated = len(np.unique(x)) < len(x)
        axes.plot(x[order], y[order], "." if repeated or len(x) > 2000 else ".-", markersize=3, linewidth=1)
        axes.set(xlabel=varied[0], ylabel=shown)
    else:
        x, y, z = (table[name] for name in (*varied[:2], shown))
        grid = _on_grid(x, y, z)
        if grid is not None:
            colored: Any = axes.pcolormesh(*grid, shading="nearest", cmap="viridis")
        else:
            colored = axes.scatter(x, y, c=z, s=6, cmap="viridis")
        axes.set(xlabel=varied[0], ylabel=varied[1])
        figure.colorbar(colored, ax=axes, label=shown)
    try:
        figure.savefig(path, dpi=150)
    except (OSError, ValueError) as error:
        raise MbdSimError(f"{path} cannot be drawn: {error}") from error


def _on_grid(x: Array, y: Array, z: Array) -> tuple[Array, Array, Array] | None:
    """The values z on the grid of x and y, or None unless each point of the grid has one value."""
    columns, rows = np.unique(x), np.unique(y)
    if len(columns) * len(rows) != len(z) or len(columns) < 2 or len(rows) < 2:
        return None
    found = np.full((len(rows), len(columns)), np.nan)
    found[np.searchsorted(rows, y), np.searchsorted(columns, x)] = z
    return columns, rows, found
