"""`mbd_sim view`, `plot` and `export`."""

from __future__ import annotations

import argparse
import importlib.util
import threading
from pathlib import Path

from mbd_sim.cli.verify import bar
from mbd_sim.errors import MechanismError
from mbd_sim.playback import run_pictures, table_export
from mbd_sim.playback.panels import panels
from mbd_sim.playback.run_table import RunTable, read_table
from mbd_sim.recording.reader import Recording, open_recording
from mbd_sim.recording.recomputation import Recomputation, RecomputeError, is_run
from mbd_sim.viewer.sinks import ViewerError, checked_sink


def run_view(options: argparse.Namespace) -> int:
    """Show; returns the exit code."""
    from mbd_sim.playback.recording_view import show, show_table
    from mbd_sim.viewer.scene_description import Look

    sink = checked_sink(options.save or options.rerun)
    if importlib.util.find_spec("rerun") is None:
        raise ViewerError("Rerun is not installed. Install it with: pip install rerun-sdk")
    recording = open_recording(options.recording)
    hold = _wait if sink == "serve" else _go_on
    replica, why = _replica(recording)
    if replica is None:
        with bar("read", options.quiet) as progress:
            table = read_table(recording, progress)
        address = show_table(table, sink, hold)
        _say(table.notes)
        print(f"{options.recording}: {why}, so that only its joints are shown, as plots")
        print(f"  {len(table)} states, {len(table.names)} joints: {address}")
    else:
        look = Look(None if options.trace is None else tuple(options.trace), options.trace_time, options.reactions)
        with bar("show", options.quiet) as progress:
            address, count, notes = show(recording, replica, sink, options.rate, look, progress, hold)
        _say(notes)
        print(f"{options.recording}: {count} states: {address}")
    return 0


def _replica(recording: Recording) -> tuple[Recomputation | None, str]:
    """The simulation of a run of ours, or why there is none."""
    first = next((part for part in recording.parts if is_run(part)), None)
    if first is None or first.mechanism_text is None:
        return None, "holds no mechanism"
    try:
        return Recomputation(first), ""
    except (MechanismError, RecomputeError) as error:
        return None, f"its mechanism cannot be built ({error})"


def run_plot(options: argparse.Namespace) -> int:
    """Draw; returns the exit code."""
    table_export.require_kind(options.out, run_pictures.KINDS)
    table = _table(options.recording, options.quiet)
    shown = panels(table, [word.strip() for word in options.show.split(",") if word.strip()])
    run_pictures.draw(options.out, table, shown)
    print(f"wrote {options.out}: {', '.join(dict.fromkeys(panel.title.lower() for panel in shown))}")
    return 0


def run_export(options: argparse.Namespace) -> int:
    """Write the table; returns the exit code."""
    table_export.require_kind(options.out, table_export.KINDS)
    table = _table(options.recording, options.quiet)
    count = table_export.export(options.out, table)
    print(f"wrote {options.out}: {len(table)} rows of {count} columns")
    return 0


def _table(path: Path, quiet: bool) -> RunTable:
    recording = open_recording(path)
    with bar("read", quiet) as progress:
        table = read_table(recording, progress)
    _say(table.notes)
    return table


def _say(notes: list[str] | tuple[str, ...]) -> None:
    for note in notes:
        print(f"note: {note}")


def _go_on(address: str) -> None:
    """A window or a file needs nobody."""


def _wait(address: str) -> None:
    """Serve until Ctrl-C."""
    print(f"{address}\nCtrl-C ends the server", flush=True)
    threading.Event().wait()
