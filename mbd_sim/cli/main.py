"""The command `mbd_sim`: check, run, record and replay mechanisms without ROS.

Only the module of the command that is typed is imported, so that the list of commands and wrong ones appear at once.
"""

from __future__ import annotations

import argparse
import errno
import importlib
import sys
from collections.abc import Collection, Sequence

from mbd_sim import __version__
from mbd_sim.base.errors import MbdSimError, nearest, quoted
from mbd_sim.base.packages import missing_package
from mbd_sim.cli.shared.command import Command
from mbd_sim.cli.shared.completion import complete, line_to_complete
from mbd_sim.cli.shared.progress import Waiting, find_temporary_folder

COMMANDS = {  # in the order of --help: the module, and what the command does
    "check": ("mechanisms.check", "report parts, joints, degrees of freedom, constraints and energies of a mechanism"),
    "run": ("runs.run", "run a mechanism as fast as possible, without ROS"),
    "lab": ("runs.lab", "run, change and take hold of a mechanism on a page in the browser"),
    "sweep": ("runs.sweep", "run a mechanism many times with varied values"),
    "kinematics": (
        "studies.kinematics",
        "move drives through ranges: positions, velocities, accelerations, dead points, loads",
    ),
    "optimize": ("studies.optimize", "find parameters for a path, a function, or the least effort of the drive"),
    "linearize": (
        "studies.linearize",
        "print the state-space model of small motions: A, B, C, D with chosen inputs and outputs",
    ),
    "modes": (
        "studies.modes",
        "natural modes: frequencies, damping, shapes; root locus and stability map over values of the file",
    ),
    "bode": ("studies.linearize", "compute the frequency response from chosen inputs to chosen outputs"),
    "verify": ("runs.verify", "recompute recorded runs and compare them bit for bit"),
    "recover": ("runs.verify", "repair recordings with a truncated end or a damaged index"),
    "rerun-with": ("runs.rerun_with", "recompute a recorded run with changed values, and compare the two runs"),
    "view": ("runs.view", "show a run in Rerun"),
    "plot": ("runs.export", "plot energies, joints, residual, measurements and phase portrait of a run"),
    "export": ("runs.export", "export a run as a table, for example for pandas"),
    "urdf": ("mechanisms.convert", "print the spanning tree of a mechanism as URDF"),
    "convert": (
        "mechanisms.convert",
        "print a mechanism in another format: as a self-contained mechanism file, URDF, MJCF or SDF",
    ),
    "c-code": ("mechanisms.code", "write the equations of motion of a mechanism and steps of them as C code"),
    "fmu": ("mechanisms.code", "write a mechanism as an FMU, for use in other simulation tools"),
    "list": ("mechanisms.reference", "list the shipped mechanisms"),
    "schema": ("mechanisms.reference", "print the JSON Schema of mechanism files, for editors"),
}


DISK_FULL = (errno.ENOSPC, errno.EDQUOT)
LONGEST_PATH = 4096  # characters


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command line and return its exit code.

    0: success. 1: a problem was reported, or `verify` found a difference. 2: wrong usage. 130: interrupted; the
    program makes 143 of it after SIGTERM.
    """
    arguments = sys.argv[1:] if arguments is None else arguments
    typed = [word for word in line_to_complete() or arguments if not word.startswith("-")][:1]
    try:
        parser = build_parser(typed)
        complete(parser)
        if typed and typed[0] not in COMMANDS:
            parser.error(f"there is no command '{typed[0]}'. {nearest(typed[0], COMMANDS)}")
        options = parser.parse_args(arguments)
        find_temporary_folder(options)
        with Waiting(options.command, getattr(options, "quiet", False)):
            return command(options.command).execute(options)
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


def command(name: str) -> Command:
    """The command of a name; imports its module, and with it everything that the command needs."""
    module = importlib.import_module(f"mbd_sim.cli.{COMMANDS[name][0]}")
    found: Command = module.COMMANDS[name]
    return found


def build_parser(typed: Collection[str] = tuple(COMMANDS)) -> argparse.ArgumentParser:
    """The parser of the command line; only commands that are `typed` have their arguments, which their modules say."""
    parser = argparse.ArgumentParser(
        prog="mbd_sim",
        description="Simulate multibody mechanisms from YAML, URDF, MJCF or SDF, and work with their recordings.",
    )
    parser.add_argument("--version", action="version", version=f"mbd_sim {__version__}")
    subparsers = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, (_, summary) in COMMANDS.items():
        subparser = subparsers.add_parser(name, help=summary)
        if name in typed:
            chosen = command(name)
            subparser.description = chosen.description
            chosen.add_arguments(subparser)
    return parser


if __name__ == "__main__":
    sys.exit(main())
