"""The arguments of `mbd_sim view`, `plot` and `export`; what they need is imported when they run."""

from __future__ import annotations

import argparse
from pathlib import Path

RATE = 200.0  # states a second that are shown
_RUN = "an .mcap or .db3 file, or a folder of rosbag2"


def add_view(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = commands.add_parser(
        "view",
        help="show a recorded run in Rerun",
        description="Show a recording in Rerun: the moving mechanism with its plots and events. Of a recording without "
        "a mechanism, the joints as plots.",
    )
    parser.add_argument("recording", metavar="RUN", type=Path, help=_RUN)
    parser.add_argument("--save", metavar="FILE.rrd", help="write a file instead of opening a window")
    parser.add_argument(
        "--rerun", metavar="SINK", default="spawn", help="spawn (default), serve, connect, or a file.rrd"
    )
    parser.add_argument("--rate", type=_positive, default=RATE, metavar="HZ", help="states a second (default 200)")
    parser.add_argument(
        "--trace",
        action="append",
        metavar="POINT",
        help="leave a trace of part or part.point (default: ends of chains)",
    )
    parser.add_argument("--trace-time", type=_positive, default=1.0, metavar="S", help="how long it stays (default 1)")
    parser.add_argument("--reactions", action="store_true", help="show the forces through the joints")
    parser.add_argument("--quiet", action="store_true", help="no progress bar")
    parser.set_defaults(command=_view)


def add_plot(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = commands.add_parser(
        "plot",
        help="draw a recorded run: energies, joints, phase portrait, residual",
        description="Draw a recorded run into a picture, or into a page of HTML that can be zoomed.",
    )
    parser.add_argument("recording", metavar="RUN", type=Path, help=_RUN)
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help=".png, .svg, .pdf or .html")
    parser.add_argument(
        "--show", metavar="WHAT", default="", help="some of energies,joints,residual,phase (default: all there is)"
    )
    parser.add_argument("--quiet", action="store_true", help="no progress bar")
    parser.set_defaults(command=_plot)


def add_export(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = commands.add_parser(
        "export",
        help="write a recorded run as a table, for pandas and others",
        description="Write a recorded run as a flat table: a row for each state, the units in the columns' names.",
    )
    parser.add_argument("recording", metavar="RUN", type=Path, help=_RUN)
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help=".csv, .parquet or .npz")
    parser.add_argument("--quiet", action="store_true", help="no progress bar")
    parser.set_defaults(command=_export)


def _view(options: argparse.Namespace) -> int:
    from mbd_sim.cli.playback_commands import run_view

    return run_view(options)


def _plot(options: argparse.Namespace) -> int:
    from mbd_sim.cli.playback_commands import run_plot

    return run_plot(options)


def _export(options: argparse.Namespace) -> int:
    from mbd_sim.cli.playback_commands import run_export

    return run_export(options)


def _positive(text: str) -> float:
    value = float(text)
    if not 0.0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text} is not a positive number")
    return value
