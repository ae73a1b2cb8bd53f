"""Sine and cosine together, as inlined IR.

The polynomials and the reduction are those of FDLIBM (Sun Microsystems, k_sin.c, k_cos.c, e_rem_pio2.c), exact for
|x| < 1.6e6 rad to 0.8 units in the last place, and to 1.1 next to multiples of pi/2; beyond, the C library is called.
One reduction serves both values, and every machine gets the same bits, which its C library would not promise.
"""

from __future__ import annotations

import llvmlite.ir as ir

from mbd_sim.compiler.lanes import LaneBuilder, lanes_of, new_builder
from mbd_sim.compiler.types import DOUBLE, INT, integer, number

_LARGEST = 2.0**20 * 1.5707963267948966
_TWO_OVER_PI = 6.36619772367581382433e-01
_ROUNDER = 6755399441055744.0  # 1.5 * 2**52: adding it rounds to the nearest integer, which its low bits then hold
_HALF_PI = 1.57079632673412561417e00  # the first 33 bits of pi/2
_HALF_PI_NEXT = 6.07710050630396597660e-11  # the next 33 bits
_HALF_PI_TAIL = 2.02226624879595063154e-21  # the next 53 bits
_SINE = (
    -1.66666666666666324348e-01,
    8.33333333332248946124e-03,
    -1.98412698298579493134e-04,
    2.75573137070700676789e-06,
    -2.50507602534068634195e-08,
    1.58969099521155010221e-10,
)
_COSINE = (
    4.16666666666666019037e-02,
    -1.38888888888741095749e-03,
    2.48015872894767294178e-05,
    -2.75573143513906633035e-07,
    2.08757232129817482790e-09,
    -1.13596475577881948265e-11,
)


def sine_cosine(module: ir.Module, builder: ir.IRBuilder, angle: ir.Value) -> tuple[ir.Value, ir.Value]:
    """The sine and the cosine of `angle` in rad."""
    if isinstance(builder, LaneBuilder):
        angle = builder.widened(angle)
    pair = builder.call(_function(module, lanes_of(builder)), [angle])
    return builder.extract_value(pair, 0), builder.extract_value(pair, 1)


def _function(module: ir.Module, lanes: int) -> ir.Function:
    name = "sine_cosine" if lanes == 1 else f"sine_cosine.{lanes}"
    if name in module.globals:
        return module.get_global(name)
    real = DOUBLE if lanes == 1 else ir.VectorType(DOUBLE, lanes)
    pair = ir.LiteralStructType([real, real])
    function = ir.Function(module, ir.FunctionType(pair, [real]), name)
    function.linkage = "internal"
    function.attributes.add("alwaysinline")
    function.attributes.add("nounwind")
    b = new_builder(function.append_basic_block("entry"), lanes)
    x = function.args[0]
    common, rare = function.append_basic_block("common"), function.append_basic_block("rare")
    size = b.call(module.declare_intrinsic("llvm.fabs", [DOUBLE]), [x])
    if isinstance(b, LaneBuilder):
        branch = b.cbranch(b.any_lane(b.fcmp_unordered(">=", size, number(_LARGEST))), rare, common)
        branch.set_weights([1, 1_000_000])
    else:
        branch = b.cbranch(b.fcmp_ordered("<", size, number(_LARGEST)), common, rare)
        branch.set_weights([1_000_000, 1])

    b.position_at_end(rare)
    values = _one_by_one(module, b, x) if isinstance(b, LaneBuilder) else _by_library(module, b, x)
    b.ret(b.insert_value(b.insert_value(ir.Constant(pair, ir.Undefined), values[0], 0), values[1], 1))

    b.position_at_end(common)
    shifted = b.fadd(b.fmul(x, number(_TWO_OVER_PI)), number(_ROUNDER))
    quarters = b.fsub(shifted, number(_ROUNDER))
    quadrant = b.bitcast(shifted, INT)
    head = b.fsub(x, b.fmul(quarters, number(_HALF_PI)))
    second, third = b.fmul(quarters, number(_HALF_PI_NEXT)), b.fmul(quarters, number(_HALF_PI_TAIL))
    tail = b.fadd(second, third)
    r = b.fsub(head, tail)
    rest = b.fsub(b.fsub(b.fsub(head, r), tail), b.fadd(b.fsub(second, tail), third))
    sine, cosine = _kernel_sine(b, r, rest), _kernel_cosine(b, r, rest)
    swap = b.trunc(quadrant, ir.IntType(1))
    sine, cosine = b.select(swap, cosine, sine), b.select(swap, sine, cosine)
    sine = _flip(b, sine, quadrant)
    cosine = _flip(b, cosine, b.add(quadrant, integer(1)))
    b.ret(b.insert_value(b.insert_value(ir.Constant(pair, ir.Undefined), sine, 0), cosine, 1))
    return function


def _by_library(module: ir.Module, b: ir.IRBuilder, x: ir.Value) -> list[ir.Value]:
    signature = ir.FunctionType(DOUBLE, [DOUBLE])
    return [b.call(ir.Function(module, signature, name), [x]) for name in ("sin", "cos")]


def _one_by_one(module: ir.Module, b: LaneBuilder, x: ir.Value) -> list[ir.Value]:
    scalar = _function(module, 1)
    scalar.attributes.discard("alwaysinline")
    pairs = [b.call(scalar, [b.lane(x, index)]) for index in range(b.lanes)]
    return [b.gathered([b.extract_value(pair, place) for pair in pairs]) for place in (0, 1)]


def _flip(b: ir.IRBuilder, value: ir.Value, quadrant: ir.Value) -> ir.Value:
    """The value with its sign changed where bit 1 of `quadrant` is set."""
    sign = b.shl(b.and_(quadrant, integer(2)), integer(62))
    return b.bitcast(b.xor(b.bitcast(value, INT), sign), DOUBLE)


def _horner(b: ir.IRBuilder, z: ir.Value, *coefficients: float) -> ir.Value:
    value: ir.Value = number(coefficients[-1])
    for coefficient in reversed(coefficients[:-1]):
        value = b.fadd(number(coefficient), b.fmul(z, value))
    return value


def _kernel_sine(b: ir.IRBuilder, x: ir.Value, y: ir.Value) -> ir.Value:
    s1, s2, s3, s4, s5, s6 = _SINE
    z = b.fmul(x, x)
    w = b.fmul(z, z)
    r = b.fadd(_horner(b, z, s2, s3, s4), b.fmul(b.fmul(z, w), _horner(b, z, s5, s6)))
    v = b.fmul(z, x)
    inner = b.fsub(b.fmul(z, b.fsub(b.fmul(number(0.5), y), b.fmul(v, r))), y)
    return b.fsub(x, b.fsub(inner, b.fmul(v, number(s1))))


def _kernel_cosine(b: ir.IRBuilder, x: ir.Value, y: ir.Value) -> ir.Value:
    c1, c2, c3, c4, c5, c6 = _COSINE
    z = b.fmul(x, x)
    w = b.fmul(z, z)
    r = b.fadd(b.fmul(z, _horner(b, z, c1, c2, c3)), b.fmul(b.fmul(w, w), _horner(b, z, c4, c5, c6)))
    half = b.fmul(number(0.5), z)
    one = b.fsub(number(1.0), half)
    correction = b.fadd(b.fsub(b.fsub(number(1.0), one), half), b.fsub(b.fmul(z, r), b.fmul(x, y)))
    return b.fadd(one, correction)
