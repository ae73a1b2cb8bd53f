"""`mbd_sim convert`: a URDF as a mechanism file."""

from __future__ import annotations

import argparse

from mbd_sim.cli.common import add_mechanism

HELP = "print a URDF, or a mechanism file that extends one, as one self-contained mechanism file"
DESCRIPTION = "Print a URDF, or a mechanism file that extends one, as one self-contained mechanism file in YAML."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_mechanism(parser)
    parser.add_argument(
        "--base", choices=["fixed", "free"], help="how the root link of the URDF is attached to ground (default: fixed)"
    )


def execute(options: argparse.Namespace) -> int:
    """Print the mechanism file."""
    from mbd_sim.load import load_mechanism

    print(load_mechanism(options.mechanism, options.base).source.text, end="")
    return 0
