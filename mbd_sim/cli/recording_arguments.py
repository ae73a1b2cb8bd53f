"""The arguments of `mbd_sim verify`, `rerun-with` and `recover`; what they need is imported when they run."""

from __future__ import annotations

import argparse
from pathlib import Path


def add_verify(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = commands.add_parser(
        "verify",
        help="compute recorded runs again and compare them bit for bit",
        description="Compute recorded runs again from the mechanism, start and commands that they hold, and compare.",
    )
    parser.add_argument("recordings", metavar="RUN", type=Path, nargs="+", help="an .mcap file, or a folder of rosbag2")
    parser.add_argument(
        "--tolerance", type=_positive, metavar="X",
        help="compare to this part of 1 + the numbers, from each recorded state to the next (default: bit for bit, "
        "and 1e-9 for recordings of another machine or version)",
    )  # fmt: skip
    parser.add_argument("--quiet", action="store_true", help="no progress bar")
    parser.set_defaults(command=_verify)


def add_rerun_with(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = commands.add_parser(
        "rerun-with",
        help="compute a recorded run again with a change, and show both",
        description="Compute a recorded run again under the same commands, but with other values, method or step.",
    )
    parser.add_argument("recording", metavar="RUN", type=Path, help="an .mcap file, or a folder of rosbag2")
    parser.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", dest="changes",
        help="a value of the mechanism's file, such as joints.elbow.damping=0.2 or l='80 cm'",
    )  # fmt: skip
    parser.add_argument("--method", help="integration method, instead of the recorded one")
    parser.add_argument("--step", type=_positive, metavar="S", help="step in seconds, instead of the recorded one")
    parser.add_argument("--plot", type=Path, metavar="PICTURE", help="draw both runs: a .png, .svg, .pdf or .html")
    parser.add_argument("--out", type=Path, metavar="FILE", help="write the changed run to an .mcap file")
    parser.add_argument("--quiet", action="store_true", help="no progress bar")
    parser.set_defaults(command=_rerun_with)


def add_recover(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = commands.add_parser(
        "recover",
        help="make recordings whole that a kill or a full disk cut off",
        description="Cut off what is not whole at the end of recordings, and give them the index that tools ask for.",
    )
    parser.add_argument("recordings", metavar="RUN", type=Path, nargs="+", help="an .mcap file, or a folder of rosbag2")
    parser.set_defaults(command=_recover)


def _recover(options: argparse.Namespace) -> int:
    from mbd_sim.cli.recover import run_recover

    return run_recover(options)


def _verify(options: argparse.Namespace) -> int:
    from mbd_sim.cli.verify import run_verify

    return run_verify(options)


def _rerun_with(options: argparse.Namespace) -> int:
    from mbd_sim.cli.rerun_with import run_what_if

    return run_what_if(options)


def _positive(text: str) -> float:
    value = float(text)
    if not 0.0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text} is not a positive number")
    return value
