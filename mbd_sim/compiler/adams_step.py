"""A step of an Adams–Bashforth–Moulton method, as IR."""

from __future__ import annotations

import math
from collections.abc import Sequence

from mbd_sim.compiler.adams_history import AdamsHistory
from mbd_sim.compiler.ir import Value
from mbd_sim.compiler.ir_types import DOUBLE, number
from mbd_sim.compiler.ir_vectors import Index, copy, for_each, load, loop, store, total, weighted
from mbd_sim.compiler.runge_kutta_step import ExplicitStep
from mbd_sim.compiler.simd_builder import LaneBuilder
from mbd_sim.compiler.step_emitter import EmitStep, Prepare, StepEmitter
from mbd_sim.integrators.adams import Adams

LONGEST_PAUSE = 63.0  # steps until the next attempt, after many that failed


def adams_step(method: Adams) -> Prepare:
    """The step of an Adams method, for `emit_advance`."""

    def prepare(emitter: StepEmitter) -> EmitStep:
        return _AdamsStep(method, emitter).emit

    return prepare


class _AdamsStep:
    """Emits steps of an Adams method.

    A sum of round-off, `lost`, is carried from step to step (Kahan's summation): y + lost is the more accurate state.
    """

    def __init__(self, method: Adams, emitter: StepEmitter) -> None:
        self._method, self._emitter = method, emitter
        self._history, self._otherwise = AdamsHistory(emitter, method), ExplicitStep(method.otherwise, emitter)
        self._current, self._predicted = emitter.vector(), emitter.vector()  # slopes at both ends of the step
        self._increment, self._partial, self._trial = (emitter.vector() for _ in range(3))
        self._new, self._lost, self._errors = (emitter.vector() for _ in range(3))
        self._error, self._taken = emitter.scalar(), emitter.scalar()

    def emit(self, t: Value) -> None:
        """Emit a step of the emitter's y from time t on."""
        emitter, history, b, size = self._emitter, self._history, self._emitter.b, self._emitter.system.size
        emitter.rates(t, emitter.y, self._current, first=True)
        wait, length = b.load(history.wait, typ=DOUBLE), number(float(self._method.length))
        with b.if_then(emitter.any(b.fcmp_ordered("<=", wait, length))):
            copy(b, size, self._current, history.slopes(0))
        b.store(b.fadd(b.load(history.count, typ=DOUBLE), number(1.0)), history.count)
        tries = b.fcmp_ordered(">=", b.load(history.count, typ=DOUBLE), length)
        tries = b.and_(tries, b.fcmp_ordered("<=", wait, number(0.0)))
        if emitter.system.reports_conditioning:
            tries = b.and_(tries, b.not_(emitter.is_ill_conditioned()))
        b.store(b.select(tries, number(0.0), b.fsub(wait, number(1.0))), history.wait)
        b.store(number(0.0), self._taken)
        with b.if_then(emitter.any(tries)):
            self._attempt(t, tries)
        taken = b.fcmp_ordered("!=", b.load(self._taken, typ=DOUBLE), number(0.0))
        if isinstance(b, LaneBuilder):
            self._complete_members(t, taken)
            return
        with b.if_else(taken) as (then, otherwise):
            with then:
                copy(b, size, self._new, emitter.y)
                copy(b, size, self._lost, history.lost)
            with otherwise:
                for_each(b, size, lambda i: store(b, number(0.0), history.lost, i))
                self._otherwise.emit(t, self._current)

    def _complete_members(self, t: Value, taken: Value) -> None:
        """The same for a group of members, some of which may need the other method."""
        emitter, b, size = self._emitter, self._emitter.b, self._emitter.system.size

        def choose(i: Index) -> None:
            store(b, b.select(taken, load(b, self._new, i), load(b, self._trial, i)), self._new, i)
            store(b, b.select(taken, load(b, self._lost, i), number(0.0)), self._lost, i)

        with b.if_then(emitter.any(b.not_(taken))):
            largest = b.load(emitter.largest_error, typ=DOUBLE)
            self._otherwise.emit(t, self._current, self._trial)
            b.store(b.select(taken, largest, b.load(emitter.largest_error, typ=DOUBLE)), emitter.largest_error)
            for_each(b, size, choose)
        copy(b, size, self._new, emitter.y)
        copy(b, size, self._lost, self._history.lost)

    def _attempt(self, t: Value, tries: Value) -> None:
        """Emit prediction and correction into `_new`, and whether they count into `_taken`."""
        emitter, method, b, size = self._emitter, self._method, self._emitter.b, self._emitter.system.size
        slopes = [self._history.slopes(back) for back in range(method.length)]

        def predict(i: Index) -> None:
            increment = b.fmul(emitter.h, total(b, weighted(method.predictor, slopes), i))
            store(b, increment, self._increment, i)
            store(b, total(b, weighted(method.corrector, slopes), i), self._partial, i)
            store(b, b.fadd(load(b, emitter.y, i), increment), self._trial, i)

        for_each(b, size, predict)
        emitter.rates(emitter.stage_time(t, 1.0), self._trial, self._predicted)
        b.store(number(0.0), self._error)
        for_each(b, size, self._correct)
        small, error = self._is_small(), b.load(self._error, typ=DOUBLE)
        with b.if_then(emitter.any(b.not_(small))):
            self._reconsider(slopes)
            b.store(b.select(small, error, b.load(self._error, typ=DOUBLE)), self._error)
        taken = b.and_(tries, self._is_small())
        b.store(b.select(taken, number(1.0), number(0.0)), self._taken)
        self._wait_after(b.and_(tries, b.not_(taken)), taken)
        with b.if_then(emitter.is_estimated):
            error, largest = (b.load(address, typ=DOUBLE) for address in (self._error, emitter.largest_error))
            larger = b.and_(taken, b.fcmp_ordered(">", error, largest))
            b.store(b.select(larger, error, largest), emitter.largest_error)

    def _correct(self, i: Index) -> None:
        emitter, b = self._emitter, self._emitter.b
        slope = b.fma(number(self._method.newest), load(b, self._predicted, i), load(b, self._partial, i))
        added, before = b.fma(emitter.h, slope, load(b, self._history.lost, i)), load(b, emitter.y, i)
        after = b.fadd(before, added)
        store(b, after, self._new, i)
        store(b, b.fsub(added, b.fsub(after, before)), self._lost, i)
        change = b.fma(emitter.h, slope, b.fneg(load(b, self._increment, i)))
        error = b.fmul(b.intrinsic("llvm.fabs", change), emitter.scale(i))
        error = b.select(b.fcmp_unordered("uno", error, error), number(math.inf), error)
        store(b, error, self._errors, i)
        self._add_error(error)

    def _add_error(self, error: Value) -> None:
        b = self._emitter.b
        largest = b.load(self._error, typ=DOUBLE)
        b.store(b.select(b.fcmp_ordered(">", error, largest), error, largest), self._error)

    def _is_small(self) -> Value:
        b = self._emitter.b
        return b.fcmp_ordered("<=", b.load(self._error, typ=DOUBLE), number(self._method.tolerance))

    def _reconsider(self, slopes: Sequence[Value]) -> None:
        """Take the differences of lower order for the error of a component, where one of them is smaller."""
        emitter, b = self._emitter, self._emitter.b
        factor = b.fmul(emitter.h, number(self._method.newest))
        b.store(number(0.0), self._error)

        def component(i: Index) -> None:
            smallest, newest, scale = load(b, self._errors, i), load(b, self._predicted, i), emitter.scale(i)
            for weights in self._method.lower:
                difference = b.fsub(newest, total(b, weighted(weights, slopes), i))
                error = b.fmul(b.intrinsic("llvm.fabs", b.fmul(factor, difference)), scale)
                smallest = b.select(b.fcmp_ordered("<", error, smallest), error, smallest)
            self._add_error(smallest)

        if emitter.system.rates.is_inlined:
            for_each(b, emitter.system.size, component)
        else:  # with longer rates, the time of a loop is not noticed in a step, but compiling the sums without one is
            loop(b, 0, emitter.system.size, component)

    def _wait_after(self, failed: Value, taken: Value) -> None:
        """Begin a new history after an attempt that failed, and wait, ever longer as more of them fail.

        The slopes may be those of a force with a kink, of which differences of lower order see less and less.
        """
        b, history = self._emitter.b, self._history
        b.store(b.select(failed, number(0.0), b.load(history.count, typ=DOUBLE)), history.count)
        pause, wait = (b.load(address, typ=DOUBLE) for address in (history.pause, history.wait))
        longer = b.fadd(b.fadd(pause, pause), number(1.0))
        longer = b.select(b.fcmp_ordered("<", longer, number(LONGEST_PAUSE)), longer, number(LONGEST_PAUSE))
        b.store(b.select(failed, pause, wait), history.wait)
        b.store(b.select(failed, longer, b.select(taken, number(0.0), pause)), history.pause)
