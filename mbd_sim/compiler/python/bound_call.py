"""Functions of a state, compiled apart from the kernel, which they therefore do not change, as Python callables."""

from __future__ import annotations

import ctypes
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise
from typing import TypeVar

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from mbd_sim.base import disk_cache
from mbd_sim.base.interrupts import interruptible_tracing
from mbd_sim.base.short_repr import short_repr
from mbd_sim.compiler.code.host_module import compile_module, new_module
from mbd_sim.compiler.code.machine_code import load_code
from mbd_sim.compiler.lists.lowering import export, lower
from mbd_sim.compiler.python.bound_kernel import function_of_addresses

Clock = tuple[NDArray[np.int64], NDArray[np.float64]]
Call = Callable[[], NDArray[np.float64]]
Shape = tuple[int, ...]
Record = TypeVar("Record")

ALL = slice(None)


@dataclass(frozen=True, slots=True)
class CompiledFunction:
    """Machine code of a function of the addresses of the time, of further arrays, and of its output of some `size`.

    The `owner` lives as long as the machine code.
    """

    address: int
    owner: object
    size: int

    @classmethod
    @interruptible_tracing()
    def of(cls, trace: Callable[[], ca.Function], key: str | None = None) -> CompiledFunction:
        """Compile the function (t, …) -> values that `trace` returns, apart from the kernel, which stays as it is.

        :param key: of the cache on disk, where the function is found without tracing it; None: nothing is stored.
        """
        if key is not None and (found := cls._stored(key)) is not None:
            return found
        function, module = trace(), new_module()
        export(module, "function", lower(module, function, inline=True))
        code, size = compile_module(module), function.nnz_out(0)
        if key is not None:
            disk_cache.store(key, json.dumps([size, code.key]).encode())
        return cls(code.address("function"), code, size)

    @classmethod
    def _stored(cls, key: str) -> CompiledFunction | None:
        if (entry := disk_cache.load(key)) is None:
            return None
        size, code_key = json.loads(entry)
        code = load_code(code_key)
        return None if code is None else cls(code.address("function"), code, size)

    def bound(self, clock: Clock, arrays: Sequence[NDArray[np.float64]], shape: Shape, rows: slice = ALL) -> Call:
        """The function of arrays that stay where they are, as a callable that returns a new array.

        :param clock: the number of steps (1,) and the step size (1,) in s, of which the time is the product.
        :param arrays: the other arguments.
        :param shape: of the output, in which its numbers are row by row.
        :param rows: those that are returned, without gaps.
        """
        evaluate, out = self._evaluation(clock, arrays)
        found = out.reshape(shape)[rows]

        def read() -> NDArray[np.float64]:
            evaluate()
            return found.copy()

        return read

    def bound_records(
        self,
        clock: Clock,
        arrays: Sequence[NDArray[np.float64]],
        names: tuple[str, ...],
        record: Callable[..., Record],
        fields: tuple[Shape, ...],
    ) -> Callable[[], dict[str, Record]]:
        """The bound call as a callable that returns new records by name.

        :param names: in the order in which the output has the numbers of the records.
        :param record: makes a record of its arrays.
        :param fields: the shapes of these arrays; each has the next numbers of the output, column by column.
        """
        evaluate, out = self._evaluation(clock, arrays)
        ends = list(accumulate(map(math.prod, fields), initial=0))
        rows, places = out.reshape(len(names), ends[-1]), [slice(*pair) for pair in pairwise(ends)]
        by_columns = [(len(names), *reversed(shape)) for shape in fields]

        def read() -> dict[str, Record]:
            evaluate()
            copied = rows.copy()
            columns = [copied[:, place].reshape(shape).T for place, shape in zip(places, by_columns, strict=True)]
            return {name: record(*(values[..., k] for values in columns)) for k, name in enumerate(names)}

        return read

    def _evaluation(
        self, clock: Clock, arrays: Sequence[NDArray[np.float64]]
    ) -> tuple[Callable[[], object], NDArray[np.float64]]:
        """What evaluates the function, and the output that this overwrites."""
        (steps, step_size), time, out = clock, np.empty(1), np.empty(self.size)
        pointers = [array.ctypes.data_as(ctypes.c_void_p) for array in (time, *arrays, out)]  # they keep the arrays
        call = function_of_addresses(self.address, len(pointers))
        call.owner = self.owner

        def evaluate() -> None:
            np.multiply(steps, step_size, out=time)
            call(*pointers)

        return evaluate, out


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
