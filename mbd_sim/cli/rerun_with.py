"""`mbd_sim rerun-with`: a recorded run with a change, beside the recorded one."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from mbd_sim.cli.common import (
    MCAP_OR_BAG,
    ProgressBar,
    add_method_and_step,
    add_quiet,
    add_recording,
    split_assignment,
)
from mbd_sim.errors import MbdSimError

if TYPE_CHECKING:
    from mbd_sim.recording.changed_run import WhatIf
    from mbd_sim.recording.contents import Part

HELP = "recompute a recorded run with changed values, and compare the two"
DESCRIPTION = (
    "Recompute a recorded run under the same commands, but with other values, integration method or time step, and "
    "report the deviations."
)

SHOWN = 8  # rows of each table


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_recording(parser, MCAP_OR_BAG)
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        dest="changes",
        help="change a value of the mechanism file, such as joints.elbow.damping=0.2 or l='80 cm'; repeatable",
    )
    add_method_and_step(parser, "as recorded")
    parser.add_argument("--plot", type=Path, metavar="PICTURE", help="plot both runs: .png, .svg, .pdf or .html")
    parser.add_argument("--out", type=Path, metavar="FILE", help="write the changed run to an .mcap file")
    add_quiet(parser)


def execute(options: argparse.Namespace) -> int:
    """Recompute, plot and write the run, and print the largest deviations."""
    from mbd_sim.recording.changed_run import what_if
    from mbd_sim.recording.changed_run_file import ChangedFile
    from mbd_sim.recording.changed_run_picture import draw
    from mbd_sim.recording.reader import open_recording
    from mbd_sim.recording.recomputation import Recomputation

    changes = dict(_change(text) for text in options.changes)
    if not (changes or options.method or options.step):
        raise MbdSimError("rerun-with: nothing is changed. Give --set KEY=VALUE, --method or --step.")
    parts = open_recording(options.recording).parts
    part = parts[0]
    recomputation = Recomputation(part, method=options.method, step=options.step, changes=changes)
    out = ChangedFile(options.out, recomputation) if options.out is not None else None
    with ProgressBar("rerun", options.quiet) as progress:
        try:
            found = what_if(recomputation, progress.show, out.take if out is not None else None)
        finally:
            if out is not None:
                out.close()
    change = ", ".join(_told(options, changes))
    if options.plot is not None:
        draw(options.plot, found, f"{recomputation.simulation.mechanism.name}: {part.path.name}", change)
    written = [path for path in (options.plot, options.out) if path is not None]
    print(_summary(found, part, change, written))
    if len(parts) > 1:
        print(f"  the first of {len(parts)} files; give the others by name")
    return 0


def _change(text: str) -> tuple[str, float | str]:
    assignment = split_assignment(text)
    if assignment is None:
        raise MbdSimError(f"--set {text}: write KEY=VALUE, for example joints.elbow.damping=0.2")
    name, value = assignment
    try:
        return name, float(value)
    except ValueError:
        return name, value


def _told(options: argparse.Namespace, changes: dict[str, float | str]) -> list[str]:
    told = [f"{name} = {value}" for name, value in changes.items()]
    if options.method:
        told.append(f"method {options.method}")
    if options.step:
        told.append(f"step {options.step:g} s")
    return told


def _summary(found: WhatIf, part: Part, change: str, written: Sequence[Path]) -> str:
    from mbd_sim.recording.changed_run_picture import largest

    lines = [f"{part.path}: with {change}"]
    if part.problem:
        lines.append(f"  file             {part.problem}")
    if found.ended:
        lines.append(f"  ENDS EARLY       {found.ended}")
    lines.append("  largest deviation             of             at")
    for series in (*(found.coordinates[quantity] for quantity in ("position", "velocity")), found.energies):
        rows = largest(series)
        lines += [f"    {name:24s}  {size:<13.6g}  t = {time:.6g} s" for name, size, time in rows[:SHOWN]]
        if len(rows) > SHOWN:
            lines.append(f"    … and {len(rows) - SHOWN} more")
    return "\n".join([*lines, *(f"  wrote {path}" for path in written)])
