"""`mbd_sim rerun-with`: recompute a recorded run with a change, and compare the two."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path

from mbd_sim.base.errors import InputError, counted
from mbd_sim.cli.shared.command import Command
from mbd_sim.cli.shared.common import add_method_and_step, add_quiet
from mbd_sim.cli.shared.plot_options import add_plot_style, chosen_style
from mbd_sim.cli.shared.progress import ProgressBar
from mbd_sim.cli.shared.recorded_run import add_run, recorded_run
from mbd_sim.cli.shared.setup_options import add_set, changes_of
from mbd_sim.recordings.run.changed_run import ChangedRun, ChangedRunFile, compute_changed_run
from mbd_sim.recordings.run.reader import open_recording
from mbd_sim.recordings.run.recomputation import Recomputation
from mbd_sim.recordings.views.plots import (
    largest_deviations,
    plot_changed_run,
    require_plot,
)
from mbd_sim.recordings.views.table import coordinate_units

SHOWN = 8  # rows of each table


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add_run(parser, changes=False, recomputed=True)
    add_set(parser)
    add_method_and_step(parser, "as recorded")
    parser.add_argument("--plot", type=Path, metavar="PICTURE", help="plot both runs: .png, .svg, .pdf or .html")
    add_plot_style(parser)
    parser.add_argument("--out", type=Path, metavar="FILE", help="write the changed run to an .mcap file")
    add_quiet(parser)


def _execute(options: argparse.Namespace) -> int:
    """Recompute, plot and write the run, and print the largest deviations."""
    changes = changes_of(options.changes)
    if not (changes or options.method or options.step):
        raise InputError("rerun-with: no change is given", "Give --set KEY=VALUE, --method or --step.")
    chosen_style(options, options.plot)
    require_plot(options.plot)
    with recorded_run(options.recording, options, with_changes=False) as path:
        _recompute(path, options, changes)
    return 0


def _recompute(path: Path, options: argparse.Namespace, changes: dict[str, float | str]) -> None:
    files = open_recording(path).files
    file = files[0]
    recomputation = Recomputation(file, method=options.method, step=options.step, changes=changes)
    out = ChangedRunFile(options.out, recomputation) if options.out is not None else None
    with ProgressBar("rerun", options.quiet) as progress:
        try:
            run = compute_changed_run(recomputation, progress.show, out.add if out is not None else None)
        finally:
            if out is not None:
                out.close()
    change = ", ".join(_descriptions(options, changes))
    units = coordinate_units(recomputation.simulation.mechanism)
    if options.plot is not None:
        title = f"{recomputation.simulation.mechanism.name}: {Path(options.recording).name}"
        plot_changed_run(options.plot, run, title, change, units, chosen_style(options, options.plot))
    written = [path for path in (options.plot, options.out) if path is not None]
    name = options.recording if len(files) == 1 else str(file.path)
    print(_summary(run, name, file.problem, change, units, written))
    if len(files) > 1:
        print(f"  This is the first of {len(files)} files. To recompute another one, give its path.")


def _descriptions(options: argparse.Namespace, changes: dict[str, float | str]) -> list[str]:
    """Return a few words on each change."""
    found = [f"{name} = {value}" for name, value in changes.items()]
    if options.method:
        found.append(f"method {options.method}")
    if options.step:
        found.append(f"step {options.step:g} s")
    return found


def _summary(
    run: ChangedRun, name: str, problem: str, change: str, units: Mapping[str, str], written: Sequence[Path]
) -> str:
    lines = [f"{name}: with {change}"]
    if problem:
        lines.append(f"  file             {problem}")
    if run.ended:
        lines.append(f"  ENDS EARLY       {run.ended}")
    if run.left_out:
        step = run.recomputation.simulation.step_size
        lines.append(f"  not compared     {counted(run.left_out, 'state')} between two steps of {step:g} s")
    lines.append("  largest deviations")
    for series, rate in ((run.coordinates["position"], ""), (run.coordinates["velocity"], "/s"), (run.energies, "J")):
        rows = largest_deviations(series)
        for name, size, time in rows[:SHOWN]:
            unit = rate if series is run.energies else f"{units[name.rpartition(' ')[0]]}{rate}"
            lines.append(f"    {name:24s}  {f'{size:.6g} {unit}':18s}  t = {time:.6g} s")
        if len(rows) > SHOWN:
            lines.append(f"    … and {len(rows) - SHOWN} more")
    return "\n".join([*lines, *(f"  wrote {path}" for path in written)])


COMMANDS = {
    "rerun-with": Command(
        "Recompute a recorded run under the same commands, but with other values, integration method or time step, "
        "and report the deviations. If RUN is a mechanism, it is first run without these changes.",
        _add_arguments,
        _execute,
    ),
}
