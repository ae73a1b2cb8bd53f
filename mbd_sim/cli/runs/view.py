"""`mbd_sim view`: a recorded run in Rerun."""

from __future__ import annotations

import argparse
import threading
from pathlib import Path

from mbd_sim.base.errors import MechanismError, counted
from mbd_sim.base.packages import require_packages
from mbd_sim.cli.shared.command import Command
from mbd_sim.cli.shared.common import add_quiet, positive_in, print_notes
from mbd_sim.cli.shared.progress import ProgressBar
from mbd_sim.cli.shared.recorded_run import add_run, recorded_run
from mbd_sim.recordings.run.reader import Recording, open_recording
from mbd_sim.recordings.run.recomputation import Recomputation, RecomputeError
from mbd_sim.recordings.views.table import read_table

RATE = 200.0  # states per second shown by default


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add_run(parser)
    parser.add_argument("--save", metavar="FILE.rrd", help="write a file instead of opening a window")
    parser.add_argument(
        "--rerun", metavar="SINK", default="spawn", help="spawn (default), serve, connect, or a file.rrd"
    )
    parser.add_argument(
        "--rate",
        type=positive_in("Hz"),
        default=RATE,
        metavar="HZ",
        help=f"states per simulated second (default {RATE:g})",
    )
    parser.add_argument(
        "--trace",
        action="append",
        metavar="POINT",
        help="draw the path of a part or part.point; repeatable (default: the ends of chains)",
    )
    parser.add_argument(
        "--trace-time",
        type=positive_in("s"),
        default=1.0,
        metavar="S",
        help="length of the paths in seconds (default 1)",
    )
    parser.add_argument("--reactions", action="store_true", help="draw the joint reactions as arrows")
    add_quiet(parser)


def _execute(options: argparse.Namespace) -> int:
    """Show the run; with `--rerun serve`, until Ctrl-C."""
    from mbd_sim.pictures.rerun.sinks import checked_sink

    sink = checked_sink(options.save or options.rerun)
    require_packages("rerun", purpose="The viewer")
    with recorded_run(options.recording, options, rate=options.rate) as path:
        _show(path, sink, options)
    return 0


def _show(path: Path, sink: str, options: argparse.Namespace) -> None:
    from mbd_sim.pictures.rerun.scene import DisplayOptions
    from mbd_sim.recordings.views.scene import show_joint_plots, show_run

    recording = open_recording(path)
    on_sent = _serve_until_interrupted if sink == "serve" else _return_at_once
    recomputation, reason = _recomputation(recording)
    if recomputation is None:
        with ProgressBar("read", options.quiet) as progress:
            table = read_table(recording, progress.show)
        address = show_joint_plots(table, sink, on_sent)
        print_notes(table.notes)
        print(f"{options.recording}: {reason}, so only its joints are shown, as plots")
        print(f"  {counted(len(table), 'state')}, {counted(len(table.names), 'joint')}: {address}")
    else:
        display = DisplayOptions(
            None if options.trace is None else tuple(options.trace), options.trace_time, options.reactions
        )
        with ProgressBar("show", options.quiet) as progress:
            address, count, notes = show_run(
                recording, recomputation, sink, options.rate, display, progress.show, on_sent
            )
        print_notes(notes)
        print(f"{options.recording}: {counted(count, 'state')}: {address}")


def _recomputation(recording: Recording) -> tuple[Recomputation | None, str]:
    """The simulation of a recorded run, or the reason why there is none."""
    first = next((file for file in recording.files if file.is_run), None)
    if first is None or first.mechanism_text is None:
        return None, "it contains no mechanism"
    try:
        return Recomputation(first), ""
    except (MechanismError, RecomputeError) as error:
        return None, f"its mechanism cannot be built ({error})"


def _return_at_once(address: str) -> None:
    """A window or a file needs no server."""


def _serve_until_interrupted(address: str) -> None:
    print(f"{address}\nPress Ctrl-C to stop the server.", flush=True)
    threading.Event().wait()


COMMANDS = {
    "view": Command(
        "Show a recorded run, or the run of a mechanism, in Rerun: the moving mechanism with plots and events. If a"
        " recording contains no mechanism, only the joints are plotted.",
        _add_arguments,
        _execute,
    ),
}
