"""`mbd_sim sweep`: a mechanism run many times with other values."""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mbd_sim import __version__
from mbd_sim.load import load_mechanism
from mbd_sim.sweep.execution import Progress, sweep
from mbd_sim.sweep.result_tables import require_kind, write
from mbd_sim.sweep.sweep_picture import draw, require_column
from mbd_sim.sweep.sweep_plan import plan, variation
from mbd_sim.sweep.sweep_runs import (
    Results,
    Settings,
    chunks,
    result_names,
)

FRAMES = 1000  # looks at the extremes of a run, if not told otherwise
MOST_SHOWN = 5  # problems


def run_sweep(options: argparse.Namespace) -> int:
    """Plan, compute, write and draw; returns the exit code."""
    for path in (options.out, options.histories):
        if path is not None:
            require_kind(path)
    mechanism = load_mechanism(options.mechanism)
    planned = plan([variation(text, mechanism) for text in options.vary], options.draws, options.seed)
    settings = Settings(
        text=mechanism.source.text,
        file=mechanism.source.file,
        until=options.time,
        every=options.every or options.time / FRAMES,
        method=options.method,
        step=options.step,
        histories=options.histories is not None,
    )
    shown = options.show or f"{mechanism.coordinate_names[0]}.most"
    require_column(result_names(mechanism), shown)
    work = chunks(planned.changes(0, len(planned.values)))
    began = time.perf_counter()
    with _bar(len(planned.values), options.quiet) as progress:
        results = sweep(settings, work, options.scheduler, progress)
    took = time.perf_counter() - began
    metadata = {"mbd_sim": __version__, "mechanism.yaml": settings.text, "until": repr(settings.until)}
    for path, table in ((options.out, results.runs), (options.histories, results.histories)):
        if path is not None and table:
            write(path, table, metadata)
    if options.plot is not None:
        draw(options.plot, results.runs, planned.names, shown, f"{mechanism.name} after {options.time:g} s")
    print(_summary(mechanism.name, results, took, [options.out, options.histories, options.plot]))
    return 1 if results.problems else 0


@contextmanager
def _bar(total: int, quiet: bool) -> Iterator[Progress]:
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("runs"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, disable=quiet, transient=True) as progress:
        task = progress.add_task("runs", total=total)
        yield lambda done: progress.advance(task, done)


def _summary(name: str, results: Results, took: float, paths: list[Path | None]) -> str:
    runs = len(results.runs["run"])
    lost = runs - int(results.runs["finite"].sum())
    lines = [f"{name}: {runs} runs in {took:.3g} s ({1e3 * took / runs:.3g} ms a run)"]
    if lost:
        lines.append(f"  {lost} of them could not be built or became infinite: column 'finite'")
    lines += [f"  {problem}" for problem in results.problems[:MOST_SHOWN]]
    if len(results.problems) > MOST_SHOWN:
        lines.append(f"  … and {len(results.problems) - MOST_SHOWN} more")
    return "\n".join([*lines, *(f"  wrote {path}" for path in paths if path is not None and path.exists())])
