"""Arrays of a known shape from what a caller gives."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from mbd_sim.base.errors import counted, listed
from mbd_sim.base.geometry.pose import Array


def finite_matrix(values: Sequence[Sequence[float]] | Array, shape: tuple[int, int], name: str) -> Array:
    """An array (rows, columns) of `values`.

    :raises ValueError: the shape is different, or a value is not finite.
    """
    matrix = np.asarray(values, dtype=float)
    if matrix.shape != shape:
        raise ValueError(f"{name} must have the shape {shape}, not {matrix.shape}.")
    return require_finite(matrix, name)


Entries = Callable[[], Sequence[str]]  # what the values of a vector are, which only messages need


def vector(values: Sequence[float] | Array, size: int, name: str, entries: Entries | None = None) -> Array:
    """`values` as an array (size,), the same one if they are an array of floats.

    :raises ValueError: the shape is different.
    """
    found = np.asarray(values, dtype=float)
    if found.shape != (size,):
        order = f" They are, in this order: {listed(list(entries()), 100)}." if entries is not None else ""
        wrong = f"{name} must be a list of {counted(size, 'value')}, not an array of shape {found.shape}"
        raise ValueError(f"{wrong}.{order}")
    return found


def finite_vector(values: Sequence[float] | Array, size: int, name: str, entries: Entries | None = None) -> Array:
    """A copy of `values` as an array (size,).

    :raises ValueError: the shape is different, or a value is not finite.
    """
    found = vector(values, size, name, entries).copy()
    if not math.isfinite(sum(found.tolist())):  # which is fast for few values, but can overflow
        require_finite(found, name)
    return found


def require_finite(array: Array, name: str) -> Array:
    """The array itself.

    :raises ValueError: a value is not finite.
    """
    if not np.all(np.isfinite(array)):
        raise ValueError(f"{name} contains a value that is not finite.")
    return array
