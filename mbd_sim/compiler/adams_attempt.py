"""An attempt of an Adams method to take a step, as IR: prediction, correction, and their difference as the error."""

from __future__ import annotations

from mbd_sim.compiler.adams_error import AdamsError
from mbd_sim.compiler.ir import Value
from mbd_sim.compiler.ir_builder import IRBuilder
from mbd_sim.compiler.ir_types import DOUBLE, number
from mbd_sim.compiler.ir_vectors import Index, copy, for_components, load, store, total, weighted
from mbd_sim.compiler.step_emitter import StepEmitter
from mbd_sim.integrators.adams import Adams


class AdamsAttempt:
    """Moves a state from the start of a step on, by one or several lengths.

    `moved` (n,) is the state, `left` (n,) its round-off, `predicted` (n,) the slopes of the last prediction, and
    `worst` the largest error of all moves that were good when they began. A `rare` attempt is shorter code, and slower.
    """

    def __init__(self, method: Adams, emitter: StepEmitter, *, rare: bool) -> None:
        """Allocate the arrays; the emitter's builder must be in the entry block of a function."""
        size = emitter.system.size
        arrays = [emitter.array(size) if rare else emitter.vector() for _ in range(6)]
        self.moved, self.left, self.predicted, self._increment, self._partial, self._trial = arrays
        self.worst, self._method, self._emitter, self._rare = emitter.scalar(), method, emitter, rare
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
            increment = w.fmul(h, total(w, to_predict, i))
            store(w, increment, self._increment, i)
            store(w, total(w, to_correct, i), self._partial, i)
            store(w, w.fadd(load(w, self.moved, i), increment), self._trial, i)

        def correct(w: IRBuilder, i: Index) -> None:
            slope = w.fma(number(method.newest), load(w, self.predicted, i), load(w, self._partial, i))
            added, before = w.fma(h, slope, load(w, self.left, i)), load(w, self.moved, i)
            after = w.fadd(before, added)
            store(w, after, self.moved, i)
            store(w, w.fsub(added, w.fsub(after, before)), self.left, i)
            self._error.add(w, i, w.fma(h, slope, w.fneg(load(w, self._increment, i))))

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
