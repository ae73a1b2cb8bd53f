"""The command `mbd_sim`: check, run, record and replay mechanisms without ROS.

Only the module of the command that is typed is imported, so that the list of commands and wrong ones appear at once.

argcomplete completes command lines in a shell: `eval "$(register-python-argcomplete mbd_sim)"`.
"""

from __future__ import annotations

import argparse
import errno
import importlib
import os
import sys
from collections.abc import Callable, Collection, Iterable, Sequence
from typing import TYPE_CHECKING, Any

from mbd_sim import __version__
from mbd_sim.base.errors import MbdSimError, nearest, quoted
from mbd_sim.base.packages import missing_package
from mbd_sim.cli.shared.command import Command, Waiting, find_temporary_folder

if TYPE_CHECKING:
    from mbd_sim.mechanism.mechanism import Mechanism


RUNS = ("recording", "recordings")  # arguments that take a recording
WITHOUT_MECHANISMS = ("recover",)  # commands that take recordings only


# Options that take names of the mechanism on the command line: which ones, and what may follow a name.
NAMES: dict[str, tuple[tuple[str, ...], str]] = {
    "changes": (("keys",), "="),
    "vary": (("keys",), "="),
    "sensitivity": (("keys",), ""),
    "tolerance": (("keys",), "="),
    "start": (("coordinates",), "="),
    "effort": (("coordinates",), "="),
    "drive": (("coordinates",), "="),
    "function": (("coordinates",), "="),
    "coordinates": (("coordinates",), ","),
    "joint": (("coordinates",), ""),
    "transmission": (("joints",), ","),
    "poses": (("parts",), ","),
    "accelerations": (("coordinates", "parts", "points"), ","),
    "trace": (("parts", "points"), ""),
    "point": (("parts", "points"), ""),
    "path": (("points",), "="),
}


def line_to_complete() -> list[str]:
    """The words after the program on the line that a shell asks to complete; empty when none asks."""
    return os.environ.get("COMP_LINE", "").split()[1:] if "_ARGCOMPLETE" in os.environ else []


def complete(parser: argparse.ArgumentParser) -> None:
    """Answer a shell that asks how a command line may continue, and end; otherwise return, without any import."""
    if "_ARGCOMPLETE" not in os.environ:
        return
    try:
        import argcomplete
    except ImportError:
        return
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for command, subparser in action.choices.items():
                _add_completers(command, subparser)
    argcomplete.autocomplete(parser, always_complete_options=False)


def _add_completers(command: str, parser: argparse.ArgumentParser) -> None:
    for action in parser._actions:
        completer: Callable[..., Iterable[str]] | None = None
        if action.dest == "mechanism" or (action.dest in RUNS and command not in WITHOUT_MECHANISMS):
            completer = _mechanisms_and_files
        elif action.dest == "method":
            completer = _methods
        elif action.dest in NAMES:
            completer = _Names(*NAMES[action.dest])
        if completer is not None:
            action.completer = completer  # type: ignore[attr-defined]


def _mechanisms_and_files(prefix: str, **_: Any) -> list[str]:
    from argcomplete.completers import FilesCompleter

    from mbd_sim.files.text.library import shipped

    return [*(name for name in shipped() if name.startswith(prefix)), *FilesCompleter()(prefix)]


def _methods(prefix: str, **_: Any) -> list[str]:
    from mbd_sim.integrators.methods import METHODS

    return [name for name in METHODS if name.startswith(prefix)]


class _Names:
    """Completes names of parts, points, joints, coordinates or keys of the mechanism on the command line."""

    def __init__(self, kinds: Sequence[str], follows: str) -> None:
        self._kinds, self._follows = kinds, follows

    def __call__(self, prefix: str, parsed_args: argparse.Namespace, **_: Any) -> list[str]:
        from mbd_sim.files.load import load_mechanism

        try:
            mechanism = load_mechanism(_mechanism_of(parsed_args))
        except (MbdSimError, OSError, ImportError):
            return []
        names = [name for kind in self._kinds for name in _names(mechanism, kind)]
        before, comma, last = prefix.rpartition(",") if self._follows == "," else ("", "", prefix)
        follows = "=" if self._follows == "=" else ""
        return [f"{before}{comma}{name}{follows}" for name in names if name.startswith(last)]


def _mechanism_of(options: argparse.Namespace) -> str:
    if "mechanism" in options:  # it may have arguments behind it, so that argcomplete does not assign it yet
        return next((word for word in line_to_complete()[1:] if not word.startswith("-")), "")
    named = getattr(options, "recording", None) or ""
    return str(named or next(iter(getattr(options, "recordings", None) or ()), ""))


def _names(mechanism: Mechanism, kind: str) -> Iterable[str]:
    match kind:
        case "parts":
            return mechanism.parts
        case "points":
            return [f"{name}.{point}" for name, part in mechanism.parts.items() for point in part.points]
        case "joints":
            return mechanism.all_joints
        case "coordinates":
            return mechanism.coordinate_names
        case _:
            from mbd_sim.files.checks.override import matching

            return [*mechanism.parameters, *matching(mechanism, ["*"])]


COMMANDS = {  # in the order of --help: the module, and what the command does
    "check": ("mechanisms.check", "report parts, joints, degrees of freedom, constraints and energies of a mechanism"),
    "run": ("runs.run", "run a mechanism as fast as possible, without ROS"),
    "lab": ("runs.view", "run, change and take hold of a mechanism on a page in the browser"),
    "sweep": ("runs.sweep", "run a mechanism many times with varied values"),
    "kinematics": (
        "studies.kinematics",
        "move drives through ranges: positions, velocities, accelerations, dead points, loads",
    ),
    "size": ("studies.size", "choose motors, gears, flywheels and springs for a motion and its loads"),
    "centers": (
        "studies.centers",
        "instant centers, velocity and acceleration polygons, centrodes of planar mechanisms",
    ),
    "optimize": ("studies.kinematics", "find parameters for a path, a function, or the least effort of the drive"),
    "synthesize": ("studies.synthesize", "find linkages for poses, dead centers or functions, from nothing but these"),
    "linearize": (
        "studies.linearize",
        "print the state-space model of small motions: A, B, C, D with chosen inputs and outputs",
    ),
    "modes": (
        "studies.linearize",
        "natural modes: frequencies, damping, shapes; root locus and stability map over values of the file",
    ),
    "bode": ("studies.linearize", "compute the frequency response from chosen inputs to chosen outputs"),
    "verify": ("runs.verify", "recompute recorded runs and compare them bit for bit"),
    "recover": ("runs.verify", "repair recordings with a truncated end or a damaged index"),
    "rerun-with": ("runs.verify", "recompute a recorded run with changed values, and compare the two runs"),
    "view": ("runs.view", "show a run in Rerun"),
    "plot": ("runs.view", "plot energies, joints, residual, measurements and phase portrait of a run"),
    "export": ("runs.view", "export a run as a table, for example for pandas"),
    "layout": ("runs.layout", "write a layout of plots of a mechanism for Foxglove or PlotJuggler"),
    "urdf": ("mechanisms.convert", "print the spanning tree of a mechanism as URDF"),
    "convert": (
        "mechanisms.convert",
        "print a mechanism in another format: as a self-contained mechanism file, URDF, MJCF or SDF",
    ),
    "import": ("mechanisms.import_cad", "write a mechanism file from a STEP assembly of a CAD program"),
    "c-code": ("mechanisms.code", "write the equations of motion of a mechanism and steps of them as C code"),
    "fmu": ("mechanisms.code", "write a mechanism as an FMU, for use in other simulation tools"),
    "list": ("mechanisms.convert", "list the shipped mechanisms"),
    "schema": ("mechanisms.convert", "print the JSON Schema of mechanism files, for editors"),
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
