"""Instruction lists as C99 functions: one statement for each instruction, with the bits of the compiled kernel.

The statements are those of `mbd_sim.compiler.lists.lowering`: fused multiply-adds are calls of `fma`, and divisions by
the same number share a reciprocal. Sine and cosine come from the C function `sine_cosine`, whose text is here too: it
has the same operations as `mbd_sim.compiler.ir.trigonometry` and so the same bits.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import casadi as ca

from mbd_sim.compiler.ir import trigonometry as t
from mbd_sim.compiler.lists.instruction_list import (
    MULTIPLY_ADD,
    MULTIPLY_SUBTRACT,
    SUBTRACT_PRODUCT,
    Instructions,
    instructions_of,
)
from mbd_sim.compiler.lists.lowering import LIBRARY, shared_divisions

_EXPRESSIONS: Mapping[int, str] = {
    ca.OP_NEG: "-{0}",
    ca.OP_SQ: "{0} * {0}",
    ca.OP_TWICE: "{0} + {0}",
    ca.OP_INV: "1.0 / {0}",
    ca.OP_SQRT: "sqrt({0})",
    ca.OP_FABS: "fabs({0})",
    ca.OP_SIGN: "{0} != {0} ? {0} : (double)({0} > 0.0) - (double)({0} < 0.0)",
    ca.OP_FLOOR: "floor({0})",
    ca.OP_NOT: "{0} == 0.0 ? 1.0 : 0.0",
    ca.OP_ADD: "{0} + {1}",
    ca.OP_SUB: "{0} - {1}",
    ca.OP_MUL: "{0} * {1}",
    ca.OP_DIV: "{0} / {1}",
    ca.OP_FMIN: "{0} < {1} ? {0} : {1}",
    ca.OP_FMAX: "{0} > {1} ? {0} : {1}",
    ca.OP_LT: "{0} < {1} ? 1.0 : 0.0",
    ca.OP_LE: "{0} <= {1} ? 1.0 : 0.0",
    ca.OP_EQ: "{0} == {1} ? 1.0 : 0.0",
    ca.OP_NE: "{0} != {1} ? 1.0 : 0.0",
    ca.OP_IF_ELSE_ZERO: "{0} != 0.0 ? {1} : 0.0",
    MULTIPLY_ADD: "fma({0}, {1}, {2})",
    MULTIPLY_SUBTRACT: "fma({0}, {1}, -{2})",
    SUBTRACT_PRODUCT: "fma(-{0}, {1}, {2})",
    **{
        operation: f"{name}({{0}}, {{1}})" if name in ("pow", "atan2") else f"{name}({{0}})"
        for operation, name in LIBRARY.items()
    },
}


def literal(value: float) -> str:
    """A double as C writes it, exactly; negative ones in parentheses."""
    if math.isnan(value):
        return "NAN"
    if math.isinf(value):
        return "INFINITY" if value > 0.0 else "(-INFINITY)"
    text = repr(float(value))
    return text if math.copysign(1.0, value) > 0.0 else f"({text})"


def c_function(
    function: Instructions, name: str, arguments: Sequence[str], results: Sequence[str], scalars: Sequence[str] = ()
) -> str:
    """A static C function of arrays, whose `results` must not overlap its `arguments`.

    :param scalars: those of the arguments that are single numbers, passed by value.
    :raises NotImplementedError: the function has an operation that kernels do not support either.
    """
    declared = [
        f"double {argument}" if argument in scalars else f"const double *restrict {argument}" for argument in arguments
    ]
    declared += [f"double *restrict {result}" for result in results]
    body = _Statements(arguments, results, scalars)
    body.write(function)
    unused = [f"    (void){name};" for name in (*arguments, *results) if name not in body.used]
    return "\n".join([f"static void {name}({', '.join(declared)})", "{", *unused, *body.lines, "}"])


class _Statements:
    """The statements of a function; equal sines, cosines and reciprocals are computed once."""

    def __init__(self, arguments: Sequence[str], results: Sequence[str], scalars: Sequence[str]) -> None:
        self.lines: list[str] = []
        self.used: set[str] = set()
        self._arguments, self._results, self._scalars = arguments, results, scalars
        self._count = 0
        self._angles: dict[str, int] = {}
        self._reciprocals: dict[str, str] = {}

    def write(self, function: Instructions) -> None:
        """Write all instructions of a function."""
        instructions = instructions_of(function)
        by_reciprocal = shared_divisions(instructions)
        work: dict[int, str] = {}
        for index, (operation, source, target, value) in enumerate(instructions):
            if operation == ca.OP_INPUT:
                work[target[0]] = self._argument(source[0], source[1])
            elif operation == ca.OP_OUTPUT:
                self.used.add(result := self._results[target[0]])
                self.lines.append(f"    {result}[{target[1]}] = {work[source[0]]};")
            elif operation == ca.OP_CONST:
                work[target[0]] = literal(value)
            elif operation == ca.OP_ASSIGN:
                work[target[0]] = work[source[0]]
            elif operation in (ca.OP_SIN, ca.OP_COS):
                work[target[0]] = self._sine_cosine(work[source[0]], operation == ca.OP_SIN)
            elif index in by_reciprocal:
                inverse = self._reciprocal(work[source[-1]])
                inverted = operation == ca.OP_INV
                work[target[0]] = inverse if inverted else self._new(f"{work[source[0]]} * {inverse}")
            elif operation in _EXPRESSIONS:
                work[target[0]] = self._new(_EXPRESSIONS[operation].format(*(work[operand] for operand in source)))
            else:
                raise NotImplementedError(f"no C expression for CasADi operation {operation}")

    def _argument(self, number: int, component: int) -> str:
        name = self._arguments[number]
        self.used.add(name)
        return name if name in self._scalars else f"{name}[{component}]"

    def _new(self, expression: str) -> str:
        name = f"v{self._count}"
        self._count += 1
        self.lines.append(f"    const double {name} = {expression};")
        return name

    def _sine_cosine(self, angle: str, is_sine: bool) -> str:
        if angle not in self._angles:
            number = self._angles[angle] = len(self._angles)
            self.lines.append(f"    double s{number}, c{number};")
            self.lines.append(f"    sine_cosine({angle}, &s{number}, &c{number});")
        return f"{'s' if is_sine else 'c'}{self._angles[angle]}"

    def _reciprocal(self, divisor: str) -> str:
        if divisor not in self._reciprocals:
            self._reciprocals[divisor] = self._new(f"1.0 / {divisor}")
        return self._reciprocals[divisor]


_TEXT = """\
/*
 * Sine and cosine of an angle in rad. Polynomials and reduction are those of FDLIBM (Sun Microsystems, k_sin.c,
 * k_cos.c, e_rem_pio2.c), with fused multiply-adds; the error is below 0.8 units in the last place. The C library is
 * called only for angles beyond {LARGEST} rad.
 */
static void sine_cosine(double x, double *sine, double *cosine)
{{
    double quarters, head, second, tail, r, lost, rest, z, w, half, first, s, c, swapped;
    int64_t quadrant;

    if (!(fabs(x) < {LARGEST})) {{
        *sine = sin(x);
        *cosine = cos(x);
        return;
    }}
    /* x = quarters * pi/2 + r - rest: adding 1.5 * 2^52 rounds to the nearest integer. */
    quarters = fma(x, {TWO_OVER_PI}, {ROUNDER}) - {ROUNDER};
    quadrant = (int64_t)quarters;
    head = fma(quarters, -{HALF_PI}, x);
    second = quarters * {HALF_PI_NEXT};
    tail = fma(quarters, {HALF_PI_TAIL}, second);
    r = head - tail;
    lost = fma(quarters, {HALF_PI_TAIL}, second - tail);
    rest = fma(quarters, {HALF_PI_LAST}, lost) - ((head - r) - tail);

    z = r * r;
    w = z * z;
    half = -0.5 * z;
    s = fma(w, fma(w, fma(z, {s5}, {s4}), fma(z, {s3}, {s2})), fma(z, {s1}, {s0}));
    s = r - fma(z * r, s, fma(half, rest, rest));
    c = fma(w, fma(w, fma(z, {c5}, {c4}), fma(z, {c3}, {c2})), fma(z, {c1}, {c0}));
    first = fma(-0.5, z, 1.0);
    c = first + fma(w, c, fma(r, rest, fma(-0.5, z, 1.0 - first)));

    if (quadrant & 1) {{
        swapped = s;
        s = c;
        c = swapped;
    }}
    *sine = quadrant & 2 ? -s : s;
    *cosine = (quadrant + 1) & 2 ? -c : c;
}}
"""


def sine_cosine_text() -> str:
    """The definition of `static void sine_cosine(double x, double *sine, double *cosine)`."""
    names = ("LARGEST", "TWO_OVER_PI", "ROUNDER", "HALF_PI", "HALF_PI_NEXT", "HALF_PI_TAIL", "HALF_PI_LAST")
    values = {name: repr(vars(t)[name]) for name in names}
    for letter, coefficients in (("s", t.SINE), ("c", t.COSINE)):
        values |= {f"{letter}{index}": repr(value) for index, value in enumerate(coefficients)}
    return _TEXT.format(**values)
