"""`mbd_sim convert`, `urdf`, `list` and `schema`: mechanisms in other formats, the shipped ones, the JSON Schema."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from pathlib import Path

from mbd_sim.base.errors import CommandError
from mbd_sim.base.plain_output import print_file
from mbd_sim.cli.shared.command import Command
from mbd_sim.cli.shared.common import add_mechanism
from mbd_sim.cli.shared.setup_options import add_robot, read_mechanism, set_up_by
from mbd_sim.files.load import load_mechanism
from mbd_sim.files.mjcf.writer import to_mjcf
from mbd_sim.files.mjcf.written.bodies import Written
from mbd_sim.files.sdf.writer import to_sdf
from mbd_sim.files.text.library import shipped
from mbd_sim.files.text.mesh_files import with_meshes_seen_from
from mbd_sim.files.text.yaml_text import mechanism_text, yaml_text
from mbd_sim.files.urdf.writer import left_out, to_urdf
from mbd_sim.mechanism.mechanism import Mechanism

WRITERS: dict[str, Callable[[Mechanism], Written]] = {
    "urdf": lambda mechanism: Written(to_urdf(mechanism), left_out(mechanism)),
    "mjcf": to_mjcf,
    "sdf": to_sdf,
}


def _add_convert(parser: argparse.ArgumentParser) -> None:
    add_mechanism(parser)
    parser.add_argument("--to", choices=["yaml", *WRITERS], default="yaml", help="format to write (default: yaml)")
    add_robot(parser)
    parser.add_argument("--expand", action="store_true", help="write out the entries that are repeated with 'for'")


def _convert(options: argparse.Namespace) -> int:
    """Print the file.

    :raises CommandError: `--expand` with another format.
    """
    if options.expand and options.to != "yaml":
        raise CommandError(f"--expand has no effect with --to {options.to}", "Leave out one of them.")
    mechanism = with_meshes_seen_from(set_up_by(options, read_mechanism(options), {}), None)
    if options.to != "yaml":
        return _write_as(mechanism, options.to)
    source = mechanism.source
    if options.expand and source.template is not None:
        print_file(yaml_text(source.data))
        return 0
    print_file(mechanism_text(source))
    return 0


def _write_as(mechanism: Mechanism, to: str) -> int:
    """Print a mechanism in another format, and to standard error what is left out."""
    written = WRITERS[to](mechanism)
    print_file(written.text)
    for note in written.left_out:
        print(f"note: not in this file: {note}", file=sys.stderr)
    return 0


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
    "convert": Command(
        "Print a mechanism in another format. A URDF, MJCF or SDF, or a mechanism file that extends a URDF, becomes"
        " one self-contained mechanism file in YAML; with --to, any mechanism becomes URDF, MJCF or SDF. What the "
        "other format cannot express is listed in the file and printed to standard error. Paths of meshes become "
        "absolute, so that the output may be written to any folder.",
        _add_convert,
        _convert,
    ),
    "urdf": Command(
        "Print the spanning tree of a mechanism as URDF. What URDF cannot express, such as joints that close loops,"
        " is listed in the file and printed to standard error.",
        add_mechanism,
        lambda options: _write_as(load_mechanism(options.mechanism), "urdf"),
    ),
    "list": Command(
        "List the shipped mechanisms, each with its name and a one-line description.", _declare_nothing, _list
    ),
    "schema": Command(
        "Print the JSON Schema of mechanism files, which editors use to complete and check them.",
        _declare_nothing,
        _print_schema,
    ),
}
