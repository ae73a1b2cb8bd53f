"""Checks of the numbers that a caller gives to a simulation or an ensemble."""

from __future__ import annotations

import math
from collections.abc import Sequence
from operator import index

import numpy as np

from mbd_sim.compiler.python_callable import LARGEST
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


def finite_vector(values: Sequence[float] | Array, size: int, name: str) -> Array:
    """A copy of `values` as an array (size,).

    :raises ValueError: the shape is different, or a value is not finite.
    """
    vector = np.array(values, dtype=float)
    if vector.shape != (size,):
        raise ValueError(f"{name} must be a list of {size} values, not an array of shape {vector.shape}.")
    if not math.isfinite(sum(vector.tolist())):  # which is fast for few values, but can overflow
        require_finite(vector, name)
    return vector


def require_finite(array: Array, name: str) -> Array:
    """The array itself.

    :raises ValueError: a value is not finite.
    """
    if not np.all(np.isfinite(array)):
        raise ValueError(f"{name} contains a value that is not finite.")
    return array
