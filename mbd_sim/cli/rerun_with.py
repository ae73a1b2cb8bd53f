"""`mbd_sim rerun-with`: a recorded run with a change, beside the recorded one."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from mbd_sim.cli.verify import bar
from mbd_sim.errors import MbdSimError
from mbd_sim.recording.changed_run import WhatIf, what_if
from mbd_sim.recording.changed_run_file import ChangedFile
from mbd_sim.recording.changed_run_picture import draw, largest
from mbd_sim.recording.contents import Part
from mbd_sim.recording.reader import open_recording
from mbd_sim.recording.recomputation import Recomputation

SHOWN = 8  # rows of each table


def run_what_if(options: argparse.Namespace) -> int:
    """Compute, draw and write; returns the exit code."""
    changes = dict(_assignment(text) for text in options.changes)
    if not (changes or options.method or options.step):
        raise MbdSimError("rerun-with: nothing is changed. Give --set KEY=VALUE, --method or --step.")
    parts = open_recording(options.recording).parts
    part: Part = parts[0]
    replica = Recomputation(part, method=options.method, step=options.step, changes=changes)
    out = ChangedFile(options.out, replica) if options.out is not None else None
    with bar("rerun", options.quiet) as progress:
        try:
            found = what_if(replica, progress, out.take if out is not None else None)
        finally:
            if out is not None:
                out.close()
    change = ", ".join(_told(options, changes))
    if options.plot is not None:
        draw(options.plot, found, f"{replica.simulation.mechanism.name}: {part.path.name}", change)
    written = [path for path in (options.plot, options.out) if path is not None]
    print(_summary(found, part, change, written))
    if len(parts) > 1:
        print(f"  the first of {len(parts)} files; give the others by name")
    return 0


def _assignment(text: str) -> tuple[str, float | str]:
    name, equals, value = text.partition("=")
    if not (name and equals and value):
        raise MbdSimError(f"--set {text}: write KEY=VALUE, for example joints.elbow.damping=0.2")
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
