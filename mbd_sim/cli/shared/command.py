"""A subcommand of `mbd_sim`, what it shows while it is at work, and where it puts files that are removed at its end."""

from __future__ import annotations

import argparse
import logging
import os
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Self

from mbd_sim.base.operating_system import OPEN_FILES, memory_file

if TYPE_CHECKING:
    from rich.progress import Progress


@dataclass(frozen=True)
class Command:
    """A subcommand: the first paragraph of its `--help`, its arguments, and what it does.

    `execute` returns the exit code.
    """

    description: str
    add_arguments: Callable[[argparse.ArgumentParser], None]
    execute: Callable[[argparse.Namespace], int]


PERCENT = "{task.percentage:.0f} %"  # how a progress bar prints the completed amount
SECONDS = "{task.completed:.1f} s"
COUNT = "{task.completed:.0f}/{task.total:.0f}"
PATIENCE = 2.0  # s after which a command shows that it is at work


class Waiting:
    """A line with the stage and the time that has passed, shown on a terminal while a `with` block takes over 2 s.

    It makes room for a `ProgressBar`, and returns at the next `stage`. What the compiler says of long work appears as a
    note, on a terminal or not.
    """

    _active: Waiting | None = None
    _logger = logging.getLogger("mbd_sim.compiler.kernel")

    def __init__(self, title: str, quiet: bool) -> None:
        self._command = self._title = title
        self._lock = threading.Lock()
        self._display: Progress | None = None
        self._timer: threading.Timer | None = None
        self._hidden = quiet or sys.stdout is None or not sys.stdout.isatty()
        self._notes = _Notes(self._say)
        self._listens = not quiet and sys.stderr is not None

    def __enter__(self) -> Self:
        Waiting._active = self
        if self._listens:
            self._logger.addHandler(self._notes)
            self._logger.setLevel(logging.INFO)
        self._start()
        return self

    def __exit__(self, *_: object) -> None:
        Waiting._active = None
        if self._listens:
            self._logger.removeHandler(self._notes)
            self._logger.setLevel(logging.NOTSET)
        self._end()

    def _say(self, text: str) -> None:
        self._end()
        print(f"note: {text}", file=sys.stderr, flush=True)
        self._start()

    def _start(self) -> None:
        if not self._hidden:
            self._timer = threading.Timer(PATIENCE, self._show)
            self._timer.daemon = True
            self._timer.start()

    def _show(self) -> None:
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

        with self._lock:
            if self._timer is None:
                return
            columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
            self._display = Progress(*columns, transient=True)
            self._display.add_task(self._title, total=None)
            self._display.start()

    def _end(self) -> None:
        with self._lock:
            if self._timer is not None:
                self._timer.cancel()
            self._timer = None
            if self._display is not None:
                self._display.stop()
            self._display = None

    @classmethod
    def stage(cls, name: str) -> None:
        """Say what the command does from now on, such as "compile"."""
        if (line := cls._active) is not None:
            with line._lock:
                line._title = f"{line._command}: {name}"
                if line._display is not None:
                    line._display.update(line._display.task_ids[0], description=line._title)
                elif line._timer is None:
                    line._start()

    @classmethod
    def make_room(cls) -> None:
        """End what is shown at present."""
        if cls._active is not None:
            cls._active._end()


class _Notes(logging.Handler):
    """Passes on the texts of log messages."""

    def __init__(self, say: Callable[[str], None]) -> None:
        super().__init__(logging.INFO)
        self._say = say

    def emit(self, record: logging.LogRecord) -> None:
        self._say(record.getMessage())


class ProgressBar:
    """A progress bar on the terminal, shown while its `with` block runs; with `quiet`, nothing is shown."""

    def __init__(self, title: str, quiet: bool, *, total: float = 1.0, amount: str = PERCENT) -> None:
        from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

        columns = (TextColumn("{task.description}"), BarColumn(), TextColumn(amount), TimeRemainingColumn())
        self._display = Progress(*columns, disable=quiet, transient=True)
        self._quiet = quiet
        self._task = self._display.add_task(title, total=total)

    def __enter__(self) -> Self:
        Waiting.make_room()
        if not self._quiet:
            self._display.start()
        return self

    def __exit__(self, *_: object) -> None:
        if not self._quiet:  # Rich before 14.1 prints a line at the end of what it has not shown
            self._display.stop()

    def show(self, completed: float) -> None:
        """Show how much of the total is completed."""
        self._display.update(self._task, completed=completed)

    def advance(self, amount: float) -> None:
        """Add to the completed amount."""
        self._display.advance(self._task, amount)


def find_temporary_folder(options: argparse.Namespace) -> None:
    """Where the usual folders for temporary files cannot be written, use memory, or the folder of a file to write."""
    try:
        tempfile.gettempdir()
    except FileNotFoundError:
        written = [value.absolute().parent for value in vars(options).values() if isinstance(value, Path)]
        for folder in (Path("/dev/shm"), *written):  # noqa: S108  (files in it have names of their own)
            tempfile.tempdir = str(folder)
            try:
                with tempfile.TemporaryFile():
                    return
            except OSError:
                tempfile.tempdir = None


@contextmanager
def temporary_file(name: str) -> Iterator[Path]:
    """The path of a file that is removed at the end; it is in memory where no folder can be written."""
    try:
        folder = tempfile.TemporaryDirectory(prefix="mbd_sim_")
    except FileNotFoundError:
        in_memory = memory_file(name)
        if in_memory is None:
            raise
        try:
            yield OPEN_FILES / str(in_memory)
        finally:
            os.close(in_memory)
        return
    with folder:
        yield Path(folder.name, name)
