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
    parser.add_argument("--expand", action="store_true", help="write out the entries that are repeated with 'for'")


def execute(options: argparse.Namespace) -> int:
    """Print the mechanism file."""
    from mbd_sim.load import load_mechanism

    source = load_mechanism(options.mechanism, options.base).source
    if options.expand and source.template is not None:
        from mbd_sim.mechanism_file.yaml_writer import yaml_text

        print(yaml_text(source.data), end="")
        return 0
    print(source.text, end="")
    return 0
