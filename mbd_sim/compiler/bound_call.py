"""Compiled functions of a running simulation as Python callables without arguments: see `mbd_sim.compiler.fastcall`."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import cast

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from mbd_sim.compiler.fastcall import linked
from mbd_sim.compiler.host_module import compile_module, new_module
from mbd_sim.compiler.ir import POINTER, Function, FunctionType, Module, Value
from mbd_sim.compiler.ir_builder import IRBuilder
from mbd_sim.compiler.ir_types import DOUBLE, INT, element, integer
from mbd_sim.compiler.lowering import lower
from mbd_sim.compiler.machine_code import MachineCode
from mbd_sim.compiler.python_callable import callable_of

Clock = tuple[NDArray[np.int64], NDArray[np.float64]]
Call = Callable[[], NDArray[np.float64]]


class CompiledFunction:
    """A compiled function of the time and of further arrays, with one output."""

    def __init__(self, function: ca.Function) -> None:
        """Compile a function (t, …) -> values, apart from the kernel, which it therefore does not change."""
        module = new_module()
        _emit_read(module, function.n_in() - 1, lower(module, function, inline=True))
        self._code, self._size = compile_module(module), function.nnz_out(0)

    def bound(
        self, clock: Clock, arrays: Sequence[NDArray[np.float64]], shape: tuple[int, ...], rows: int | None = None
    ) -> Call:
        """The function of arrays that stay where they are, as a callable that returns a new array.

        :param clock: the number of steps (1,) and the step size (1,) in s, of which the time is the product.
        :param arrays: the other arguments.
        :param shape: of the output, in which its numbers are row by row.
        :param rows: how many of the first rows are returned, by default all.
        """
        return _bound(self._code, clock, arrays, np.empty(self._size), shape, rows)


def bound_reader(
    address: int,
    owner: object,
    clock: Clock,
    arrays: Sequence[NDArray[np.float64]],
    size: int,
    shape: tuple[int, ...],
    rows: int | None = None,
) -> Call:
    """A function that is compiled already, such as a reader of a kernel, as such a callable: see `CompiledFunction`.

    :param address: of the machine code of a function of the addresses of the time, of the arrays, and of its output.
    :param owner: an object that lives as long as the machine code.
    :param size: of the output.
    """
    code = _by_address(len(arrays))
    return _bound(code, clock, arrays, np.empty(size), shape, rows, address, owner)


def _bound(
    code: MachineCode,
    clock: Clock,
    arrays: Sequence[NDArray[np.float64]],
    out: NDArray[np.float64],
    shape: tuple[int, ...],
    rows: int | None,
    address: int = 0,
    owner: object = None,
) -> Call:
    time = np.empty(1)
    addresses = [*(array.ctypes.data for array in (*clock, time, *arrays, out)), address]
    copy = out.reshape(shape)[:rows].copy
    keep_alive = (code, owner, *clock, time, *arrays, out)
    return cast(Call, callable_of(code.address("read"), copy, addresses, keep_alive, "read()"))


@functools.cache
def _by_address(arrays: int) -> MachineCode:
    """The call of a function whose address is given, for a number of arrays besides the time and the output."""
    module = new_module()
    _emit_read(module, arrays)
    return compile_module(module)


def _emit_read(module: Module, arrays: int, function: Function | None = None) -> None:
    """Emit `PyObject* read(PyObject* self, PyObject** arguments, Py_ssize_t count, PyObject* names)`.

    It writes the time, calls the function, and returns what the second entry of `self` returns. The first entry is a
    bytes object with the addresses of the step counter, the step size, the time, the other arguments, and the output,
    and, if none is given here, of the function.
    """
    python, null = linked(module), Value(POINTER, "null")
    read = Function(module, FunctionType(POINTER, [POINTER, POINTER, INT, POINTER]), "read")
    own = read.args[0]
    b = IRBuilder(read.append_basic_block("entry"))
    table = b.call(python["PyBytes_AsString"], [b.call(python["PyTuple_GetItem"], [own, integer(0)])])
    counter, step_size, *pointers = (b.load(element(b, table, index), typ=POINTER) for index in range(arrays + 4))
    steps = b.sitofp(b.load(counter, typ=INT), DOUBLE)
    b.store(b.fmul(steps, b.load(step_size, typ=DOUBLE)), pointers[0])
    if function is None:
        b.call_address(b.load(element(b, table, arrays + 4), typ=POINTER), pointers)
    else:
        b.call(function, pointers)
    copy = b.call(python["PyTuple_GetItem"], [own, integer(1)])
    b.ret(b.call(python["PyObject_Vectorcall"], [copy, null, integer(0), null]))
