"""Evaluates instruction lists in numpy, one operation at a time."""

from __future__ import annotations

import math
from fractions import Fraction

import casadi as ca
import numpy as np

from mbd_sim.compiler.lists.instruction_list import MULTIPLY_ADD, MULTIPLY_SUBTRACT, SUBTRACT_PRODUCT, instructions_of
from mbd_sim.compiler.lists.lowering import shared_divisions


def fma(x, y, z):
    """x y + z rounded once."""
    if not all(map(math.isfinite, (x, y, z))) or 0.0 in (x, y, z):
        return np.float64(x) * np.float64(y) + np.float64(z)
    return np.float64(Fraction(float(x)) * Fraction(float(y)) + Fraction(float(z)))


UNARY = {
    ca.OP_ASSIGN: lambda x: x,
    ca.OP_NEG: lambda x: -x,
    ca.OP_SQ: lambda x: x * x,
    ca.OP_TWICE: lambda x: x + x,
    ca.OP_INV: lambda x: np.float64(1.0) / x,
    ca.OP_SQRT: np.sqrt,
    ca.OP_FABS: np.fabs,
    ca.OP_FLOOR: np.floor,
    ca.OP_SIGN: np.sign,
    ca.OP_NOT: lambda x: np.float64(x == 0.0),
}
BINARY = {
    ca.OP_ADD: lambda x, y: x + y,
    ca.OP_SUB: lambda x, y: x - y,
    ca.OP_MUL: lambda x, y: x * y,
    ca.OP_DIV: lambda x, y: x / y,
    ca.OP_FMIN: lambda x, y: x if x < y else y,
    ca.OP_FMAX: lambda x, y: x if x > y else y,
    ca.OP_LT: lambda x, y: np.float64(x < y),
    ca.OP_LE: lambda x, y: np.float64(x <= y),
    ca.OP_EQ: lambda x, y: np.float64(x == y),
    ca.OP_NE: lambda x, y: np.float64(x != y),
    ca.OP_IF_ELSE_ZERO: lambda x, y: y if x != 0.0 else np.float64(0.0),
}
# Python's own are those of the C library.
LIBRARY = {
    ca.OP_EXP: math.exp,
    ca.OP_LOG: math.log,
    ca.OP_TAN: math.tan,
    ca.OP_ASIN: math.asin,
    ca.OP_ACOS: math.acos,
    ca.OP_ATAN: math.atan,
    ca.OP_TANH: math.tanh,
    ca.OP_POW: math.pow,
    ca.OP_CONSTPOW: math.pow,
    ca.OP_ATAN2: math.atan2,
}
TERNARY = {
    MULTIPLY_ADD: fma,
    MULTIPLY_SUBTRACT: lambda x, y, z: fma(x, y, -z),
    SUBTRACT_PRODUCT: lambda x, y, z: fma(-x, y, z),
}


def interpret(function, sine_cosine, arguments):
    """An instruction list by numpy's scalars, one operation at a time: its first result."""
    work, found = [np.float64(0.0)] * function.sz_w(), {}
    by_reciprocal = shared_divisions(instructions_of(function))
    for index in range(function.n_instructions()):
        operation = function.instruction_id(index)
        target, source = function.instruction_output(index), function.instruction_input(index)
        if operation == ca.OP_INPUT:
            work[target[0]] = np.float64(arguments[source[0]][source[1]])
        elif operation == ca.OP_OUTPUT:
            found[tuple(target)] = work[source[0]]
        elif operation == ca.OP_CONST:
            work[target[0]] = np.float64(function.instruction_constant(index))
        elif operation in (ca.OP_SIN, ca.OP_COS):
            work[target[0]] = sine_cosine(work[source[0]])[int(operation == ca.OP_COS)]
        elif index in by_reciprocal:
            numerator, divisor = (1.0, work[source[0]]) if operation == ca.OP_INV else (work[p] for p in source)
            work[target[0]] = numerator * (np.float64(1.0) / divisor)
        elif operation in UNARY:
            work[target[0]] = UNARY[operation](work[source[0]])
        elif operation in TERNARY:
            work[target[0]] = np.float64(TERNARY[operation](*(work[place] for place in source)))
        elif operation in LIBRARY:
            work[target[0]] = np.float64(LIBRARY[operation](*(float(work[place]) for place in source)))
        else:
            work[target[0]] = BINARY[operation](work[source[0]], work[source[1]])
    return np.array([found.get((0, place), 0.0) for place in range(1 + max(place for _, place in found))])
