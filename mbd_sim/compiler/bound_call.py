"""Compiled functions of a running simulation as Python callables without arguments: see `mbd_sim.compiler.fastcall`.

Machine code evaluates the function and makes the arrays that it returns, or the records of arrays.
"""

from __future__ import annotations

import functools
import json
import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, NamedTuple, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from mbd_sim import disk_cache
from mbd_sim.compiler.fastcall import linked
from mbd_sim.compiler.host_module import compile_module, new_module
from mbd_sim.compiler.ir import BOOL, POINTER, VOID, Function, FunctionType, Module, Value
from mbd_sim.compiler.ir_builder import IRBuilder
from mbd_sim.compiler.ir_types import DOUBLE, FALSE, INT, element, integer, local_array
from mbd_sim.compiler.ir_vectors import loop
from mbd_sim.compiler.machine_code import MachineCode, load_code
from mbd_sim.compiler.numpy_interface import emit_data, emit_new_array
from mbd_sim.compiler.python_callable import callable_of
from mbd_sim.interrupts import interruptible_tracing

if TYPE_CHECKING:
    import casadi as ca

Clock = tuple[NDArray[np.int64], NDArray[np.float64]]
Call = Callable[[], NDArray[np.float64]]
Shape = tuple[int, ...]
Record = TypeVar("Record")

ALL = slice(None)
_NULL = Value(POINTER, "null")
_BYTES = 8  # of a double


class CompiledFunction(NamedTuple):
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
        from mbd_sim.compiler.lowering import export, lower  # with CasADi, which stored functions do not need

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
        out = np.empty(self.size)
        found = out.reshape(shape)[rows]
        lengths = np.array(found.shape, dtype=np.int64)
        rest = found.ndim, lengths.ctypes.data, found.ctypes.data, found.nbytes
        return cast(Call, self._callable(_array_code(len(arrays)), None, clock, arrays, out, rest, lengths))

    def bound_records(
        self,
        clock: Clock,
        arrays: Sequence[NDArray[np.float64]],
        names: tuple[str, ...],
        record: Callable[..., Record],
        fields: tuple[Shape, ...],
    ) -> Callable[[], dict[str, Record]]:
        """The same as a callable that returns new records by name.

        :param names: in the order in which the output has the numbers of the records.
        :param record: makes a record of its arrays.
        :param fields: the shapes of these arrays; each has the next numbers of the output, column by column.
        """
        size = np.array([self.size], dtype=np.int64)
        rest = size.ctypes.data, len(names), id(names)
        code = _record_code(len(arrays), fields)
        return cast(
            Callable[[], dict[str, Record]],
            self._callable(code, record, clock, arrays, np.empty(0), rest, (size, names)),
        )

    def _callable(
        self,
        code: MachineCode,
        partner: object,
        clock: Clock,
        arrays: Sequence[NDArray[np.float64]],
        out: NDArray[np.float64],
        rest: Sequence[int],
        keep_alive: object,
    ) -> object:
        """The function `read` of machine code, with `rest` at the end of its table."""
        given = [*clock, np.empty(1), *arrays, out]
        addresses = [*(array.ctypes.data for array in given), self.address, *rest]
        return callable_of(code.address("read"), partner, addresses, (code, self.owner, given, keep_alive), "read()")


@functools.cache
def _array_code(arrays: int) -> MachineCode:
    """The function `read` that returns a new array, for a number of arguments besides the time.

    The rest of its table: the number of dimensions, the address of their lengths, the address in the output of what is
    returned, and its bytes.
    """
    reading = _Reading(arrays, (INT, POINTER, POINTER, INT))
    b, (dimensions, lengths, found, size) = reading.b, reading.rest
    reading.evaluate(reading.out)
    array = emit_new_array(b, b.trunc(dimensions, "i32"), lengths)
    with b.if_then(b.icmp_unsigned("!=", array, _NULL), likely=True):
        _emit_copy(b, found, emit_data(b, array), size)
    b.ret(array)
    return compile_module(b.module)


@functools.cache
def _record_code(arrays: int, fields: tuple[Shape, ...]) -> MachineCode:
    """The function `read` that returns a dict of new records.

    They are made of a copy of the output, because making them runs Python, which may call the function again. The rest
    of its table: the address of the size of the output, the number of records, the tuple of their names.
    """
    reading = _Reading(arrays, (POINTER, INT, POINTER))
    b, (size, count, names), python = reading.b, reading.rest, reading.python
    add, release = _emit_add(b.module, fields), b.module.declared("Py_DecRef", VOID, [POINTER])
    output = emit_new_array(b, Value("i32", "1"), size)
    found = b.call(b.module.declared("PyDict_New", POINTER, []), [])
    with b.if_then(b.icmp_unsigned("==", output, _NULL), likely=False):
        b.call(release, [found])
        b.ret(_NULL)
    with b.if_then(b.icmp_unsigned("==", found, _NULL), likely=False):
        b.call(release, [output])
        b.ret(_NULL)
    numbers = emit_data(b, output)
    reading.evaluate(numbers)

    def add_record(i: Value) -> None:
        own_numbers = element(b, numbers, b.mul(i, integer(sum(map(math.prod, fields)))))
        name = b.call(python["PyTuple_GetItem"], [names, i])
        with b.if_then(b.not_(b.call(add, [found, name, reading.partner, own_numbers])), likely=False):
            b.call(release, [found])
            b.call(release, [output])
            b.ret(_NULL)

    loop(b, 0, count, add_record)
    b.call(release, [output])
    b.ret(found)
    return compile_module(b.module)


class _Reading:
    """The beginning of `PyObject* read(PyObject* self, PyObject** arguments, Py_ssize_t count, PyObject* names)`.

    The first entry of `self` is a bytes object with the addresses of the step counter, the step size, the time, the
    other arguments, the output and the function, and then the `rest`; the second one is the `partner`.
    """

    def __init__(self, arrays: int, rest: Sequence[str]) -> None:
        module = new_module()
        python = self.python = linked(module)
        read = Function(module, FunctionType(POINTER, [POINTER, POINTER, INT, POINTER]), "read")
        b = self.b = IRBuilder(read.append_basic_block("entry"))
        own = read.args[0]
        table = b.call(python["PyBytes_AsString"], [b.call(python["PyTuple_GetItem"], [own, integer(0)])])
        types = [POINTER] * (arrays + 5) + list(rest)
        counter, step_size, *entries = (b.load(element(b, table, i), typ=type_) for i, type_ in enumerate(types))
        self._given, (self.out, self._address), self.rest = (
            entries[: arrays + 1],
            entries[arrays + 1 : arrays + 3],
            entries[arrays + 3 :],
        )
        self.partner = b.call(python["PyTuple_GetItem"], [own, integer(1)])
        steps = b.sitofp(b.load(counter, typ=INT), DOUBLE)
        b.store(b.fmul(steps, b.load(step_size, typ=DOUBLE)), self._given[0])

    def evaluate(self, out: Value) -> None:
        """Emit the call of the function, with its output at an address."""
        self.b.call_address(self._address, [*self._given, out])


def _emit_add(module: Module, fields: tuple[Shape, ...]) -> Function:
    """Emit `bool add(dict, name, record, numbers)`: make a record and add it to a dict; false after an error."""
    add = Function(module, FunctionType(BOOL, [POINTER] * 4), "add")
    add.linkage = "internal"
    found, name, record, numbers = add.args
    release = module.declared("Py_DecRef", VOID, [POINTER])
    b = IRBuilder(add.append_basic_block("entry"))
    given = local_array(b, len(fields))
    made: list[Value] = []
    for index, shape in enumerate(fields):
        array = emit_new_array(
            b, Value("i32", str(len(shape))), module.table(f"lengths{index}", shape), by_columns=True
        )
        with b.if_then(b.icmp_unsigned("==", array, _NULL), likely=False):
            for earlier in made:
                b.call(release, [earlier])
            b.ret(FALSE)
        before = sum(map(math.prod, fields[:index]))
        _emit_copy(b, element(b, numbers, before), emit_data(b, array), integer(math.prod(shape) * _BYTES))
        b.store(array, element(b, given, index))
        made.append(array)
    one = b.call(module.functions["PyObject_Vectorcall"], [record, given, integer(len(fields)), _NULL])
    for array in made:
        b.call(release, [array])
    with b.if_then(b.icmp_unsigned("==", one, _NULL), likely=False):
        b.ret(FALSE)
    status = b.call(module.declared("PyDict_SetItem", "i32", [POINTER] * 3), [found, name, one])
    b.call(release, [one])
    b.ret(b.icmp_unsigned("==", status, Value("i32", "0")))
    return add


def _emit_copy(b: IRBuilder, source: Value, target: Value, size: Value) -> None:
    """Copy bytes."""
    move = b.module.declared("llvm.memcpy.p0.p0.i64", VOID, [POINTER, POINTER, INT, BOOL])
    b.call(move, [target, source, size, FALSE])
