"""Machine code with CPython's calling signature as Python callables, and the interpreter's functions that it calls."""

from __future__ import annotations

import ctypes
import functools
from collections.abc import Sequence
from typing import Any

import llvmlite.binding as llvm

LARGEST = 2**53  # steps; beyond, time in steps is no longer exact
NONE = "_Py_NoneStruct"
HEAD = object.__basicsize__  # bytes of the head of every object, `PyObject`
TYPE = HEAD - ctypes.sizeof(ctypes.c_void_p)  # offset of the address of its type
NAMES = (
    "PyTuple_GetItem",
    "PyBytes_AsString",
    "PyLong_AsLongLong",
    "PyErr_Occurred",
    "PyErr_Clear",
    "PyObject_Vectorcall",
    "PyEval_SaveThread",
    "PyEval_RestoreThread",
    "Py_IncRef",
    "Py_DecRef",
    "PyDict_New",
    "PyDict_SetItem",
    "PyList_Size",
    "PyList_GetItem",
    "PyTuple_Size",
    "PyFloat_AsDouble",
)

_FASTCALL_WITH_KEYWORDS = 0x0080 | 0x0002


class _MethodDefinition(ctypes.Structure):
    """CPython's `PyMethodDef`."""

    _fields_ = (
        ("name", ctypes.c_char_p),
        ("method", ctypes.c_void_p),
        ("flags", ctypes.c_int),
        ("doc", ctypes.c_char_p),
    )


@functools.cache
def link_interpreter() -> None:
    """Register the addresses of the interpreter's functions with the compiler."""
    for name in NAMES:
        llvm.add_symbol(name, ctypes.cast(getattr(ctypes.pythonapi, name), ctypes.c_void_p).value)
    llvm.add_symbol(NONE, id(None))


def callable_of(
    address: int,
    partner: object,
    addresses: Sequence[int],
    keep_alive: object,
    signature: str,
    doc: str | None = None,
) -> Any:
    """The Python callable of machine code at an address, see `emit_call`, `CompiledFunction` and `bounded_writer`.

    :param partner: what the code calls, if anything: with the same arguments where a `call` cannot advance.
    :param addresses: of the step counter (int64), of the step size (double), and of the pointers that it passes on.
    :param keep_alive: an object that lives as long as the callable: it refers to the machine code and the arrays.
    :param signature: of the callable, as `inspect` and `help` show it: `step(n=1)`, with its docstring.
    """
    table = b"".join(value.to_bytes(8, "little") for value in addresses)
    name, text = signature.partition("(")[0].encode(), f"{signature}\n--\n\n{doc or ''}".encode()
    definition = _MethodDefinition(name, address, _FASTCALL_WITH_KEYWORDS, text)
    create = ctypes.pythonapi.PyCFunction_NewEx
    create.restype, create.argtypes = ctypes.py_object, [ctypes.c_void_p, ctypes.py_object, ctypes.c_void_p]
    return create(ctypes.addressof(definition), (table, partner, definition, keep_alive), None)
