"""NumPy's C interface for machine code: where the fields of an array lie, and how a new one is made.

See https://numpy.org/doc/stable/reference/c-api/types-and-structures.html for `PyArrayObject` and `PyArray_Descr`, and
https://numpy.org/doc/stable/reference/c-api/array.html for `PyArray_New`.
"""

from __future__ import annotations

from mbd_sim.compiler.ir import POINTER, Value
from mbd_sim.compiler.ir_builder import IRBuilder
from mbd_sim.compiler.ir_types import integer
from mbd_sim.compiler.python_callable import HEAD

# Offsets of `PyArrayObject` and `PyArray_Descr` in bytes.
DATA, DIMENSIONS, LENGTHS, STRIDES, DTYPE, FLAGS = (HEAD + offset for offset in (0, 8, 16, 24, 40, 48))
BYTE_ORDER, TYPE_NUMBER = HEAD + 10, HEAD + 12

ALIGNED = 0x0100  # of the flags
NATIVE = ord("=")  # of the byte order
SINGLE, DOUBLE = 11, 12  # of the type number

_INT32 = "i32"


def emit_new_array(b: IRBuilder, dimensions: Value, lengths: Value, *, by_columns: bool = False) -> Value:
    """Emit the creation of an array of doubles with any contents, contiguous in C's or, `by_columns`, Fortran's order.

    :param dimensions: how many, as a 32-bit integer.
    :param lengths: the address of their lengths as 64-bit integers.
    :return: the address of the array; null if there is no memory for it.
    """
    double, zero, null = Value(_INT32, str(DOUBLE)), Value(_INT32, "0"), Value(POINTER, "null")
    types = [POINTER, _INT32, POINTER, _INT32, POINTER, POINTER, _INT32, _INT32, POINTER]
    kind = b.module.external("PyArray_Type", "i8")
    order = Value(_INT32, "1" if by_columns else "0")
    given = [kind, dimensions, lengths, double, null, null, zero, order, null]
    return b.call(b.module.declared("PyArray_New", POINTER, types), given)


def emit_data(b: IRBuilder, array: Value) -> Value:
    """Emit the reading of the address of an array's numbers."""
    return b.load(b.gep(array, integer(DATA), "i8"), typ=POINTER)
