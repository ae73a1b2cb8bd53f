"""Machine code with CPython's calling signature as Python callables, which read the fields of NumPy's arrays.

See https://numpy.org/doc/stable/reference/c-api/types-and-structures.html for `PyArrayObject` and `PyArray_Descr`,
which say where these fields are.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any

LARGEST = 2**53  # steps; beyond, time in steps is no longer exact
HEAD = object.__basicsize__  # bytes of the head of every object, `PyObject`
TYPE = HEAD - ctypes.sizeof(ctypes.c_void_p)  # offset of the address of its type
_FASTCALL_WITH_KEYWORDS = 0x0080 | 0x0002


class _MethodDefinition(ctypes.Structure):
    """CPython's `PyMethodDef`."""

    _fields_ = (
        ("name", ctypes.c_char_p),
        ("method", ctypes.c_void_p),
        ("flags", ctypes.c_int),
        ("doc", ctypes.c_char_p),
    )


def function_of_addresses(address: int, count: int) -> Any:
    """The machine code at an address as a Python function of `count` addresses, without a result."""
    return ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * count)(address)


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


# Offsets of `PyArrayObject` and `PyArray_Descr` in bytes.
DATA, DIMENSIONS, LENGTHS, STRIDES, DTYPE, FLAGS = (HEAD + offset for offset in (0, 8, 16, 24, 40, 48))
BYTE_ORDER, TYPE_NUMBER = HEAD + 10, HEAD + 12

ALIGNED = 0x0100  # of the flags
NATIVE = ord("=")  # of the byte order
SINGLE, DOUBLE = 11, 12  # of the type number
