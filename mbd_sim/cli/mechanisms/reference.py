"""`mbd_sim list` and `mbd_sim schema`: the shipped mechanisms, and the JSON Schema of mechanism files."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from mbd_sim.cli.shared.command import Command
from mbd_sim.files.load import load_mechanism
from mbd_sim.files.text.library import shipped


def _declare_nothing(parser: argparse.ArgumentParser) -> None:
    """Both commands have no arguments."""


def _list(options: argparse.Namespace) -> int:
    for name, path in shipped().items():
        print(f"{name:24s} {load_mechanism(Path(path)).description.splitlines()[0]}")
    return 0


def _print_schema(options: argparse.Namespace) -> int:
    from mbd_sim.files.checks.json_schema import json_schema  # imports the whole schema, which `list` does not need

    print(json.dumps(json_schema(), indent=2))
    return 0


COMMANDS = {
    "list": Command(
        "List the shipped mechanisms, each with its name and a one-line description.", _declare_nothing, _list
    ),
    "schema": Command(
        "Print the JSON Schema of mechanism files, which editors use to complete and check them.",
        _declare_nothing,
        _print_schema,
    ),
}
