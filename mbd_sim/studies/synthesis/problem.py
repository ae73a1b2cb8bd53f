"""What a mechanism is to do, and how far it is from that.

A goal is to lead a point along a path, to move an output as a function, or to need little effort; goals and bounds are
read from the arguments of the command line. The deviations are a differentiable function of parameters, of the timing,
and of an offset, which `minimizers` make small.
"""

from __future__ import annotations

import csv
import math
from argparse import Namespace
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import assert_never

import casadi as ca
import numpy as np

from mbd_sim.base.errors import InputError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.short_repr import record
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.values.expression import evaluate
from mbd_sim.mechanism.values.names import split_assignment
from mbd_sim.studies.kinematic_analysis.parametric import ParametricMotion, Quantity, StateDerivatives, States
from mbd_sim.studies.kinematic_analysis.system import (
    DriveRange,
    coordinate_columns,
    coordinate_index,
    parameter_number,
)
from mbd_sim.studies.synthesis.conditions import Condition, axis_of, excesses, measured

STEPS = (1, 4, 16)  # in which the configurations follow the unknowns, until the mechanism can be assembled


@dataclass(frozen=True, eq=False)
class _Known:
    """Unknowns x for which the states and their derivatives are known."""

    x: Array
    states: States
    derivatives: StateDerivatives


class DesignProblem:
    """The unknowns x are the parameters (np,), then the positions of the drive if the timing is free, or the offset.

    Deviations are in m, rad, N or N·m. Configurations follow the unknowns from those at the start.
    """

    def __init__(
        self, mechanism: Mechanism, drive: str, goal: Goal, keys: Sequence[str], conditions: Sequence[Condition] = ()
    ) -> None:
        """Trace the equations.

        :raises MechanismError: a key does not exist, or cannot be a parameter.
        :raises InputError: the drive, the point or the output does not exist.
        """
        self.mechanism, self.goal, self.conditions = mechanism, goal, tuple(conditions)
        self._speed = goal.speed if isinstance(goal, EffortGoal) else 1.0
        self.parametric = ParametricMotion(mechanism, [drive], keys, with_forces=isinstance(goal, EffortGoal))
        match goal:
            case PathGoal():
                self._quantity = self.parametric.point(goal.point)
                self._wanted = np.isfinite(goal.positions)
            case FunctionGoal():
                self._quantity = self.parametric.coordinate(goal.output)
            case EffortGoal():
                self._quantity = self.parametric.efforts
            case _:
                assert_never(goal)
        self._measured = [self._quantity_of(one.quantity) for one in self.conditions]
        self._known: _Known | None = None
        self._last: tuple[_Known, Array, States | None] | None = None  # what was followed last, from where to where

    def _quantity_of(self, name: str) -> tuple[Quantity, int]:
        """A coordinate or a component of a point, with its column."""
        if (found := axis_of(name, self.mechanism)) is not None:
            return self.parametric.point(found[0]), found[1]
        return self.parametric.coordinate(name), 0

    def condition_functions(self) -> list[tuple[ca.Function, int]]:
        """The quantity of each condition as a function of q, u, u' and parameters, with its column."""
        found: list[tuple[ca.Function, int]] = []
        for one in self.conditions:
            at = axis_of(one.quantity, self.mechanism)
            if at is None:
                found.append((self.parametric.coordinate_function(one.quantity), 0))
            else:
                found.append((self.parametric.place_function(at[0]), at[1]))
        return found

    def measured(self, x: Array) -> Array:
        """What the conditions measure (m,); nan where the mechanism cannot be assembled."""
        return self._measures(x, self._nothing)[0]

    def excesses(self, x: Array) -> tuple[Array, Array]:
        """How far the conditions are exceeded (m,), inf where it cannot be assembled, and the derivatives (m, len(x)).

        They are those at unknowns for which `jacobian` was called last.
        """
        values, slopes = self._measures(x, self._derivatives_at(x))
        found, derived = excesses(self.conditions, values, slopes)
        wide = np.zeros((len(found), len(x)))
        wide[:, : derived.shape[1]] = derived
        return np.where(np.isfinite(found), found, np.inf), wide

    def _derivatives_at(self, x: Array) -> Callable[[States], StateDerivatives]:
        known = self._known
        return self._nothing if known is None or not np.array_equal(known.x, x) else lambda _: known.derivatives

    def _nothing(self, states: States) -> StateDerivatives:
        keys = len(self.parametric.keys)
        return StateDerivatives(*(np.zeros((*one.shape, keys)) for one in (states.u,) * 3))

    def _measures(self, x: Array, derivatives: Callable[[States], StateDerivatives]) -> tuple[Array, Array]:
        keys = len(self.parametric.keys)
        values, slopes = np.full(len(self.conditions), np.nan), np.zeros((len(self.conditions), keys))
        states = self._followed(x)
        if states is not None:
            known = derivatives(states)
            for row, (one, (quantity, column)) in enumerate(zip(self.conditions, self._measured, strict=True)):
                found, derived = quantity(states, known, self._parameters(x))
                values[row], slopes[row] = measured(one, found[:, column], derived[:, column])
        return values, slopes

    @property
    def start(self) -> Array:
        """The unknowns at the start."""
        goal, values = self.goal, self.parametric.values
        if isinstance(goal, PathGoal) and goal.free_timing:
            return np.concatenate([values, goal.drives])
        return np.append(values, 0.0) if isinstance(goal, FunctionGoal) and goal.free_offset else values.copy()

    @property
    def value_function(self) -> ca.Function:
        """What the goal is about, as a CasADi function of q, u, u' and parameters; of efforts, those of the tree."""
        match self.goal:
            case PathGoal(point=point):
                return self.parametric.place_function(point)
            case FunctionGoal(output=output):
                return self.parametric.coordinate_function(output)
            case EffortGoal():
                return self.parametric.tree_function()
            case _:
                assert_never(self.goal)

    @property
    def output_column(self) -> int:
        """The place of the output of a function in q; -1 for other goals."""
        if not isinstance(self.goal, FunctionGoal):
            return -1
        mechanism = self.parametric.system.mechanism
        return int(coordinate_columns(mechanism)[coordinate_index(mechanism, self.goal.output)])

    def begin(self, configurations: Array, x: Array | None = None) -> None:
        """Start from configurations (n, nq) at the drives of the goal, for unknowns x, by default those of the file."""
        x = self.start if x is None else x
        states = self._states(x, configurations)
        if states is not None:
            self._keep(x, states)

    def drives(self, x: Array) -> Array:
        """The positions (n,) of the drive."""
        if isinstance(self.goal, PathGoal) and self.goal.free_timing:
            return x[len(self.parametric.keys) :]
        return self.goal.drives

    def configurations(self) -> Array:
        """Those (n, nq) for which derivatives were computed last."""
        assert self._known is not None
        return self._known.states.q

    def deviations(self, x: Array) -> Array:
        """The deviations (k,); inf where the mechanism cannot be assembled."""
        states = self._followed(x)
        if states is None:
            return np.full(self.count, np.inf)
        values, _ = self._quantity(states, self._nothing(states), self._parameters(x))
        return self._less_goal(values, x)

    def jacobian(self, x: Array) -> Array:
        """Their derivatives (k, len(x)). What follows begins from the configurations found here."""
        states = self._followed(x)
        assert states is not None, "derivatives are wanted where the mechanism cannot be assembled"
        self._keep(x, states)
        assert self._known is not None
        _, slopes = self._quantity(states, self._known.derivatives, self._parameters(x))
        match self.goal:
            case PathGoal(free_timing=free):
                by_parameters = slopes[:, :3][self._wanted]
                if not free:
                    return np.asarray(by_parameters)
                values, _ = self._quantity(states, self._known.derivatives, self._parameters(x))
                by_drives = np.zeros((*self._wanted.shape, len(states.q)))
                rows = np.arange(len(states.q))
                by_drives[rows, :, rows] = values[:, 3:6]  # velocities, at a unit speed of the drive
                return np.column_stack([by_parameters, by_drives[self._wanted]])
            case FunctionGoal(free_offset=free):
                return np.column_stack([slopes[:, 0], -np.ones(len(slopes))]) if free else np.asarray(slopes[:, 0])
            case EffortGoal():
                return np.asarray(slopes[:, 0])
            case _:
                assert_never(self.goal)

    @property
    def count(self) -> int:
        """The number of deviations."""
        return int(np.sum(self._wanted)) if isinstance(self.goal, PathGoal) else len(self.goal.drives)

    def _less_goal(self, values: Array, x: Array) -> Array:
        match self.goal:
            case PathGoal(positions=positions):
                return np.asarray((values[:, :3] - positions)[self._wanted])
            case FunctionGoal(values=wanted, free_offset=free):
                return np.asarray(values[:, 0] - wanted - (x[-1] if free else 0.0))
            case EffortGoal():
                return np.asarray(values[:, 0])
            case _:
                assert_never(self.goal)

    def _parameters(self, x: Array) -> Array:
        return np.ascontiguousarray(x[: len(self.parametric.keys)])

    def _states(self, x: Array, guesses: Array) -> States | None:
        return self.parametric.states(self._parameters(x), self.drives(x)[:, None], guesses, np.array([self._speed]))

    def _followed(self, x: Array) -> States | None:
        """The states for unknowns x, followed from those that are known, in more and more steps."""
        known = self._known
        if known is None:
            return None
        if np.array_equal(known.x, x):
            return known.states
        if self._last is not None and self._last[0] is known and np.array_equal(self._last[1], x):
            return self._last[2]
        states = self._moved(known, x)
        self._last = known, x.copy(), states
        return states

    def _moved(self, known: _Known, x: Array) -> States | None:
        system, speed = self.parametric.system, self._speed or 1.0
        moved = known.derivatives.q @ (self._parameters(x) - self._parameters(known.x))
        if self._speed:
            moved += known.states.u / speed * (self.drives(x) - self.drives(known.x))[:, None]
        for steps in STEPS:
            states: States | None = known.states
            for step in range(1, steps + 1):
                if states is None:
                    break
                guesses = np.array([system.displaced(q, one / steps) for q, one in zip(states.q, moved, strict=True)])
                states = self._states(known.x + step / steps * (x - known.x), guesses)
            if states is not None:
                return states
        return None

    def _keep(self, x: Array, states: States) -> None:
        self._known = _Known(x.copy(), states, self.parametric.derivatives(self._parameters(x), states))


@record
class PathGoal:
    """A point passes through `positions` (n, 3) in m in ground's axes; nan where a component does not matter.

    `drives` (n,) are the positions of the drive in rad or m at which it is there. With `free_timing` they are only the
    first guesses.
    """

    point: str
    positions: Array
    drives: Array
    free_timing: bool = False

    def __post_init__(self) -> None:
        _convert(self, "drives", "positions")
        _require_rows(self.drives, self.positions, (len(self.drives), 3), "positions")
        if np.any(np.isinf(self.positions)):
            raise InputError("some of the positions are infinite", "Give nan where a component does not matter.")
        if not np.any(np.isfinite(self.positions)):
            raise InputError("a path without any position", "Give numbers for at least one component.")


@record
class FunctionGoal:
    """A coordinate, the `output`, has `values` (n,) at the positions `drives` (n,) of the drive, in rad or m.

    With a `free_offset` only their differences matter: an unknown constant is added to all of them.
    """

    output: str
    values: Array
    drives: Array
    free_offset: bool = False

    def __post_init__(self) -> None:
        _convert(self, "drives", "values")
        _require_rows(self.drives, self.values, (len(self.drives),), "values")
        if not np.all(np.isfinite(self.values)):
            raise InputError("a function with values that are not finite", "Leave these rows out.")


@record
class EffortGoal:
    """The effort of the drive is small at its positions `drives` (n,), at a constant `speed` in rad/s or m/s."""

    drives: Array
    speed: float

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
            raise InputError(f"'{options.function}' is not a function", "Write NAME=EXPRESSION.")
        values = [evaluate(expression, {**mechanism.parameters, drive.name: float(at)}) for at in drives]
        return FunctionGoal(output, np.array(values), drives, options.free_offset)
    return EffortGoal(drives, speed)


def _path(text: str, drive: DriveRange, count: int | None, *, free_timing: bool) -> PathGoal:
    point, name = split_assignment(text)
    if not point or not name:
        raise InputError(f"'{text}' is not a path", "Write PART.POINT=FILE.csv.")
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
