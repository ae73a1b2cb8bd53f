"""Functions of a state, compiled apart from the kernel, which they therefore do not change."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.short_repr import short_repr
from mbd_sim.compiler.code.host_module import compile_module, new_module
from mbd_sim.compiler.lists.lowering import export, lower
from mbd_sim.compiler.python.bound_call import ALL, Call, Clock, CompiledFunction
from mbd_sim.compiler.python.callable import function_of_addresses


class CompiledReaders:
    """Compiled functions of (t, y, inputs) with one output each; they release the interpreter's lock."""

    __repr__ = short_repr

    def __init__(self, functions: Mapping[str, ca.Function]) -> None:
        """Compile functions, by name."""
        module = new_module()
        symbols = {name: f"read_{number}" for number, name in enumerate(functions)}
        for name, function in functions.items():
            export(module, symbols[name], lower(module, function, inline=True))
        self._code = compile_module(module)
        self._addresses = {name: self._code.address(symbol) for name, symbol in symbols.items()}
        self._functions = {
            name: function_of_addresses(self._addresses[name], function.n_in() + 1)
            for name, function in functions.items()
        }
        self._sizes = {name: function.nnz_out(0) for name, function in functions.items()}

    def bound(self, name: str, y_size: int, input_size: int) -> BoundReader:
        """A function with memory of its own, for one thread and many calls."""
        return BoundReader(self, self._functions[name], np.empty(y_size), np.empty(input_size), self._sizes[name])

    def bound_to(self, name: str, clock: Clock, arrays: Sequence[NDArray[np.float64]], rows: slice = ALL) -> Call:
        """A function of arrays that stay where they are: see `CompiledFunction.bound`."""
        function = CompiledFunction(self._addresses[name], self, self._sizes[name])
        return function.bound(clock, arrays, (function.size,), rows)

    def read(self, name: str, time: float, y: NDArray[np.float64], inputs: NDArray[np.float64]) -> NDArray[np.float64]:
        """The output (n,) of a function, column by column."""
        moment, out = np.array([time]), np.empty(self._sizes[name])
        self._functions[name](moment.ctypes.data, y.ctypes.data, inputs.ctypes.data, out.ctypes.data)
        return out


class BoundReader:
    """A compiled function of (t, y, inputs) with its own memory, which saves most of the time of a call."""

    def __init__(
        self,
        owner: CompiledReaders,
        function: Callable[..., None],
        y: NDArray[np.float64],
        inputs: NDArray[np.float64],
        size: int,
    ) -> None:
        self._owner, self._function = owner, function  # the owner keeps the code alive
        self._time, self._y, self._inputs, self._out = np.empty(1), y, inputs, np.empty(size)
        self._addresses = [array.ctypes.data for array in (self._time, y, inputs, self._out)]

    def read(self, time: float, y: NDArray[np.float64], inputs: NDArray[np.float64]) -> NDArray[np.float64]:
        """The output (n,), which the next call overwrites."""
        self._time[0], self._y[:], self._inputs[:] = time, y, inputs
        self._function(*self._addresses)
        return self._out
