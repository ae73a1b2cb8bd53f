"""What a mechanism is to do: lead a point along a path, move an output as a function, or need little effort.

Goals and bounds are read from the arguments of the command line.
"""

from __future__ import annotations

import csv
import math
from argparse import Namespace
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mbd_sim.base.errors import InputError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.short_repr import short_repr
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.values.expression import evaluate
from mbd_sim.mechanism.values.names import split_assignment
from mbd_sim.studies.kinematic_analysis.system import DriveRange, parameter_number


@dataclass(frozen=True, eq=False)
class PathGoal:
    """A point passes through `positions` (n, 3) in m in ground's axes; nan where a component does not matter.

    `drives` (n,) are the positions of the drive in rad or m at which it is there. With `free_timing` they are only the
    first guesses.
    """

    point: str
    positions: Array
    drives: Array
    free_timing: bool = False

    __repr__ = short_repr

    def __post_init__(self) -> None:
        _convert(self, "drives", "positions")
        _require_rows(self.drives, self.positions, (len(self.drives), 3), "positions")
        if np.any(np.isinf(self.positions)):
            raise InputError("some of the positions are infinite", "Give nan where a component does not matter.")
        if not np.any(np.isfinite(self.positions)):
            raise InputError("a path without any position", "Give numbers for at least one component.")


@dataclass(frozen=True, eq=False)
class FunctionGoal:
    """A coordinate, the `output`, has `values` (n,) at the positions `drives` (n,) of the drive, in rad or m.

    With a `free_offset` only their differences matter: an unknown constant is added to all of them.
    """

    output: str
    values: Array
    drives: Array
    free_offset: bool = False

    __repr__ = short_repr

    def __post_init__(self) -> None:
        _convert(self, "drives", "values")
        _require_rows(self.drives, self.values, (len(self.drives),), "values")
        if not np.all(np.isfinite(self.values)):
            raise InputError("a function with values that are not finite", "Leave these rows out.")


@dataclass(frozen=True, eq=False)
class EffortGoal:
    """The effort of the drive is small at its positions `drives` (n,), at a constant `speed` in rad/s or m/s."""

    drives: Array
    speed: float

    __repr__ = short_repr

    def __post_init__(self) -> None:
        _convert(self, "drives")
        _require_rows(self.drives, self.drives, (len(self.drives),), "drives")


Goal = PathGoal | FunctionGoal | EffortGoal


def _convert(goal: Goal, *names: str) -> None:
    """Turn lists of numbers into arrays; single numbers become arrays of one, which are refused for their shape."""
    for name in names:
        object.__setattr__(goal, name, np.atleast_1d(np.asarray(getattr(goal, name), dtype=float)))


def _require_rows(drives: Array, values: Array, shape: tuple[int, ...], name: str) -> None:
    if drives.ndim != 1 or len(drives) < 2 or not np.all(np.isfinite(drives)):
        raise InputError("the positions of the drive must be at least two finite numbers", "Give them in rad or m.")
    if values.shape != shape:
        raise InputError(
            f"{name} have the shape {values.shape}", f"Give {shape}, a row for each position of the drive."
        )


POSITIONS = 37
COLUMNS = ("x", "y", "z", "drive")


def bounds_of(texts: Sequence[str], mechanism: Mechanism) -> dict[str, tuple[float, float]]:
    """The bounds of `KEY=LOW:HIGH`, by key, in SI units.

    :raises InputError: a text cannot be read, or a key is given twice.
    """
    found: dict[str, tuple[float, float]] = {}
    for text in texts:
        key, rest = split_assignment(text)
        words = [word.strip() for word in rest.split(":")]
        if not key or len(words) != 2 or not all(words):
            raise InputError(f"'{text}' gives no bounds", "Write KEY=LOW:HIGH, for example l=0.5:2 or l=200mm:400mm.")
        if key in found:
            raise InputError(f"{key} is varied twice", "Remove one of the two.")
        low, high = (parameter_number(text, key, word, mechanism) for word in words)
        if not low < high:
            raise InputError(f"{text}: the lower bound is not below the upper one", "Write KEY=LOW:HIGH.")
        found[key] = (low, high)
    return found


def goal_of(options: Namespace, mechanism: Mechanism, drive: DriveRange, count: int | None, speed: float) -> Goal:
    """The goal that `--path`, `--function` or `--least-effort` describe.

    :raises InputError: it cannot be read, or an option does not fit to it.
    """
    if options.free_timing and not options.path:
        raise InputError("--free-timing without a path", "Give --path, or leave it out.")
    if options.free_offset and not options.function:
        raise InputError("--free-offset without a function", "Give --function, or leave it out.")
    drives = np.linspace(drive.start, drive.stop, count or POSITIONS)
    if options.path:
        return _path(options.path, drive, count, free_timing=options.free_timing)
    if options.function:
        output, expression = split_assignment(options.function)
        if not output or not expression:
            raise InputError(f"'{options.function}' is no function", "Write NAME=EXPRESSION.")
        values = [evaluate(expression, {**mechanism.parameters, drive.name: float(at)}) for at in drives]
        return FunctionGoal(output, np.array(values), drives, options.free_offset)
    return EffortGoal(drives, speed)


def _path(text: str, drive: DriveRange, count: int | None, *, free_timing: bool) -> PathGoal:
    point, name = split_assignment(text)
    if not point or not name:
        raise InputError(f"'{text}' is no path", "Write PART.POINT=FILE.csv.")
    table = _table(Path(name))
    rows = len(next(iter(table.values())))
    positions = np.column_stack([table.get(axis, np.full(rows, np.nan)) for axis in "xyz"])
    drives = table.get("drive", np.linspace(drive.start, drive.stop, rows))
    if np.any((drives < min(drive.start, drive.stop)) | (drives > max(drive.start, drive.stop))):
        raise InputError(f"{name} has positions of the drive beyond its range", "Give a wider range.")
    if count not in (None, rows):
        raise InputError(f"{name} has {rows} positions, and the drive {count}", "Leave the number of the drive out.")
    return PathGoal(point, positions, drives, free_timing)


def _table(path: Path) -> dict[str, Array]:
    """The columns of a table; empty fields are nan.

    :raises InputError: it cannot be read, with the line.
    """
    try:
        with path.open(encoding="utf-8", newline="") as stream:
            rows = list(csv.reader(stream))
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not a text in UTF-8"
        raise InputError(f"{path} cannot be read: {reason}", "Give a .csv file.") from error
    names = [name.strip() for name in rows[0]] if rows else []
    if not names or not {*names} <= {*COLUMNS} or not {*names} & {*"xyz"} or len({*names}) < len(names):
        raise InputError(f"{path}: the first line must name the columns", f"They are {', '.join(COLUMNS)}.")
    found: list[list[float]] = []
    for line, row in enumerate(rows[1:], 2):
        if not row:
            continue
        if len(row) != len(names):
            raise InputError(f"{path}:{line}: {len(row)} numbers instead of {len(names)}", "Complete the line.")
        found.append([_number(path, line, word.strip()) for word in row])
    if len(found) < 2:
        raise InputError(f"{path} has less than two positions", "Give a row for each position of the point.")
    return dict(zip(names, np.array(found).T, strict=True))


def _number(path: Path, line: int, word: str) -> float:
    if not word:
        return math.nan
    try:
        value = float(word)
    except ValueError:
        raise InputError(f"{path}:{line}: '{word}' is not a number", "Write numbers in m and rad.") from None
    if not math.isfinite(value):
        raise InputError(f"{path}:{line}: '{word}' is not finite", "Leave the field empty if it does not matter.")
    return value
