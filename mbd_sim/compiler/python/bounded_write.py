"""Numbers from Python objects, checked and written by machine code: see `mbd_sim.compiler.python.step_call`."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from mbd_sim.compiler.code.host_module import compile_module, new_module
from mbd_sim.compiler.code.machine_code import NONE, MachineCode
from mbd_sim.compiler.ir.builder import DOUBLE, INT, IRBuilder, element, integer, number
from mbd_sim.compiler.ir.module import POINTER, Function, FunctionType, Value
from mbd_sim.compiler.ir.vectors import load, loop, store
from mbd_sim.compiler.python import bound_kernel
from mbd_sim.compiler.python.bound_kernel import TYPE, callable_of
from mbd_sim.compiler.python.step_call import linked

Write = Callable[..., None]

_TYPES = (np.ndarray, list, tuple, float)


def bounded_writer(
    target: NDArray[np.float64],
    bounds: NDArray[np.float64],
    reserved: NDArray[np.int64],
    fallback: Write,
    signature: str,
    view: type[np.ndarray[Any, Any]] = np.ndarray,
) -> Write:
    """A function of one argument, which writes its n numbers to `target` (n,), each clamped to ± its bound.

    It takes an array (n,) of doubles or singles with any strides, and a list or a tuple of n objects `float`, if all
    numbers are finite. With any other arguments it writes nothing, but calls `fallback` with them. Of subclasses of
    arrays, which may hide some of their numbers, it takes `view` alone.

    :param bounds: (n,), not negative; each call reads them.
    :param reserved: (1,); where it is not 0, each call is one of the fallback.
    :param signature: of the function, such as `write(numbers)`; its docstring is that of the fallback.
    """
    arrays = reserved, bounds, np.empty_like(target), target
    addresses = [len(target), *(array.ctypes.data for array in arrays), *map(id, _TYPES), id(view)]
    code = _code()
    write = callable_of(code.address("write"), fallback, addresses, (code, arrays, view), signature, fallback.__doc__)
    return cast(Write, write)


@functools.cache
def _code() -> MachineCode:
    module = new_module()
    call = Function(module, FunctionType(POINTER, [POINTER, POINTER, INT, POINTER]), "write")
    _Emitter(call).emit(module.external(NONE, "i8"))
    return compile_module(module)


class _Emitter:
    """Emits `PyObject* write(PyObject* self, PyObject** arguments, Py_ssize_t count, PyObject* names)`.

    The first entry of `self` is a bytes object with n, the addresses of `reserved`, of the bounds, of memory for the
    checked numbers and of the target, and those of the types, with `view` as the last; the second one is the fallback.
    """

    def __init__(self, call: Function) -> None:
        self._call, self._python = call, linked(call.module)
        self._b = IRBuilder(call.append_basic_block("entry"))
        self._other, self._store = (call.append_basic_block(name) for name in ("other", "store"))

    def emit(self, none: Value) -> None:
        """The whole function; `none` is the address of Python's None."""
        b = self._b
        own, arguments, count, names = self._call.args
        table = b.call(self._python["PyBytes_AsString"], [b.call(self._python["PyTuple_GetItem"], [own, integer(0)])])
        self._size = b.load(table, typ=INT)
        reserved, self._bounds, self._checked, target, *types = (
            b.load(element(b, table, index), typ=POINTER) for index in range(1, 6 + len(_TYPES))
        )
        self._require(b.icmp_unsigned("==", names, Value(POINTER, "null")))
        self._require(b.icmp_unsigned("==", count, integer(1)))
        self._require(b.icmp_unsigned("==", b.load(reserved, typ=INT), integer(0)))
        given = b.load(arguments, typ=POINTER)
        kind, (array, *sequences, self._float, view) = self._type_of(given), types
        with b.if_then(b.or_(b.icmp_unsigned("==", kind, array), b.icmp_unsigned("==", kind, view))):
            self._read_array(given)
        for name, type_ in zip(("PyList", "PyTuple"), sequences, strict=True):
            with b.if_then(b.icmp_unsigned("==", kind, type_)):
                self._read_sequence(name, given)
        b.branch(self._other)

        b.position_at_end(self._store)
        loop(b, 0, self._size, lambda i: store(b, load(b, self._checked, i), target, i))
        b.call(self._python["Py_IncRef"], [none])
        b.ret(none)

        b.position_at_end(self._other)
        fallback = b.call(self._python["PyTuple_GetItem"], [own, integer(1)])
        b.ret(b.call(self._python["PyObject_Vectorcall"], [fallback, arguments, count, names]))

    def _require(self, condition: Value) -> None:
        """Leave the rest to the fallback unless a condition holds."""
        b = self._b
        with b.if_then(b.not_(condition), likely=False):
            b.branch(self._other)

    def _read_array(self, given: Value) -> None:
        b = self._b
        self._require(b.icmp_unsigned("==", self._field(given, bound_kernel.DIMENSIONS, "i32"), Value("i32", "1")))
        lengths, strides, dtype = (
            self._field(given, offset, POINTER)
            for offset in (bound_kernel.LENGTHS, bound_kernel.STRIDES, bound_kernel.DTYPE)
        )
        self._require(b.icmp_unsigned("==", b.load(lengths, typ=INT), self._size))
        aligned = b.and_(self._field(given, bound_kernel.FLAGS, "i32"), Value("i32", str(bound_kernel.ALIGNED)))
        self._require(b.icmp_unsigned("!=", aligned, Value("i32", "0")))
        order = self._field(dtype, bound_kernel.BYTE_ORDER, "i8")
        self._require(b.icmp_unsigned("==", order, Value("i8", str(bound_kernel.NATIVE))))
        data, stride = self._field(given, bound_kernel.DATA, POINTER), b.load(strides, typ=INT)
        number_type = self._field(dtype, bound_kernel.TYPE_NUMBER, "i32")

        def entry(i: Value, type_: str) -> Value:
            return b.load(b.gep(data, b.mul(i, stride), "i8"), typ=type_)

        with b.if_then(b.icmp_unsigned("==", number_type, Value("i32", str(bound_kernel.DOUBLE)))):
            self._check(lambda i: entry(i, DOUBLE))
        self._require(b.icmp_unsigned("==", number_type, Value("i32", str(bound_kernel.SINGLE))))
        self._check(lambda i: b.convert("fpext", entry(i, "float"), DOUBLE))

    def _read_sequence(self, name: str, given: Value) -> None:
        b = self._b
        declared = b.module.declared
        size_of, item_of = (
            declared(f"{name}_Size", INT, [POINTER]),
            declared(f"{name}_GetItem", POINTER, [POINTER, INT]),
        )
        number_of = declared("PyFloat_AsDouble", DOUBLE, [POINTER])
        self._require(b.icmp_unsigned("==", b.call(size_of, [given]), self._size))

        def entry(i: Value) -> Value:
            item = b.call(item_of, [given, i])
            self._require(b.icmp_unsigned("==", self._type_of(item), self._float))
            return b.call(number_of, [item])

        self._check(entry)

    def _check(self, entry: Callable[[Value], Value]) -> None:
        """Check and clamp all numbers, and go on to store them."""
        b = self._b

        def check(i: Value) -> None:
            value, bound = entry(i), load(b, self._bounds, i)
            size = b.intrinsic("llvm.fabs", value)
            self._require(b.fcmp_ordered("<", size, number(math.inf)))
            clamped = b.select(b.fcmp_ordered("<", size, bound), size, bound)
            store(b, b.intrinsic("llvm.copysign", clamped, value), self._checked, i)

        loop(b, 0, self._size, check)
        b.branch(self._store)

    def _type_of(self, thing: Value) -> Value:
        return self._field(thing, TYPE, POINTER)

    def _field(self, thing: Value, offset: int, type_: str) -> Value:
        return self._b.load(self._b.gep(thing, integer(offset), "i8"), typ=type_)
