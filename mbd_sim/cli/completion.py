"""Completion in a shell, by argcomplete, if it is installed: `eval "$(register-python-argcomplete mbd_sim)"`."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Iterable
from typing import Any

RUNS = ("recording", "recordings")  # arguments that take a recording
WITHOUT_MECHANISMS = ("recover",)  # commands that take recordings only


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
        if completer is not None:
            action.completer = completer  # type: ignore[attr-defined]


def _mechanisms_and_files(prefix: str, **_: Any) -> list[str]:
    from argcomplete.completers import FilesCompleter

    from mbd_sim.mechanism_file.library import shipped

    return [*(name for name in shipped() if name.startswith(prefix)), *FilesCompleter()(prefix)]


def _methods(prefix: str, **_: Any) -> list[str]:
    from mbd_sim.integrators.methods import METHODS

    return [name for name in METHODS if name.startswith(prefix)]
