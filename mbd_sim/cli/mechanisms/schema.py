"""`mbd_sim schema`: the JSON Schema of mechanism files."""

from __future__ import annotations

import argparse
import json

HELP = "print the JSON Schema of mechanism files, for editors"
DESCRIPTION = "Print the JSON Schema of mechanism files, which editors use to complete and check them."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare no arguments."""


def execute(options: argparse.Namespace) -> int:
    """Print the schema."""
    from mbd_sim.files.checks.json_schema import json_schema

    print(json.dumps(json_schema(), indent=2))
    return 0
