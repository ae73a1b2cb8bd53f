"""`mbd_sim urdf`: a mechanism's spanning tree as URDF."""

from __future__ import annotations

import argparse

from mbd_sim.cli.mechanisms.convert import write_as
from mbd_sim.cli.shared.common import add_mechanism

HELP = "print the spanning tree of a mechanism as URDF"
DESCRIPTION = (
    "Print the spanning tree of a mechanism as URDF. What URDF cannot express, such as joints that close loops, is "
    "listed in the file and printed to standard error."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_mechanism(parser)


def execute(options: argparse.Namespace) -> int:
    """Print the URDF."""
    from mbd_sim.files.load import load_mechanism

    return write_as(load_mechanism(options.mechanism), "urdf")
