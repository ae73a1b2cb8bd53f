"""`mbd_sim sweep`: run a mechanism many times with varied values."""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from mbd_sim import __version__
from mbd_sim.base.errors import counted
from mbd_sim.cli.shared.command import COUNT, Command, ProgressBar
from mbd_sim.cli.shared.common import (
    add_duration,
    add_mechanism,
    add_method_and_step,
    add_quiet,
    add_repeatable,
    positive_in,
    print_notes,
    seed_number,
    text_table,
)
from mbd_sim.files.load import load_mechanism
from mbd_sim.files.text.yaml_text import mechanism_text
from mbd_sim.many.sweep.plan import bare_variation_remark, named_quantities, plan, variation
from mbd_sim.many.sweep.runs import (
    Results,
    Settings,
    chunks,
    draw,
    require_column,
    result_names,
    sweep,
)
from mbd_sim.recordings.views.plots import PICTURE_SUFFIXES, require_plot
from mbd_sim.recordings.views.table import require_table, write_columns

SAMPLES = 1000  # of each run, from which its extremes are taken, unless --every is given
MAX_PROBLEMS = 5  # printed
MOST_ROWS, MOST_COLUMNS = 20, 6  # of the table that is printed where no file is written


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add_mechanism(parser)
    add_repeatable(
        parser,
        "--vary",
        "NAME=VALUES",
        "vary a value of the file, such as parameters.l or joints.elbow.position, or a constant effort, such as "
        "efforts.elbow; repeatable. VALUES: 0.5:2:20 (20 values from 0.5 to 2), 0.5,1,2 (these values), or a "
        "distribution to sample: uniform(0.5, 2), loguniform(0.5, 2), normal(mean, deviation)",
        required=True,
    )
    parser.add_argument("--draws", type=int, default=1, metavar="N", help="random samples per combination (default 1)")
    parser.add_argument("--seed", type=seed_number, default=0, help="seed of the random samples (default 0)")
    add_duration(parser)
    parser.add_argument(
        "--every",
        type=positive_in("s"),
        metavar="S",
        help=f"sampling interval of the results in seconds, at least one step (default: TIME / {SAMPLES})",
    )
    add_repeatable(
        parser,
        "--quantity",
        "NAME",
        "also report a quantity of each run: its last, least, most and root-mean-square values; repeatable. "
        "NAME: such as reactions.elbow.force, points.lower.tip.z, drives.crank.force, energies.kinetic, "
        "velocities.elbow, losses.friction, or events.impact for the number of impacts",
    )
    add_method_and_step(parser, "from the file")
    formats = ".csv, .parquet or .npz"
    parser.add_argument(
        "--out", type=Path, metavar="FILE", help=f"write a table of the runs: {formats} (default: print it)"
    )
    parser.add_argument(
        "--histories",
        type=Path,
        metavar="FILE",
        help="write a table of all coordinates over time",
    )
    parser.add_argument(
        "--plot",
        type=Path,
        metavar="PICTURE",
        help="plot one result against the varied values: .png, .svg or .pdf",
    )
    parser.add_argument(
        "--show",
        metavar="RESULT",
        help="result to plot, such as elbow.most or reactions.elbow.force.most (default: the first coordinate's "
        "maximum)",
    )
    parser.add_argument(
        "--scheduler",
        default="",
        metavar="ADDRESS",
        help="Dask scheduler, such as tcp://host:8786 (default: local processes)",
    )
    add_quiet(parser)


def _execute(options: argparse.Namespace) -> int:
    """Plan the runs, compute them, write and plot the results; returns 1 if any run failed."""
    for path in (options.out, options.histories):
        require_table(path)
    require_plot(options.plot, PICTURE_SUFFIXES)
    mechanism = load_mechanism(options.mechanism)
    planned = plan([variation(text, mechanism) for text in options.vary], options.draws, options.seed)
    print_notes(remark for text in options.vary if (remark := bare_variation_remark(text, mechanism)))
    settings = Settings(
        text=mechanism_text(mechanism.source),
        file=mechanism.source.file,
        until=options.time,
        every=options.every or options.time / SAMPLES,
        method=options.method,
        step=options.step,
        histories=options.histories is not None,
        quantities=tuple(dict.fromkeys(options.quantity)),
    )
    shown = options.show or f"{mechanism.coordinate_names[0]}.most"
    named_quantities(mechanism, settings.quantities)
    require_column(result_names(mechanism, settings.quantities), shown)
    work = chunks(planned.changes(0, len(planned.values)))
    began = time.perf_counter()
    with ProgressBar("runs", options.quiet, total=len(planned.values), amount=COUNT) as progress:
        results = sweep(settings, work, options.scheduler, progress.advance)
    seconds = time.perf_counter() - began
    metadata = {"mbd_sim": __version__, "mechanism.yaml": settings.text, "until": repr(settings.until)}
    for path, table in ((options.out, results.runs), (options.histories, results.histories)):
        if path is not None and table:
            write_columns(path, table, metadata)
    if options.plot is not None:
        draw(options.plot, results.runs, planned.names, shown, f"{mechanism.name} after {options.time:g} s")
    print(_summary(mechanism.name, results, seconds, [options.out, options.histories, options.plot]))
    if options.out is None and options.histories is None and options.plot is None:
        print("\n".join(_table(results, planned.names, settings.quantities)))
    return 1 if results.problems else 0


def _summary(name: str, results: Results, seconds: float, paths: list[Path | None]) -> str:
    runs = len(results.runs["run"])
    failed = runs - int(results.runs["finite"].sum())
    lines = [f"{name}: {counted(runs, 'run')} in {seconds:.3g} s ({1e3 * seconds / runs:.3g} ms per run)"]
    if failed:
        lines.append(f"  {failed} of them could not be built or diverged: see column 'finite'")
    lines += [f"  {problem}" for problem in results.problems[:MAX_PROBLEMS]]
    if len(results.problems) > MAX_PROBLEMS:
        lines.append(f"  … and {len(results.problems) - MAX_PROBLEMS} more")
    return "\n".join([*lines, *(f"  wrote {path}" for path in paths if path is not None and path.exists())])


def _table(results: Results, varied: Sequence[str], quantities: Sequence[str]) -> Iterator[str]:
    """The varied values of each run with the chosen quantities, or else with the final positions of all coordinates."""
    runs = results.runs
    chosen = [name for name in runs if any(name.startswith(f"{quantity}.") for quantity in quantities)]
    shown = chosen or [name for name in runs if name.endswith(".position") and name not in varied]
    columns = {name: runs[name].tolist() for name in ("run", *varied, *shown[:MOST_COLUMNS])}
    yield from text_table(columns, MOST_ROWS)
    more = [counted(len(runs["run"]) - MOST_ROWS, "run")] if len(runs["run"]) > MOST_ROWS else []
    if others := len(runs) - len(columns):
        more.append(counted(others, "column"))
    if more:
        yield f"{' and '.join(more)} more: --out FILE.csv writes all"


COMMANDS = {
    "sweep": Command(
        "Run a mechanism many times with varied values: every combination of the given values, random samples, or "
        "both.",
        _add_arguments,
        _execute,
    ),
}
