"""`mbd_sim view`, `plot`, `export` and `lab`: runs in Rerun, as pictures and tables, and a mechanism in the browser."""

from __future__ import annotations

import argparse
import json
import threading
from pathlib import Path
from typing import TYPE_CHECKING

from mbd_sim.base.errors import CommandError, MechanismError, NoInertiaError, counted
from mbd_sim.base.packages import require_packages
from mbd_sim.cli.shared.command import Command, ProgressBar
from mbd_sim.cli.shared.common import (
    add_coordinates,
    add_mechanism,
    add_plot_style,
    add_quiet,
    add_show,
    chosen_style,
    plotted_coordinates,
    positive_in,
    print_notes,
    shown_plots,
    text_table,
)
from mbd_sim.cli.shared.page_options import add_page, require_page, serve_page
from mbd_sim.cli.shared.recorded_run import add_run, read_run_table, recorded_run
from mbd_sim.cli.shared.setup_options import add_robot, add_set, changed_mechanism
from mbd_sim.recordings.run.reader import Recording, open_recording
from mbd_sim.recordings.run.recomputation import Recomputation, RecomputeError
from mbd_sim.recordings.views import plots
from mbd_sim.recordings.views.panels import panels, require_names
from mbd_sim.recordings.views.resampling import interpolation_table, resampled
from mbd_sim.recordings.views.table import export, read_table, require_table, write_columns

if TYPE_CHECKING:
    from mbd_sim.pictures.rerun.scene import SceneDescription
    from mbd_sim.recordings.views.scene import AddressCallback, OpenStream

RATE = 200.0  # states per second shown by default


def _add_view(parser: argparse.ArgumentParser) -> None:
    add_run(parser)
    parser.add_argument("--save", metavar="FILE.rrd", help="write a file instead of opening a window")
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--rerun", metavar="SINK", default="spawn", help="spawn (default), serve, connect, or a file.rrd"
    )
    where.add_argument("--foxglove", metavar="PORT", help="play it to Foxglove, by a server on a port such as 8765")
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


def _view(options: argparse.Namespace) -> int:
    """Show the run; with `--rerun serve` and `--foxglove`, until Ctrl-C."""
    from mbd_sim.pictures.foxglove.viewer import checked_port
    from mbd_sim.pictures.rerun.sinks import checked_sink

    if options.foxglove is not None:
        if options.save:
            raise CommandError("--save writes a file of Rerun", "Leave it out, or leave out --foxglove.")
        sink = checked_port(options.foxglove)
        require_packages("foxglove", purpose="The viewer")
    else:
        sink = checked_sink(options.save or options.rerun)
        require_packages("rerun", purpose="The viewer")
    with recorded_run(options.recording, options, rate=options.rate) as path:
        _show(path, sink, options)
    return 0


def _show(path: Path, sink: str, options: argparse.Namespace) -> None:
    from mbd_sim.pictures.rerun.scene import DisplayOptions
    from mbd_sim.recordings.views.scene import rerun_stream, show_run

    recording = open_recording(path)
    recomputation, reason = _recomputation(recording)
    if recomputation is None:
        _show_joints(recording, reason, sink, options)
        return
    display = DisplayOptions(
        None if options.trace is None else tuple(options.trace), options.trace_time, options.reactions
    )
    open_stream: OpenStream
    on_sent: AddressCallback
    if options.foxglove is None:
        open_stream, on_sent = rerun_stream(sink), _serve_until_interrupted if sink == "serve" else _return_at_once
    else:
        open_stream, on_sent = _foxglove_player(int(sink))
    with ProgressBar("show", options.quiet) as progress:
        address, count, notes = show_run(
            recording, recomputation, open_stream, options.rate, display, progress.show, on_sent
        )
    print_notes(notes)
    print(f"{options.recording}: {counted(count, 'state')}: {address}")


def _show_joints(recording: Recording, reason: str, sink: str, options: argparse.Namespace) -> None:
    """Show the joints of a recording without a mechanism."""
    from mbd_sim.recordings.views.scene import show_joint_plots

    if options.foxglove is not None:
        raise CommandError(
            f"{options.recording}: {reason}, so there is nothing to play", "Open the recording itself in Foxglove."
        )
    with ProgressBar("read", options.quiet) as progress:
        table = read_table(recording, progress.show)
    address = show_joint_plots(table, sink, _serve_until_interrupted if sink == "serve" else _return_at_once)
    print_notes(table.notes)
    print(f"{options.recording}: {reason}, so only its joints are shown, as plots")
    print(f"  {counted(len(table), 'state')}, {counted(len(table.names), 'joint')}: {address}")


def _foxglove_player(port: int) -> tuple[OpenStream, AddressCallback]:
    """What opens the player of a run, and what plays it until Ctrl-C."""
    from mbd_sim.pictures.foxglove.playback import Playback

    opened: list[Playback] = []

    def open_stream(scene: SceneDescription) -> Playback:
        opened.append(Playback(scene, port))
        return opened[0]

    def play(_: str) -> None:
        print(f"{opened[0].address}\nOpen this connection in Foxglove. Press Ctrl-C to stop the server.", flush=True)
        opened[0].play(threading.Event())

    return open_stream, play


def _recomputation(recording: Recording) -> tuple[Recomputation | None, str]:
    """The simulation of a recorded run, or the reason why there is none."""
    first = next((file for file in recording.files if file.is_run), None)
    if first is None or first.mechanism_text is None:
        return None, "it contains no mechanism"
    try:
        return Recomputation(first), ""
    except (MechanismError, RecomputeError) as error:
        return None, f"its mechanism cannot be built ({error.message})"


def _return_at_once(address: str) -> None:
    """A window or a file needs no server."""


def _serve_until_interrupted(address: str) -> None:
    print(f"{address}\nPress Ctrl-C to stop the server.", flush=True)
    threading.Event().wait()


def _add_lab(parser: argparse.ArgumentParser) -> None:
    add_mechanism(parser)
    add_set(parser)
    add_robot(parser)
    add_page(parser)
    parser.add_argument("--paused", action="store_true", help="start paused")
    parser.add_argument("--record", metavar="FILE.mcap", type=Path, help="record from the start")
    parser.add_argument(
        "--drive",
        metavar="JOINT",
        help="show positions only, with this joint moved by hand: the parts need no masses",
    )
    parser.add_argument(
        "--html", metavar="FILE.html", type=Path, help="write a page with the motion of --time seconds, and end"
    )
    parser.add_argument("--time", metavar="SECONDS", type=float, default=10.0, help="with --html, default 10")


def _lab(options: argparse.Namespace) -> int:
    """Write the page with the motion, or serve the page until Ctrl-C."""
    require_page(options)
    mechanism = changed_mechanism(options)
    if options.html is not None:
        from mbd_sim.lab.scene.keep import write_html

        write_html(mechanism, options.html, options.time, dark=options.theme == "dark")
        print(f"wrote {options.html}")
        return 0
    from mbd_sim.lab.lab import Lab

    try:
        lab = Lab(
            mechanism,
            drive=options.drive,
            host=options.host,
            port=options.port,
            theme=options.theme,
            running=not options.paused,
            record=options.record,
        )
    except NoInertiaError as error:
        raise CommandError(str(error).rstrip("."), "Or show positions only: --drive JOINT.") from error
    with lab:
        serve_page(mechanism.name, lab.url, options)
    return 0


def _add_export(parser: argparse.ArgumentParser) -> None:
    add_run(parser)
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="file to write: .csv, .parquet or .npz")
    parser.add_argument(
        "--rate", type=positive_in("Hz"), metavar="HZ", help="rows at equal steps of time, interpolated as printed"
    )
    add_quiet(parser)


def _export(options: argparse.Namespace) -> int:
    """Write the table."""
    require_table(options.out)
    with recorded_run(options.recording, options) as path:
        table = read_run_table(path, options.quiet, options.recording)
    if options.rate:
        found, ways = resampled(table, options.rate)
        about = {**table.about, "recording": str(table.path), "interpolation": json.dumps(ways)}
        write_columns(options.out, found, about)
        for line in text_table(interpolation_table(ways), len(ways)):
            print(line)
        print(f"wrote {options.out}: {counted(len(found['time_s']), 'row')} of {counted(len(found), 'column')}")
        return 0
    columns = export(options.out, table)
    print(f"wrote {options.out}: {counted(len(table), 'row')} of {counted(columns, 'column')}")
    return 0


def _add_plot(parser: argparse.ArgumentParser) -> None:
    add_run(parser)
    parser.add_argument(
        "--out", type=Path, required=True, metavar="FILE", help="file to write: .png, .svg, .pdf or .html"
    )
    add_show(parser)
    add_coordinates(parser)
    add_plot_style(parser)
    add_quiet(parser)


def _plot(options: argparse.Namespace) -> int:
    """Draw the plots."""
    plots.require_plot(options.out)
    style = chosen_style(options, options.out)
    names = shown_plots(options, options.out)
    require_names(names)  # before anything is run
    reactions, contact_forces = "reactions" in names, "contacts" in names
    with recorded_run(options.recording, options, reactions=reactions, contact_forces=contact_forces) as path:
        table = read_run_table(path, options.quiet, options.recording)
    chosen = panels(table, names, plotted_coordinates(options, options.out), degrees=options.deg)
    plots.draw(options.out, table, chosen, style)
    print(f"wrote {options.out}: {', '.join(dict.fromkeys(panel.title.lower() for panel in chosen))}")
    return 0


COMMANDS = {
    "view": Command(
        "Show a recorded run, or the run of a mechanism, in Rerun or Foxglove: the moving mechanism with plots and "
        "events. If a recording contains no mechanism, only the joints are plotted.",
        _add_view,
        _view,
    ),
    "lab": Command(
        "Open a page in the browser on which the mechanism runs: play, pause, step, wind back, move sliders, drag "
        "parts, plot, record. Save the file in any editor, and the page follows. The page listens on this machine "
        "only, unless --host is given; then the printed address contains a token. Ctrl-C ends it.",
        _add_lab,
        _lab,
    ),
    "export": Command(
        "Export a recorded run, or the run of a mechanism, as a flat table: one row per state, with the units in "
        "the column names.",
        _add_export,
        _export,
    ),
    "plot": Command(
        "Plot a recorded run, or the run of a mechanism, as a picture or as an HTML page with zoomable plots.",
        _add_plot,
        _plot,
    ),
}
