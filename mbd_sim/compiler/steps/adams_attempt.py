"""An attempt of an Adams method to take a step, as IR: prediction, correction, and their difference as the error.

The error is told from the round-off of the slopes, which their differences amplify.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from mbd_sim.compiler.ir.builder import DOUBLE, IRBuilder, number
from mbd_sim.compiler.ir.lanes import ComponentBuilder
from mbd_sim.compiler.ir.module import Value
from mbd_sim.compiler.ir.vectors import Index, copy, for_components, load, store, total, weighted
from mbd_sim.compiler.steps.emitter import StepEmitter
from mbd_sim.integrators.explicit import LOWER, Adams

# The largest differences, in units of the tolerance, that are taken for round-off: where they grow with the order, as
# only those of round-off and of vibrations with h ω > 1 do, and elsewhere.
GROWING, SHRINKING = 20.0, 5.0


class AdamsError:
    """The largest error of a component of the predicted state, relative to s + |y|, see `System`.

    It is h γ ∇ᵏ f, but round-off in f, which ∇ᵏ amplifies by up to 2ᵏ, can exceed it by far. For smooth motions, the
    differences shrink with their order until they reach the round-off, from where on they grow. So the error of a
    component is the smallest of four: ∇ᵏ, ∇⁸, ∇⁷, and, where ∇ᵏ is not too large for round-off, what ∇ᵏ would be if the
    differences shrank as those up to order 8, or up to order 6, do.
    """

    def __init__(self, method: Adams, emitter: StepEmitter, *, rare: bool) -> None:
        """Allocate the arrays; the emitter's builder must be in the entry block of a function."""
        self._method, self._emitter, self._rare = method, emitter, rare
        self._errors = emitter.array(emitter.system.size, "errors") if rare else emitter.vector()
        self.start = emitter.array(emitter.system.size, "start") if rare else emitter.y  # of the step
        self.largest = emitter.scalar("largest")

    def clear(self) -> None:
        """Begin with no error."""
        self._emitter.b.store(number(0.0), self.largest)

    def add(self, w: IRBuilder, i: Index, change: Value) -> None:
        """Add a component, whose prediction has changed by so much in the correction."""
        error = w.fmul(w.intrinsic("llvm.fabs", change), self._emitter.inverse_scale(w, self.start, i))
        error = w.select(w.fcmp_unordered("uno", error, error), number(math.inf), error)
        store(w, error, self._errors, i)
        self._add(w, error)

    def _add(self, w: IRBuilder, error: Value) -> None:
        b, largest = self._emitter.b, self._emitter.b.load(self.largest, typ=DOUBLE)
        error = w.largest(error) if isinstance(w, ComponentBuilder) else error
        b.store(b.select(b.fcmp_ordered(">", error, largest), error, largest), self.largest)

    def reduce(self, h: Value, newest: Value, slopes: Sequence[Value]) -> None:
        """Emit, where the error exceeds the tolerance, what it is without round-off.

        :param newest: the slopes of the predicted state, `slopes` are those before.
        """
        emitter, b = self._emitter, self._emitter.b
        largest = b.load(self.largest, typ=DOUBLE)
        with b.if_then(emitter.any(b.fcmp_unordered(">", largest, number(self._method.tolerance)))):
            b.comment("The error without round-off, of which differences of lower order have less.")
            factor = b.fmul(h, number(self._method.newest))
            self.clear()

            def component(w: IRBuilder, i: Index) -> None:
                self._add(w, self._without_round_off(w, i, factor, newest, slopes))

            # With longer rates, a loop takes no notice, but compiling the sums without one takes time.
            short = self._rare or not emitter.system.rates.is_inlined
            for_components(b, emitter.system.size, component, short=short)
            small = b.fcmp_ordered("<=", largest, number(self._method.tolerance))
            b.store(b.select(small, largest, b.load(self.largest, typ=DOUBLE)), self.largest)

    def _without_round_off(
        self, w: IRBuilder, i: Index, factor: Value, newest: Value, slopes: Sequence[Value]
    ) -> Value:
        own, slope = w.named(load(w, self._errors, i), "own"), w.named(load(w, newest, i), "f")
        scale = w.named(self._emitter.inverse_scale(w, self.start, i), "scale")
        sizes = list[Value]()
        for weights in self._method.differences:
            difference = w.fsub(slope, total(w, weighted(weights, slopes), i))
            size = w.fmul(w.intrinsic("llvm.fabs", w.fmul(factor, difference)), scale)
            sizes.append(w.named(size, f"d{LOWER[len(sizes)]}"))
        d3, d4, d5, d6, d7, d8 = sizes
        tolerance, grows = self._method.tolerance, w.fcmp_ordered(">=", own, d8)
        limit = w.select(grows, number(GROWING * tolerance), number(SHRINKING * tolerance))
        expected = _smaller(w, _extrapolated(w, d8, d7, d6, d5, 1), _extrapolated(w, d6, d5, d4, d3, 2))
        expected = w.select(w.fcmp_ordered("<=", own, limit), expected, own)
        return _smaller(w, expected, _smaller(w, d8, _smaller(w, d7, own)))


def _smaller(b: IRBuilder, x: Value, y: Value) -> Value:
    return b.select(b.fcmp_ordered("<", x, y), x, y)


def _extrapolated(e: IRBuilder, a: Value, b: Value, c: Value, d: Value, pairs: int) -> Value:
    """The size of a difference `pairs` pairs of orders above that of size a; b, c, d are of lower orders.

    Two differences that follow each other do not vanish at the same time, so the one that shrinks less counts.
    """
    first, second = e.fdiv(a, c), e.fdiv(b, d)
    decay = e.named(e.select(e.fcmp_ordered(">", first, second), first, second), "decay")
    power = e.fmul(decay, decay) if pairs == 2 else decay
    one, two = e.fmul(a, power), e.fmul(b, e.fmul(power, e.intrinsic("llvm.sqrt", decay)))
    size = e.select(e.fcmp_ordered(">", one, two), one, two)
    return e.select(e.fcmp_unordered("uno", size, size), number(math.inf), size)


class AdamsAttempt:
    """Moves a state from the start of a step on, by one or several lengths.

    `moved` (n,) is the state, `left` (n,) its round-off, `predicted` (n,) the slopes of the last prediction, and
    `worst` the largest error of all moves that were good when they began. A `rare` attempt is shorter code, and slower.
    """

    def __init__(self, method: Adams, emitter: StepEmitter, *, rare: bool) -> None:
        """Allocate the arrays; the emitter's builder must be in the entry block of a function."""
        size = emitter.system.size
        names = ("moved", "left", "predicted", "increment", "partial", "trial_state")
        arrays = [emitter.array(size, name) if rare else emitter.vector() for name in names]
        self.moved, self.left, self.predicted, self._increment, self._partial, self._trial = arrays
        self.worst, self._method, self._emitter, self._rare = emitter.scalar("worst"), method, emitter, rare
        self._error = AdamsError(method, emitter, rare=rare)

    def begin(self, lost: Value) -> None:
        """Begin with the emitter's state and its round-off."""
        b, size = self._emitter.b, self._emitter.system.size
        copy(b, size, self._emitter.y, self.moved)
        if self._rare:
            copy(b, size, self._emitter.y, self._error.start)
        copy(b, size, lost, self.left)
        b.store(number(0.0), self.worst)

    def is_good(self) -> Value:
        """Whether the worst error is within the tolerance."""
        b = self._emitter.b
        return b.fcmp_ordered("<=", b.load(self.worst, typ=DOUBLE), number(self._method.tolerance))

    def slopes(self, t: Value, target: Value) -> None:
        """Emit the slopes of the moved state."""
        if self._rare:
            self._emitter.rates_rarely(t, self.moved, target)
        else:
            self._emitter.rates(t, self.moved, target)

    def move(self, t: Value, h: Value, slopes: list[Value]) -> None:
        """Emit a move by h from time t on, with the slopes 0, 1, 2 … times h before."""
        emitter, method, b = self._emitter, self._method, self._emitter.b

        # The newest slope comes last: the sums over the others need not wait for it.
        to_predict, to_correct = (
            weighted(weights[::-1], slopes[::-1]) for weights in (method.predictor, method.corrector)
        )

        def predict(w: IRBuilder, i: Index) -> None:
            increment = w.named(w.fmul(h, total(w, to_predict, i)), "h_slope")
            store(w, increment, self._increment, i)
            store(w, total(w, to_correct, i), self._partial, i)
            store(w, w.fadd(load(w, self.moved, i), increment), self._trial, i)

        def correct(w: IRBuilder, i: Index) -> None:
            slope = w.fma(number(method.newest), load(w, self.predicted, i), load(w, self._partial, i))
            slope = w.named(slope, "slope")
            added, before = w.named(w.fma(h, slope, load(w, self.left, i)), "added"), load(w, self.moved, i)
            after = w.named(w.fadd(w.named(before, "before"), added), "after")
            store(w, after, self.moved, i)
            store(w, w.fsub(added, w.fsub(after, before)), self.left, i)
            self._error.add(w, i, w.fma(h, slope, w.fneg(load(w, self._increment, i))))

        b.comment("Prediction and correction, and the difference of the two.")
        good, size = self.is_good(), emitter.system.size
        for_components(b, size, predict, short=self._rare)
        evaluate = emitter.rates_rarely if self._rare else emitter.rates
        evaluate(b.fadd(t, h), self._trial, self.predicted)
        self._error.clear()
        for_components(b, size, correct, short=self._rare)
        self._error.reduce(h, self.predicted, slopes)
        error, worst = (b.load(address, typ=DOUBLE) for address in (self._error.largest, self.worst))
        error = b.select(b.and_(good, b.fcmp_ordered(">", error, worst)), error, worst)
        b.store(error, self.worst)
