"""CasADi functions of numbers, without the conversions of a call: in a fraction of its time."""

from __future__ import annotations

from weakref import WeakKeyDictionary

import casadi as ca
import numpy as np

from mbd_sim.base.geometry.pose import Array


class _Evaluator:
    """Memory of the arguments and results of a function; the results are views, column by column."""

    def __init__(self, function: ca.Function) -> None:
        self._buffer, self.evaluate = function.buffer()
        self.arguments = [np.zeros(function.nnz_in(index)) for index in range(function.n_in())]
        self.sizes = [argument.size for argument in self.arguments]
        results = [np.zeros(function.nnz_out(index)) for index in range(function.n_out())]
        for index, argument in enumerate(self.arguments):
            self._buffer.set_arg(index, argument.data)  # type: ignore[call-arg]  # the size is that of the memory
        for index, result in enumerate(results):
            self._buffer.set_res(index, result.data)  # type: ignore[call-arg]
        self.results = [result.reshape(function.size_out(k), order="F") for k, result in enumerate(results)]


_idle: WeakKeyDictionary[ca.Function, list[_Evaluator]] = WeakKeyDictionary()  # one for each thread that calls it


def all_evaluated(function: ca.Function, *arguments: float | Array) -> list[Array]:
    """The results, as contiguous arrays, of a function with dense arguments and dense results.

    :raises ValueError: an argument does not have as many numbers as that of the function.
    """
    idle = _idle.get(function)
    if idle is None:
        idle = _idle.setdefault(function, [])
    arrays = [np.asarray(argument, dtype=float) for argument in arguments]
    evaluator = idle.pop() if idle else _Evaluator(function)
    try:
        if [array.size for array in arrays] != evaluator.sizes:
            raise ValueError(f"the arguments of {function} do not have the sizes {[a.shape for a in arrays]}")
        for own, array in zip(evaluator.arguments, arrays, strict=True):
            own[:] = array if array.ndim == 1 else array.ravel()
        evaluator.evaluate()
        return [result.copy() for result in evaluator.results]
    finally:
        idle.append(evaluator)


def evaluated(function: ca.Function, *arguments: float | Array) -> Array:
    """The first of the results, see `all_evaluated`."""
    return all_evaluated(function, *arguments)[0]


GROUP = 64  # rows that are evaluated in one call


def evaluated_for_all(function: ca.Function, *arguments: Array) -> Array:
    """The first result (k, n) of a function for each of k rows (k, …) of its arguments, column by column.

    CasADi's map evaluates the function for one row after the other, so that each gets the bits of a call of its own.
    """
    count, size = len(arguments[0]), function.nnz_out(0)
    padding = -count % GROUP
    padded = [np.concatenate([rows, np.repeat(rows[-1:], padding, axis=0)]) for rows in arguments]
    mapped = function.map(GROUP)
    groups = [
        all_evaluated(mapped, *(np.ascontiguousarray(rows[first : first + GROUP]) for rows in padded))[0]
        for first in range(0, count, GROUP)
    ]
    flat = [np.ascontiguousarray(group.T).reshape(GROUP, size) for group in groups]
    return np.concatenate([np.zeros((0, size)), *flat])[:count]
