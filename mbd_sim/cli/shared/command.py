"""A subcommand of `mbd_sim`."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Command:
    """A subcommand: the first paragraph of its `--help`, its arguments, and what it does.

    `execute` returns the exit code.
    """

    description: str
    add_arguments: Callable[[argparse.ArgumentParser], None]
    execute: Callable[[argparse.Namespace], int]
