"""Sine and cosine together, as inlined IR.

The polynomials and the reduction are those of FDLIBM (Sun Microsystems, k_sin.c, k_cos.c, e_rem_pio2.c), written with
fused multiply-adds and with pi/2 to 172 bits. The error is below 0.8 units in the last place for |x| < 1.6e6 rad;
beyond, the C library is called. One reduction serves both values, and every machine gets the same bits, which C
libraries do not promise.
"""

from __future__ import annotations

from collections.abc import Sequence

from mbd_sim.compiler.ir.builder import DOUBLE, INT, IRBuilder, integer, number
from mbd_sim.compiler.ir.lanes import LaneBuilder, lanes_of, new_builder
from mbd_sim.compiler.ir.module import ALWAYS_INLINE, BOOL, Function, FunctionType, Module, Value, undefined, vector_of

LARGEST = 2.0**20 * 1.5707963267948966
TWO_OVER_PI = 6.36619772367581382433e-01
ROUNDER = 6755399441055744.0  # 1.5 * 2**52: adding it rounds to the nearest integer, which is then in the low bits
HALF_PI = 1.57079632673412561417e00  # the first 33 bits of pi/2
HALF_PI_NEXT = 6.07710050630396597660e-11  # the next 33 bits
HALF_PI_TAIL = 2.02226624879595063154e-21  # the next 53 bits
HALF_PI_LAST = 1.0085854035872483e-37  # and the next 53
SINE = (
    1.66666666666666324348e-01,
    -8.33333333332248946124e-03,
    1.98412698298579493134e-04,
    -2.75573137070700676789e-06,
    2.50507602534068634195e-08,
    -1.58969099521155010221e-10,
)
COSINE = (
    4.16666666666666019037e-02,
    -1.38888888888741095749e-03,
    2.48015872894767294178e-05,
    -2.75573143513906633035e-07,
    2.08757232129817482790e-09,
    -1.13596475577881948265e-11,
)


def sine_cosine(module: Module, builder: IRBuilder, angle: Value, inline: bool = True) -> tuple[Value, Value]:
    """The sine and the cosine of `angle` in rad; inlined code takes less time to run, but more to compile."""
    if isinstance(builder, LaneBuilder):
        angle = builder.widened(angle)
    pair = builder.call(_function(module, lanes_of(builder), inline and module.fast), [angle])
    return builder.extract_value(pair, 0, angle.type), builder.extract_value(pair, 1, angle.type)


def _function(module: Module, lanes: int, inline: bool) -> Function:
    name = "sine_cosine" if lanes == 1 else f"sine_cosine.{lanes}"
    if module.fast and not inline:
        name += ".called"
    if name in module.functions:
        return module.functions[name]
    real = DOUBLE if lanes == 1 else vector_of(DOUBLE, lanes)
    pair = f"{{{real}, {real}}}"
    function = Function(module, FunctionType(pair, [real]), name)
    function.linkage = "internal"
    function.attributes = [ALWAYS_INLINE if inline else "noinline", "nounwind"]
    b = new_builder(function.append_basic_block("entry"), lanes)
    x = function.args[0]
    common, rare = function.append_basic_block("common"), function.append_basic_block("rare")
    size = b.intrinsic("llvm.fabs", x)
    if isinstance(b, LaneBuilder):
        is_rare = b.any_lane(b.fcmp_unordered(">=", size, number(LARGEST)))
        b.cbranch(is_rare, rare, common, weights=(1, 1_000_000))
    else:
        b.cbranch(b.fcmp_ordered("<", size, number(LARGEST)), common, rare, weights=(1_000_000, 1))

    b.position_at_end(rare)
    values = _one_by_one(module, b, x) if isinstance(b, LaneBuilder) else _by_library(module, b, x)
    b.ret(b.insert_value(b.insert_value(undefined(pair), values[0], 0), values[1], 1))

    b.position_at_end(common)
    shifted = b.fma(x, number(TWO_OVER_PI), number(ROUNDER))
    quarters = b.fsub(shifted, number(ROUNDER))
    quadrant = b.bitcast(shifted, INT)
    head = b.fma(quarters, number(-HALF_PI), x)  # exact, like `second`
    second = b.fmul(quarters, number(HALF_PI_NEXT))
    tail = b.fma(quarters, number(HALF_PI_TAIL), second)
    r = b.fsub(head, tail)
    lost = b.fma(quarters, number(HALF_PI_TAIL), b.fsub(second, tail))
    low = b.fma(quarters, number(HALF_PI_LAST), lost)
    rest = b.fsub(low, b.fsub(b.fsub(head, r), tail))
    sine, cosine = _kernel_sine(b, r, rest), _kernel_cosine(b, r, rest)
    swap = b.trunc(quadrant, BOOL)
    sine, cosine = b.select(swap, cosine, sine), b.select(swap, sine, cosine)
    sine = _flip(b, sine, quadrant)
    cosine = _flip(b, cosine, b.add(quadrant, integer(1)))
    b.ret(b.insert_value(b.insert_value(undefined(pair), sine, 0), cosine, 1))
    return function


def _by_library(module: Module, b: IRBuilder, x: Value) -> list[Value]:
    return [b.call(module.declared(name, DOUBLE, [DOUBLE]), [x]) for name in ("sin", "cos")]


def _one_by_one(module: Module, b: LaneBuilder, x: Value) -> list[Value]:
    scalar = _function(module, 1, module.fast)
    pairs = [b.call(scalar, [b.lane(x, index)], inline=False) for index in range(b.lanes)]
    return [b.gathered([b.extract_value(pair, index, DOUBLE) for pair in pairs]) for index in (0, 1)]


def _flip(b: IRBuilder, value: Value, quadrant: Value) -> Value:
    """The value with its sign changed if bit 1 of `quadrant` is set."""
    sign = b.shl(b.and_(quadrant, integer(2)), integer(62))
    return b.bitcast(b.xor(b.bitcast(value, INT), sign), DOUBLE)


def _polynomial(b: IRBuilder, z: Value, w: Value, coefficients: Sequence[float]) -> Value:
    """The polynomial of six coefficients at z, with w = z², in pairs: a third of the time of Horner's scheme."""
    low, middle, high = (
        b.fma(z, number(odd), number(even)) for even, odd in zip(coefficients[::2], coefficients[1::2], strict=True)
    )
    return b.fma(w, b.fma(w, high, middle), low)


def _kernel_sine(b: IRBuilder, x: Value, y: Value) -> Value:
    """sin(x − y) = x − (x³ P(x²) + y (1 − x²/2))."""
    z = b.fmul(x, x)
    w = b.fmul(z, z)
    rest = b.fma(b.fmul(number(-0.5), z), y, y)
    return b.fsub(x, b.fma(b.fmul(z, x), _polynomial(b, z, w, SINE), rest))


def _kernel_cosine(b: IRBuilder, x: Value, y: Value) -> Value:
    """cos(x − y) = (1 − x²/2) + (x⁴ P(x²) + x y), plus the rounding error of the first bracket."""
    z = b.fmul(x, x)
    w = b.fmul(z, z)
    one = b.fma(number(-0.5), z, number(1.0))
    lost = b.fma(number(-0.5), z, b.fsub(number(1.0), one))
    return b.fadd(one, b.fma(w, _polynomial(b, z, w, COSINE), b.fma(x, y, lost)))
