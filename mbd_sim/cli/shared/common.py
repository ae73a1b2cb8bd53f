"""Arguments and output that several subcommands share."""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Self

from mbd_sim.base.errors import InputError, listed

if TYPE_CHECKING:
    from rich.progress import Progress

    from mbd_sim.mechanism.mechanism import Mechanism
    from mbd_sim.recordings.views.table import RunTable

PERCENT = "{task.percentage:.0f} %"  # how a progress bar prints the completed amount
SECONDS = "{task.completed:.1f} s"
COUNT = "{task.completed:.0f}/{task.total:.0f}"

ROUND_OFF = 1e-13  # of a number that was computed over many steps, relative to the numbers that cancel in it
PATIENCE = 2.0  # s after which a command shows that it is at work
DURATION = 10.0  # s that are simulated where no time is given

MCAP_OR_BAG = "an .mcap file or a rosbag2 folder"
ANY_RECORDING = "an .mcap or .db3 file, or a rosbag2 folder"


def add_mechanism(parser: argparse.ArgumentParser) -> None:
    """Declare the argument `mechanism`."""
    parser.add_argument(
        "mechanism",
        metavar="FILE",
        help="a mechanism file, a URDF, MJCF or SDF, or the name of a shipped mechanism",
    )


def add_recordings(parser: argparse.ArgumentParser, kinds: str) -> None:
    """Declare the argument `recordings`, one or more; `kinds` says which ones are accepted."""
    parser.add_argument("recordings", metavar="RUN", type=Path, nargs="+", help=f"{kinds}; one or more")


def add_duration(parser: argparse.ArgumentParser) -> None:
    """Declare `--time`."""
    parser.add_argument(
        "--time",
        type=positive_in("s"),
        default=DURATION,
        metavar="S",
        help=f"seconds to simulate (default {DURATION:g}), or a value with a unit, such as 200ms",
    )


def add_method_and_step(parser: argparse._ActionsContainer, default: str) -> None:
    """Declare `--method` and `--step`; `default` says where they come from when they are not given."""
    parser.add_argument("--method", help=f"integration method (default: {default})")
    parser.add_argument(
        "--step", type=positive_in("s"), metavar="S", help=f"time step in seconds (default: {default}), or such as 2ms"
    )


def add_quiet(parser: argparse.ArgumentParser) -> None:
    """Declare `--quiet`."""
    parser.add_argument("--quiet", action="store_true", help="show no progress bar")


def positive_number(text: str) -> float:
    """An argument's positive, finite number."""
    try:
        value = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number") from None
    if not 0.0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text} is not a positive number")
    return value


def positive_in(si_unit: str) -> Callable[[str], float]:
    """The type of an argument that is a positive quantity: a number in its SI unit, or a value with its unit."""

    def quantity(text: str) -> float:
        from mbd_sim.files.text.values import parse_value, split_unit

        if not split_unit(text)[1]:
            return positive_number(text)
        try:
            value = parse_value(text, {}, si_unit)
        except InputError as error:
            raise argparse.ArgumentTypeError(f"{text!r}: {error}") from None
        return positive_number(repr(value))

    return quantity


def rounded(value: float, size: float, round_off: float = ROUND_OFF) -> float:
    """A value, or 0 where it is round-off in comparison with the numbers of the given size that cancel in it."""
    return 0.0 if abs(value) <= round_off * size else value


def seed_number(text: str) -> int:
    """The type of a seed: a whole number that is not negative."""
    if not text.strip().isdecimal():
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from 0 on")
    return int(text)


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
        in_memory = os.memfd_create(name)
        try:
            yield Path(f"/proc/self/fd/{in_memory}")
        finally:
            os.close(in_memory)
        return
    with folder:
        yield Path(folder.name, name)


def text_table(columns: Mapping[str, Sequence[object]], most: int) -> Iterator[str]:
    """The lines of a table of numbers and words, aligned at the right, with at most this number of rows."""
    rows = min(most, max((len(values) for values in columns.values()), default=0))
    texts = [
        [name, *(f"{value:.6g}" if isinstance(value, float) else str(value) for value in values[:rows])]
        for name, values in columns.items()
    ]
    widths = [max(map(len, column)) for column in texts]
    for row in zip(*texts, strict=True):
        yield "  ".join(text.rjust(width) for text, width in zip(row, widths, strict=True))


class Waiting:
    """A line with the stage and the time that has passed, shown on a terminal while a `with` block takes over 2 s.

    It makes room for a `ProgressBar`, and returns at the next `stage`.
    """

    _active: Waiting | None = None

    def __init__(self, title: str, quiet: bool) -> None:
        self._command = self._title = title
        self._lock = threading.Lock()
        self._display: Progress | None = None
        self._timer: threading.Timer | None = None
        self._hidden = quiet or not sys.stdout.isatty()

    def __enter__(self) -> Self:
        Waiting._active = self
        self._start()
        return self

    def __exit__(self, *_: object) -> None:
        Waiting._active = None
        self._end()

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


class ProgressBar:
    """A progress bar on the terminal, shown while its `with` block runs; with `quiet`, nothing is shown."""

    def __init__(self, title: str, quiet: bool, *, total: float = 1.0, amount: str = PERCENT) -> None:
        from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

        columns = (TextColumn("{task.description}"), BarColumn(), TextColumn(amount), TimeRemainingColumn())
        self._display = Progress(*columns, disable=quiet, transient=True)
        self._task = self._display.add_task(title, total=total)

    def __enter__(self) -> Self:
        Waiting.make_room()
        self._display.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._display.stop()

    def show(self, completed: float) -> None:
        """Show how much of the total is completed."""
        self._display.update(self._task, completed=completed)

    def advance(self, amount: float) -> None:
        """Add to the completed amount."""
        self._display.advance(self._task, amount)


def read_run_table(path: Path, quiet: bool, name: str = "") -> RunTable:
    """Read a recording's states as a table, with a progress bar; print the notes about them.

    :param name: of the run, where the recording is a temporary file.
    """
    from mbd_sim.recordings.run.reader import open_recording
    from mbd_sim.recordings.views.table import read_table

    recording = open_recording(path)
    with ProgressBar("read", quiet) as progress:
        table = read_table(recording, progress.show)
    print_notes(table.notes)
    return replace(table, path=Path(name)) if name else table


def print_notes(notes: Iterable[str]) -> None:
    """Print each on a line of its own."""
    for note in notes:
        print(f"note: {note}")


def print_undrawn_meshes(mechanism: Mechanism) -> None:
    """Print, to standard error, which meshes a picture lacks and why."""
    from mbd_sim.pictures.shapes.meshes import undrawn_meshes

    if missing := undrawn_meshes(mechanism):
        print(f"note: meshes that are not drawn: {listed(missing)}", file=sys.stderr)
