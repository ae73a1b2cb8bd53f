"""Completion in a shell, by argcomplete, if it is installed: `eval "$(register-python-argcomplete mbd_sim)"`."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any

from mbd_sim.base.errors import MbdSimError

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
    named = getattr(options, "mechanism", None) or getattr(options, "recording", None) or ""
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
