"""A kernel as an ordinary Python callable: the machine code itself has CPython's calling signature.

A call through ctypes costs nearly 1 µs, more than the step itself; this call costs some 0.05 µs.
"""

from __future__ import annotations

import ctypes
import functools
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import llvmlite.binding as llvm

from mbd_sim.compiler.ir import POINTER, VOID, Block, Function, FunctionType, Module, Value
from mbd_sim.compiler.ir_builder import IRBuilder
from mbd_sim.compiler.ir_types import (
    DOUBLE,
    INT,
    element,
    integer,
)

LARGEST = 2**53  # steps; beyond, time in steps is no longer exact
RELEASING = 16  # steps from which the interpreter's lock is released; that costs as much as a call

_FASTCALL_WITH_KEYWORDS = 0x0080 | 0x0002
_NONE = "_Py_NoneStruct"
_USED = {
    "PyTuple_GetItem": FunctionType(POINTER, [POINTER, INT]),
    "PyBytes_AsString": FunctionType(POINTER, [POINTER]),
    "PyLong_AsLongLong": FunctionType(INT, [POINTER]),
    "PyErr_Occurred": FunctionType(POINTER, []),
    "PyErr_Clear": FunctionType(VOID, []),
    "PyObject_Vectorcall": FunctionType(POINTER, [POINTER, POINTER, INT, POINTER]),
    "PyEval_SaveThread": FunctionType(POINTER, []),
    "PyEval_RestoreThread": FunctionType(VOID, [POINTER]),
    "Py_IncRef": FunctionType(VOID, [POINTER]),
}


class _MethodDefinition(ctypes.Structure):
    """CPython's `PyMethodDef`."""

    _fields_ = (
        ("name", ctypes.c_char_p),
        ("method", ctypes.c_void_p),
        ("flags", ctypes.c_int),
        ("doc", ctypes.c_char_p),
    )


@functools.cache
def _link() -> None:
    """Register the addresses of the interpreter's functions with the compiler."""
    for name in _USED:
        llvm.add_symbol(name, ctypes.cast(getattr(ctypes.pythonapi, name), ctypes.c_void_p).value)
    llvm.add_symbol(_NONE, id(None))


def linked(module: Module) -> dict[str, Function]:
    """The interpreter's functions that machine code uses, declared in a module."""
    _link()
    return {name: Function(module, signature, name) for name, signature in _USED.items()}


def emit_call(module: Module, advance: Function, roles: Sequence[str]) -> Function:
    """Emit `PyObject* call(PyObject* self, PyObject** arguments, Py_ssize_t count, PyObject* names)`.

    It is `step(n=1)` for the usual case: it advances and adds n to the step counter. In any other case it calls the
    second entry of `self` with the same arguments, which raises the error.

    :param roles: of each argument of `advance`: "first", "h", "steps", or anything else for a pointer. The first entry
        of `self` is a bytes object with the addresses of the counter, of h, and of these pointers in order.
    """
    python = linked(module)
    none = module.external(_NONE, "i8")
    call = Function(module, FunctionType(POINTER, [POINTER, POINTER, INT, POINTER]), "call")
    own, arguments, count, names = call.args
    blocks = {name: call.append_basic_block(name) for name in ("entry", "given", "known", "doubtful", "run", "other")}
    b = IRBuilder(blocks["entry"])
    steps = _emit_step_count(b, python, call, blocks)
    b.branch(blocks["run"])

    b.position_at_end(blocks["run"])
    table = b.call(python["PyBytes_AsString"], [b.call(python["PyTuple_GetItem"], [own, integer(0)])])

    def address(index: int) -> Value:
        return b.load(element(b, table, index), typ=POINTER)

    counter = address(0)
    first = b.load(counter, typ=INT)
    values = {"first": first, "h": b.load(address(1), typ=DOUBLE), "steps": steps}
    pointers = iter(range(2, 2 + len(roles)))
    passed = [values[role] if role in values else address(next(pointers)) for role in roles]
    finite = _emit_advance(b, python, advance, passed, steps)
    with b.if_then(b.icmp_unsigned("!=", finite, integer(0)), likely=True):
        b.store(b.add(first, steps), counter)
        b.call(python["Py_IncRef"], [none])
        b.ret(none)
    b.branch(blocks["other"])

    b.position_at_end(blocks["other"])
    fallback = b.call(python["PyTuple_GetItem"], [own, integer(1)])
    b.ret(b.call(python["PyObject_Vectorcall"], [fallback, arguments, count, names]))
    return call


def _emit_step_count(
    b: IRBuilder, python: Mapping[str, Function], call: Function, blocks: Mapping[str, Block]
) -> Value:
    """Emit the reading of n, which is 1 without an argument; anything that is not a count goes to block `other`."""
    _, arguments, count, names = call.args
    null = Value(POINTER, "null")
    positional = b.and_(b.icmp_unsigned("==", names, null), b.icmp_unsigned("<=", count, integer(1)))
    with b.if_then(b.not_(positional), likely=False):
        b.branch(blocks["other"])
    b.cbranch(b.icmp_unsigned("==", count, integer(0)), blocks["known"], blocks["given"])
    without_argument = b.block

    b.position_at_end(blocks["given"])
    number = b.call(python["PyLong_AsLongLong"], [b.load(arguments, typ=POINTER)])
    in_range = b.icmp_unsigned("<=", number, integer(LARGEST))  # false for negative numbers, read as unsigned
    b.cbranch(in_range, blocks["known"], blocks["doubtful"])

    b.position_at_end(blocks["doubtful"])
    with b.if_then(b.icmp_unsigned("!=", b.call(python["PyErr_Occurred"], []), null)):
        b.call(python["PyErr_Clear"], [])
    b.branch(blocks["other"])

    b.position_at_end(blocks["known"])
    steps = b.phi(INT)
    steps.add_incoming(integer(1), without_argument)
    steps.add_incoming(number, blocks["given"])
    return steps


def _emit_advance(
    b: IRBuilder,
    python: Mapping[str, Function],
    advance: Function,
    passed: Sequence[Value],
    steps: Value,
) -> Value:
    """Emit the call of `advance`, without the interpreter's lock if there are many steps; returns its result."""
    with b.if_else(b.icmp_unsigned(">=", steps, integer(RELEASING))) as (many, few):
        with many:
            thread = b.call(python["PyEval_SaveThread"], [])
            result_unlocked = b.call(advance, passed)
            b.call(python["PyEval_RestoreThread"], [thread])
            end_unlocked = b.block
        with few:
            result_locked = b.call(advance, passed)
            end_locked = b.block
    result = b.phi(INT)
    result.add_incoming(result_unlocked, end_unlocked)
    result.add_incoming(result_locked, end_locked)
    return result


def callable_of(
    address: int, partner: Callable[..., Any], addresses: Sequence[int], keep_alive: object, name: bytes = b"step"
) -> Any:
    """The Python callable of an emitted `call`, or of a `read` of `mbd_sim.compiler.bound_call`, at an address.

    :param partner: the callable that the code calls: with the same arguments where a `call` cannot advance.
    :param addresses: of the step counter (int64), of the step size (double), and of the pointers that it passes on.
    :param keep_alive: an object that lives as long as the callable: it refers to the machine code and the arrays.
    """
    table = b"".join(value.to_bytes(8, "little") for value in addresses)
    definition = _MethodDefinition(name, address, _FASTCALL_WITH_KEYWORDS, None)
    create = ctypes.pythonapi.PyCFunction_NewEx
    create.restype, create.argtypes = ctypes.py_object, [ctypes.c_void_p, ctypes.py_object, ctypes.c_void_p]
    return create(ctypes.addressof(definition), (table, partner, definition, keep_alive), None)
