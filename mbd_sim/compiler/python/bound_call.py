"""Functions of a state, compiled apart from the kernel, which they therefore do not change, as Python callables."""

from __future__ import annotations

import ctypes
import json
import math
from collections.abc import Callable, Sequence
from itertools import accumulate, pairwise
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base import disk_cache
from mbd_sim.base.interrupts import interruptible
from mbd_sim.base.short_repr import record
from mbd_sim.compiler.code.machine_code import load_code
from mbd_sim.compiler.python.bound_kernel import function_of_addresses

if TYPE_CHECKING:  # what was compiled before is read without CasADi
    import casadi as ca

Clock = tuple[NDArray[np.int64], NDArray[np.float64]]
Call = Callable[[], NDArray[np.float64]]
Shape = tuple[int, ...]
Record = TypeVar("Record")

ALL = slice(None)


@record
class CompiledFunction:
    """Machine code of a function of the addresses of the time, of further arrays, and of its output of some `size`.

    The `owner` lives as long as the machine code.
    """

    address: int
    owner: object
    size: int

    @classmethod
    @interruptible()
    def of(cls, trace: Callable[[], ca.Function], key: str | None = None) -> CompiledFunction:
        """Compile the function (t, …) -> values that `trace` returns, apart from the kernel, which stays as it is.

        :param key: of the cache on disk, where the function is found without tracing it; None: nothing is stored.
        """
        if key is not None and (found := cls._stored(key)) is not None:
            return found
        from mbd_sim.compiler.code.host_module import compile_module, new_module
        from mbd_sim.compiler.lists.lowering import export, lower

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

    def read(self, time: float, *arrays: NDArray[np.float64]) -> NDArray[np.float64]:
        """The output (n,) of a function of the time and further arrays, column by column; it takes no lock."""
        moment, out = np.array([time]), np.empty(self.size)
        addresses = [array.ctypes.data for array in (moment, *arrays, out)]
        function_of_addresses(self.address, len(addresses))(*addresses)
        return out

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
        make: Callable[..., Record],
        fields: tuple[Shape, ...],
    ) -> Callable[[], dict[str, Record]]:
        """The bound call as a callable that returns new records by name.

        :param names: in the order in which the output has the numbers of the records.
        :param make: makes a record of its arrays.
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
            return {name: make(*(values[..., k] for values in columns)) for k, name in enumerate(names)}

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
