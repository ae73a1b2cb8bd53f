"""The arguments of `mbd_sim sweep`; what it needs is imported when it runs."""

from __future__ import annotations

import argparse
from pathlib import Path


def add_sweep(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = commands.add_parser(
        "sweep",
        help="run a mechanism many times with other values",
        description="Run a mechanism many times with other values of its file: all combinations, or random ones.",
    )
    parser.add_argument("mechanism", metavar="FILE", help="a mechanism file, or the name of one that ships")
    parser.add_argument(
        "--vary", action="append", default=[], metavar="NAME=VALUES", required=True,
        help="a value of the file, such as parameters.l or joints.elbow.position, or a constant effort, efforts.elbow: "
        "0.5:2:20 is 20 values, 0.5,1,2 are these, uniform(0.5, 2), loguniform and normal(mean, deviation) are drawn",
    )  # fmt: skip
    parser.add_argument("--draws", type=int, default=1, metavar="N", help="runs for each combination (default 1)")
    parser.add_argument("--seed", type=int, default=0, help="of what is drawn (default 0)")
    parser.add_argument("--time", type=_positive, default=10.0, metavar="S", help="seconds to simulate (default 10)")
    parser.add_argument("--every", type=_positive, metavar="S", help="seconds between looks (default: time / 1000)")
    parser.add_argument("--method", help="integration method, instead of the file's")
    parser.add_argument("--step", type=_positive, metavar="S", help="step in seconds, instead of the file's")
    parser.add_argument("--out", type=Path, metavar="FILE", help="table of the runs, .parquet or .csv")
    parser.add_argument("--histories", type=Path, metavar="FILE", help="table of all coordinates over time as well")
    parser.add_argument("--plot", type=Path, metavar="PICTURE", help="draw a result over what is varied")
    parser.add_argument("--show", metavar="RESULT", help="the result to draw, such as elbow.most")
    parser.add_argument("--scheduler", default="", metavar="ADDRESS", help="of a Dask scheduler, as tcp://host:8786")
    parser.add_argument("--quiet", action="store_true", help="no progress bar")
    parser.set_defaults(command=_sweep)


def _sweep(options: argparse.Namespace) -> int:
    from mbd_sim.cli.sweep import run_sweep

    return run_sweep(options)


def _positive(text: str) -> float:
    value = float(text)
    if not 0.0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text} is not a positive number")
    return value
