"""`mbd_sim urdf`: a mechanism's spanning tree as URDF."""

from __future__ import annotations

import argparse

from mbd_sim.cli.common import add_mechanism

HELP = "print the spanning tree of a mechanism as URDF"
DESCRIPTION = "Print the spanning tree of a mechanism as URDF. Constraints and loop-closing joints are left out."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_mechanism(parser)


def execute(options: argparse.Namespace) -> int:
    """Print the URDF."""
    from mbd_sim.load import load_mechanism
    from mbd_sim.urdf.urdf_writer import to_urdf

    print(to_urdf(load_mechanism(options.mechanism)))
    return 0
