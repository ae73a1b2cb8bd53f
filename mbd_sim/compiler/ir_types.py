"""The LLVM types and idioms that all emitters share."""

from __future__ import annotations

import llvmlite.ir as ir

DOUBLE = ir.DoubleType()
INT = ir.IntType(64)
POINTER = ir.PointerType()


def number(value: float) -> ir.Constant:
    """A double."""
    return ir.Constant(DOUBLE, float(value))


def integer(value: int) -> ir.Constant:
    """A 64-bit integer."""
    return ir.Constant(INT, value)


def element(builder: ir.IRBuilder, array: ir.Value, index: int | ir.Value) -> ir.Value:
    """The address of one double of an array."""
    offset = integer(index) if isinstance(index, int) else index
    return builder.gep(array, [offset], inbounds=True, source_etype=DOUBLE)


def local_array(builder: ir.IRBuilder, size: int) -> ir.Value:
    """An array of doubles on the stack; only in the entry block of a function."""
    return builder.alloca(DOUBLE, size=integer(max(size, 1)))
