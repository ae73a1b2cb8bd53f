"""The polynomial of an expansion as IR: its value, how long it holds, and its error.

The coefficients c (order + 1, n) of the state are in memory, each order after the other.
"""

from __future__ import annotations

import math

from mbd_sim.compiler.ir import Value
from mbd_sim.compiler.ir_types import DOUBLE, INT, integer, number
from mbd_sim.compiler.ir_vectors import Index, for_each, load, store
from mbd_sim.compiler.step_emitter import StepEmitter
from mbd_sim.integrators.taylor import Taylor

# The exponent of a double, and its mantissa as a fraction, as an integer: log2 x + BIAS in units of 1 / UNIT.
UNIT, BIAS = 2.0**52, 1023.0
SAFETY = 0.9375  # a power of two from its bits is too large by up to 6.2 %


class TaylorExpansion:
    """Emits the code that reads the coefficients of expansions, within the step of an emitter.

    `longest` and `estimate` are those of the coefficients that `measure` has read last.
    """

    def __init__(self, emitter: StepEmitter, method: Taylor) -> None:
        self._emitter, self._method, self._count = emitter, method, emitter.system.size
        self._norms = emitter.array(method.compared)

    def evaluate(self, coefficients: Value, tau: Value) -> None:
        """Set y to the polynomial at τ: even and odd orders apart, which takes half the time of Horner's scheme."""
        emitter, order, b = self._emitter, self._method.order, self._emitter.b
        square = b.fmul(tau, tau)

        def coefficient(k: int, i: Index) -> Value:
            place = k * self._count + i if isinstance(i, int) else b.add(integer(k * self._count), i)
            return load(b, coefficients, place)

        def component(i: Index) -> None:
            halves = []
            for last in (order - 1, order):
                value = coefficient(last, i)
                for k in range(last - 2, 0, -2):
                    value = b.fma(value, square, coefficient(k, i))
                halves.append(value)
            odd, even = halves if order % 2 == 0 else halves[::-1]
            change = b.fmul(b.fma(even, tau, odd), tau)
            store(b, b.fadd(coefficient(0, i), change), emitter.y, i)

        for_each(b, self._count, component)

    def measure(self, coefficients: Value) -> None:
        """Set the norms of the last coefficients, that of the highest order first: Σ |c_i| / (s_i + |y_i|)."""
        emitter, method, b = self._emitter, self._method, self._emitter.b
        zero = number(0.0)
        for place in range(method.compared):
            store(b, zero, self._norms, place)

        def component(i: Index) -> None:
            scale = emitter.scale(i)
            for place in range(method.compared):
                k = method.order - place
                at = k * self._count + i if isinstance(i, int) else b.add(integer(k * self._count), i)
                size = b.intrinsic("llvm.fabs", load(b, coefficients, at))
                store(b, b.fma(size, scale, load(b, self._norms, place)), self._norms, place)

        for_each(b, emitter.system.error_size, component)

    def longest(self) -> Value:
        """The longest τ in s at which the terms are small enough; not a number if they are infinite.

        Logarithms and powers to the base 2 are read from the bits of doubles, linear between powers of two: by up to
        0.09 too small, which changes τ by less than 1 %.
        """
        method, b = self._method, self._emitter.b
        rates = []
        for place in range(method.compared):
            bits = b.sitofp(b.bitcast(load(b, self._norms, place), INT), DOUBLE)
            logarithm = b.fsub(b.fmul(bits, number(1.0 / UNIT)), number(BIAS))
            rates.append(b.fmul(logarithm, number(1.0 / (method.order - place))))
        largest = rates[0]
        for rate in rates[1:]:
            largest = b.select(b.fcmp_ordered(">", rate, largest), rate, largest)
        exponent = b.fsub(number(math.log2(method.tolerance) / method.order + BIAS), largest)
        tau = b.bitcast(b.fptosi(b.fmul(exponent, number(UNIT)), INT), DOUBLE)
        total = load(b, self._norms, 0)
        for place in range(1, method.compared):
            total = b.fadd(total, load(b, self._norms, place))
        finite = b.fcmp_ordered("<", total, number(math.inf))
        return b.select(finite, b.fmul(tau, number(SAFETY)), number(math.nan))

    def estimate(self, tau: Value) -> None:
        """Emit the update of the largest error by that of an expansion at τ: its last two terms."""
        emitter, order, b = self._emitter, self._method.order, self._emitter.b
        power, square = None, tau
        for bit in range((order - 1).bit_length()):
            if (order - 1) >> bit & 1:
                power = square if power is None else b.fmul(power, square)
            square = b.fmul(square, square)
        assert power is not None
        error = b.fmul(power, b.fma(tau, load(b, self._norms, 0), load(b, self._norms, 1)))
        error = b.select(b.fcmp_unordered("uno", error, error), number(math.inf), error)
        largest = b.load(emitter.largest_error, typ=DOUBLE)
        b.store(b.select(b.fcmp_ordered(">", error, largest), error, largest), emitter.largest_error)
