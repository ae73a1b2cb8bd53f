"""What a mechanism is to do: lead a point along a path, move an output as a function, or need little effort."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbd_sim.errors import InputError
from mbd_sim.geometry.pose import Array
from mbd_sim.short_repr import short_repr


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
