"""The command `mbd_sim`: check, run, record and replay mechanisms without ROS."""

from __future__ import annotations

import argparse
import errno
import sys
from collections.abc import Sequence
from typing import Protocol

from mbd_sim import __version__
from mbd_sim.base.errors import MbdSimError, quoted
from mbd_sim.base.packages import missing_package
from mbd_sim.cli.mechanisms import c_code, check, convert, fmu, list_mechanisms, schema, urdf
from mbd_sim.cli.runs import export, lab, plot, recover, rerun_with, run, sweep, verify, view
from mbd_sim.cli.shared.common import Waiting, find_temporary_folder
from mbd_sim.cli.shared.completion import complete
from mbd_sim.cli.studies import bode, kinematics, linearize, modes, optimize


class Command(Protocol):
    """A subcommand: a module of this package. Its imports are in `execute`, so that `--help` stays fast."""

    HELP: str  # one line in the list of commands
    DESCRIPTION: str  # the first paragraph of its own --help

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare its arguments."""

    def execute(self, options: argparse.Namespace) -> int:
        """Run it and return the exit code."""


COMMANDS: dict[str, Command] = {  # in the order of --help
    "check": check,
    "run": run,
    "lab": lab,
    "sweep": sweep,
    "kinematics": kinematics,
    "optimize": optimize,
    "linearize": linearize,
    "modes": modes,
    "bode": bode,
    "verify": verify,
    "recover": recover,
    "rerun-with": rerun_with,
    "view": view,
    "plot": plot,
    "export": export,
    "urdf": urdf,
    "convert": convert,
    "c-code": c_code,
    "fmu": fmu,
    "list": list_mechanisms,
    "schema": schema,
}


DISK_FULL = (errno.ENOSPC, errno.EDQUOT)
LONGEST_PATH = 4096  # characters


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command line and return its exit code.

    0: success. 1: a problem was reported, or `verify` found a difference. 2: wrong usage. 130: interrupted; the
    program makes 143 of it after SIGTERM.
    """
    parser = build_parser()
    complete(parser)
    options = parser.parse_args(arguments)
    find_temporary_folder(options)
    try:
        with Waiting(options.command, getattr(options, "quiet", False)):
            return COMMANDS[options.command].execute(options)
    except MbdSimError as error:
        print(error, file=sys.stderr)
        return 1
    except ModuleNotFoundError as error:
        explained = missing_package(error)
        if explained is None:
            raise
        print(explained, file=sys.stderr)
        return 1
    except OSError as error:
        if error.filename is None and error.errno not in DISK_FULL:
            raise
        of_file = f" {quoted(str(error.filename), LONGEST_PATH)}" if error.filename is not None else ""
        print(f"cannot read or write{of_file}: {error.strerror}. Choose another file or folder.", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130


def build_parser() -> argparse.ArgumentParser:
    """The parser of the whole command line."""
    parser = argparse.ArgumentParser(
        prog="mbd_sim",
        description="Simulate multibody mechanisms from YAML, URDF, MJCF or SDF, and work with their recordings.",
    )
    parser.add_argument("--version", action="version", version=f"mbd_sim {__version__}")
    subparsers = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, command in COMMANDS.items():
        command.add_arguments(subparsers.add_parser(name, help=command.HELP, description=command.DESCRIPTION))
    return parser


if __name__ == "__main__":
    sys.exit(main())
