"""`mbd_sim list`: the mechanisms that ship with the package."""

from __future__ import annotations

import argparse
from pathlib import Path

HELP = "list the shipped mechanisms"
DESCRIPTION = "List the shipped mechanisms, each with its name and a one-line description."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare no arguments."""


def execute(options: argparse.Namespace) -> int:
    """Print the list."""
    from mbd_sim.files.load import load_mechanism
    from mbd_sim.files.text.library import shipped

    for name, path in shipped().items():
        print(f"{name:24s} {load_mechanism(Path(path)).description.splitlines()[0]}")
    return 0
