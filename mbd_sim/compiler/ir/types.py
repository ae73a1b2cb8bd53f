"""The LLVM types and idioms that all emitters share."""

from __future__ import annotations

import struct

from mbd_sim.compiler.ir.builder import IRBuilder
from mbd_sim.compiler.ir.module import BOOL, Value

DOUBLE, INT = "double", "i64"
FALSE = Value(BOOL, "false")

VECTOR = 32  # bytes, of four doubles


def number(value: float) -> Value:
    """A double."""
    return Value(DOUBLE, f"0x{struct.pack('>d', value).hex()}")


def integer(value: int) -> Value:
    """A 64-bit integer."""
    return Value(INT, str(value))


def element(builder: IRBuilder, array: Value, index: int | Value) -> Value:
    """The address of one double of an array."""
    return builder.gep(array, integer(index) if isinstance(index, int) else index, DOUBLE)


def local_array(
    builder: IRBuilder, size: int, *, in_registers: bool = False, aligned: bool = False, name: str = ""
) -> Value:
    """An array of doubles on the stack; only in the entry block of a function.

    LLVM keeps one `in_registers`, as far as they suffice, if all of its accesses have constant indices. Vectors of four
    in an `aligned` one lie in a line of the cache each.
    """
    if in_registers:
        return builder.alloca(f"[{max(size, 1)} x {DOUBLE}]")
    return builder.alloca(DOUBLE, integer(max(size, 1)), alignment=VECTOR if aligned else 0, name=name)
