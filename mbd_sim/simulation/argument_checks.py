"""Checks of the numbers that a caller gives to a simulation or an ensemble."""

from __future__ import annotations

import math
from collections.abc import Sequence
from operator import index

import numpy as np
from numpy.typing import NDArray

from mbd_sim.compiler.python_callable import LARGEST
from mbd_sim.errors import InputError, counted, quoted
from mbd_sim.geometry.pose import Array


def step_size(given: float | None, default: float) -> float:
    """The step size in s: the given one, else the `default` of the mechanism.

    :raises ValueError: it is not positive and finite.
    """
    size = default if given is None else float(given)
    if not (math.isfinite(size) and size > 0.0):
        raise ValueError(f"the step must be a positive number of seconds, not {given!r}.")
    return size


def step_count(n: int) -> int:
    """A number of steps.

    :raises TypeError: `n` is not an integer.
    :raises ValueError: it is negative, or so large that time in steps would not be exact.
    """
    count = index(n)
    if not 0 <= count <= LARGEST:
        raise ValueError(f"the number of steps must lie between 0 and {LARGEST}, not {count}.")
    return count


def positive_count(value: object, name: str) -> int:
    """A number of something, of which there must be one or more.

    :param name: of the argument, for the error.
    :raises InputError: it is not a whole number, or less than 1.
    """
    count = value if isinstance(value, int | np.integer) and not isinstance(value, bool) else 0
    if count < 1:
        raise InputError(f"{name} must be a whole number of 1 or more, not {quoted(value)}")
    return int(count)


def rows_of(values: Sequence[float] | Array, shape: tuple[int, int], name: str) -> Array:
    """An array of a `shape` (k, n) from n values for all rows, or from all (k, n).

    :param name: of the values, for the error.
    :raises ValueError: they have another shape.
    """
    array = np.asarray(values, dtype=float)
    if array.shape not in (shape, shape[1:], (1, shape[1]), ()):
        remedy = f"Give {counted(shape[1], 'value')} for all members, or {shape}."
        raise ValueError(f"{name} has the shape {array.shape}. {remedy}")
    return np.broadcast_to(array, shape)


def member_numbers(members: Sequence[int] | NDArray[np.intp], count: int) -> NDArray[np.intp]:
    """The indices (n,) of some of `count` members.

    :raises InputError: they are not whole numbers, for example a mask.
    :raises IndexError: there is no such member.
    """
    given = np.asarray(members)
    if given.size and given.dtype.kind not in "iu":
        remedy = "Give the indices of members; for a mask use np.flatnonzero(mask)."
        raise InputError(f"members are chosen by {quoted(members)}", remedy)
    return np.arange(count)[given.astype(np.intp)]


def step_at(time: float, size: float, steps: int = 0) -> int:
    """The number of the step nearest to a time in s.

    :param steps: the steps taken so far.
    :raises ValueError: the time is not finite, or is before that step.
    """
    if not math.isfinite(time):
        raise ValueError(f"cannot run until t = {time} s: the time must be finite.")
    if (last := round(time / size)) < steps:
        raise ValueError(
            f"cannot run until t = {time:g} s: the time is already {steps * size:g} s. "
            "Give a later time, or call reset() first."
        )
    return last
