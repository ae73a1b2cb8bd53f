"""A step of an Adams–Bashforth–Moulton method, as IR."""

from __future__ import annotations

from mbd_sim.compiler.adams_attempt import AdamsAttempt
from mbd_sim.compiler.adams_history import AdamsHistory
from mbd_sim.compiler.ir import Value
from mbd_sim.compiler.ir_builder import IRBuilder
from mbd_sim.compiler.ir_types import DOUBLE, INT, integer, number
from mbd_sim.compiler.ir_vectors import Index, copy, for_each, load, loop, store
from mbd_sim.compiler.runge_kutta_step import ExplicitStep
from mbd_sim.compiler.simd_builder import LaneBuilder
from mbd_sim.compiler.step_emitter import EmitStep, Prepare, StepEmitter
from mbd_sim.integrators.adams import Adams

LONGEST_PAUSE = 63.0  # steps until the next attempt, after many that failed
NEARLY = 10.0  # errors in units of the tolerance, up to which an attempt that fails now and then changes nothing,
DIVISIBLE = 1024.0  # those up to which two halves of a step are expected to succeed: halved, an error is 1/2048,
EASILY = 0.125  # and those up to which halves are no longer needed
PATIENCE = 16.0  # slopes between two attempts that fail and change nothing
PROBED_EVERY = 8  # divided steps, a power of two, one is attempted at once first


def adams_step(method: Adams) -> Prepare:
    """The step of an Adams method, for `emit_advance`."""

    def prepare(emitter: StepEmitter) -> EmitStep:
        return _AdamsStep(method, emitter).emit

    return prepare


class _AdamsStep:
    """Emits steps of an Adams method.

    A sum of round-off, `lost`, is carried from step to step (Kahan's summation): y + lost is the more accurate state.
    Conditions are those of each member if the code is for several.
    """

    def __init__(self, method: Adams, emitter: StepEmitter) -> None:
        self._method, self._emitter = method, emitter
        self._history, self._otherwise = AdamsHistory(emitter, method), ExplicitStep(method.otherwise, emitter)
        self._rarely = ExplicitStep(method.otherwise, emitter, rare=True)
        self._at_once, self._in_halves = (AdamsAttempt(method, emitter, rare=rare) for rare in (False, True))
        self._current, self._trial = emitter.vector(), emitter.vector()
        several, attempt = isinstance(emitter.b, LaneBuilder), self._at_once
        self._new = emitter.vector() if several else attempt.moved  # of an attempt that succeeded
        self._lost = emitter.vector() if several else attempt.left
        self._taken = emitter.scalar()

    def emit(self, t: Value) -> None:
        """Emit a step of the emitter's y from time t on."""
        emitter, history, b, size = self._emitter, self._history, self._emitter.b, self._emitter.system.size
        length = number(float(self._method.length))
        emitter.rates(t, emitter.y, self._current, first=True)
        wait = self._read(history.wait)
        with b.if_then(emitter.any(b.fcmp_ordered("<=", wait, number(2.0 * self._method.length)))):
            copy(b, size, self._current, history.slopes(0))
        for count in (history.count, history.halves):
            b.store(b.fadd(self._read(count), number(1.0)), count)
        ready = b.fcmp_ordered("<=", wait, number(0.0))
        if emitter.system.reports_conditioning:
            ready = b.and_(ready, b.not_(emitter.is_ill_conditioned()))
        divided = _is_set(b, history.divided)
        known = b.and_(b.fptosi(self._read(history.halves), INT), integer(2 * PROBED_EVERY - 2))  # two more a step
        probes = b.icmp_unsigned("==", known, integer(0))
        at_once = b.and_(ready, b.fcmp_ordered(">=", self._read(history.count), length))
        at_once = b.and_(at_once, b.or_(b.not_(divided), probes))
        in_halves = b.and_(b.and_(ready, divided), b.fcmp_ordered(">=", self._read(history.halves), length))
        tries = b.or_(at_once, in_halves)
        b.store(b.select(tries, number(0.0), b.fsub(wait, number(1.0))), history.wait)
        b.store(number(0.0), self._taken)
        with b.if_then(emitter.any(tries)):
            self._attempts(t, at_once, in_halves)
        self._complete(t)

    def _read(self, address: Value) -> Value:
        return self._emitter.b.load(address, typ=DOUBLE)

    def _choose(self, condition: Value, value: Value, address: Value) -> None:
        """Set a number where a condition holds."""
        b = self._emitter.b
        b.store(b.select(condition, value, self._read(address)), address)

    def _attempts(self, t: Value, at_once: Value, in_halves: Value) -> None:
        """Emit the attempt of the whole step, and then the one in halves."""
        emitter, history, b = self._emitter, self._history, self._emitter.b
        places = range(self._method.length)
        with b.if_then(emitter.any(at_once), likely=True):
            attempt = self._at_once
            attempt.begin(history.lost)
            attempt.move(t, emitter.h, [history.slopes(-2 * back) for back in places])
            self._judge(attempt, at_once)
        in_halves = b.and_(in_halves, b.not_(_is_set(b, self._taken)))
        with b.if_then(emitter.any(in_halves), likely=False):
            attempt = self._in_halves
            attempt.begin(history.lost)
            h = b.fmul(number(0.5), emitter.h)

            def half(index: Value) -> None:
                with b.if_then(emitter.any(b.and_(in_halves, attempt.is_good()))):
                    start = b.fadd(t, b.fmul(b.sitofp(index, DOUBLE), h))
                    with b.if_then(b.icmp_unsigned("!=", index, integer(0))):
                        attempt.slopes(start, history.slopes(1))
                    attempt.move(start, h, [history.slopes(b.sub(index, integer(back))) for back in places])

            loop(b, 0, 2, half)
            self._judge(attempt, in_halves)

    def _judge(self, attempt: AdamsAttempt, active: Value) -> None:
        """Emit whether an attempt succeeded, and how the next steps are taken.

        An attempt at once while steps are divided is a probe; if that fails, it changes nothing. After any other that
        fails, a new history begins: the slopes may be those of a force with a kink, which differences of lower order
        no longer see after some steps. Either steps are divided from then on, or there is a pause, which becomes
        longer as more attempts fail. Only a small error after many attempts that succeeded changes nothing.
        """
        emitter, history, b, method = self._emitter, self._history, self._emitter.b, self._method
        error, zero, length = self._read(attempt.worst), number(0.0), float(method.length)
        at_once = attempt is self._at_once
        probes = b.and_(active, _is_set(b, history.divided)) if at_once else None
        limit: Value = number(method.tolerance)
        if probes is not None:
            limit = b.select(probes, number(EASILY * method.tolerance), limit)
        passed = b.and_(active, b.fcmp_ordered("<=", error, limit))
        self._take(attempt, passed)
        self._choose(passed, zero, history.pause)
        failed = b.and_(active, b.not_(passed if probes is None else b.or_(passed, probes)))
        patient = b.and_(failed, b.fcmp_ordered("<=", error, number(NEARLY * method.tolerance)))
        known = history.count if at_once else history.halves
        patient = b.and_(patient, b.fcmp_ordered(">=", self._read(known), number(length + PATIENCE)))
        pauses = failed = b.and_(failed, b.not_(patient))
        if at_once:
            divides = b.and_(failed, b.fcmp_ordered("<=", error, number(DIVISIBLE * method.tolerance)))
            pauses = b.and_(failed, b.not_(divides))
            self._choose(passed, zero, history.divided)
            self._choose(divides, number(1.0), history.divided)
            self._choose(patient, number(length - 1.0), history.count)
        else:
            self._choose(passed, b.fadd(self._read(history.halves), number(1.0)), history.halves)
            self._choose(pauses, zero, history.divided)
            self._choose(patient, number(length), history.halves)
        for count in (history.count, history.halves):
            self._choose(failed, zero, count)
        pause = self._read(history.pause)
        longer = b.fadd(b.fadd(pause, pause), number(1.0))
        longer = b.select(b.fcmp_ordered("<", longer, number(LONGEST_PAUSE)), longer, number(LONGEST_PAUSE))
        self._choose(pauses, pause, history.wait)
        self._choose(pauses, longer, history.pause)
        with b.if_then(emitter.is_estimated):
            larger = b.and_(passed, b.fcmp_ordered(">", error, self._read(emitter.largest_error)))
            self._choose(larger, error, emitter.largest_error)

    def _take(self, attempt: AdamsAttempt, passed: Value) -> None:
        """Keep the state of an attempt that succeeded."""
        b, size = self._emitter.b, self._emitter.system.size
        self._choose(passed, number(1.0), self._taken)
        if isinstance(b, LaneBuilder):
            for_each(b, size, lambda i: _store_where(b, passed, load(b, attempt.moved, i), self._new, i))
            for_each(b, size, lambda i: _store_where(b, passed, load(b, attempt.left, i), self._lost, i))
        elif attempt is not self._at_once:
            copy(b, size, attempt.moved, self._new)
            copy(b, size, attempt.left, self._lost)

    def _complete(self, t: Value) -> None:
        """Emit the new state, with the other method where no attempt succeeded."""
        emitter, history, b, size = self._emitter, self._history, self._emitter.b, self._emitter.system.size
        taken = _is_set(b, self._taken)
        halved = b.and_(_is_set(b, history.divided), b.fcmp_ordered("<=", self._read(history.wait), number(0.0)))
        halved = b.and_(halved, b.not_(taken))
        if isinstance(b, LaneBuilder):
            self._complete_members(t, taken, halved)
            return
        with b.if_else(taken) as (then, otherwise):
            with then:
                copy(b, size, self._new, emitter.y)
                copy(b, size, self._lost, history.lost)
            with otherwise:
                for_each(b, size, lambda i: store(b, number(0.0), history.lost, i))
                with b.if_else(halved, likely=False) as (twice, once):
                    with twice:
                        self._otherwise_in_halves(t, halved)
                    with once:
                        self._otherwise.emit(t, self._current)

    def _complete_members(self, t: Value, taken: Value, halved: Value) -> None:
        """The same for a group of members, some of which may need the other method."""
        emitter, b, size = self._emitter, self._emitter.b, self._emitter.system.size
        once = b.not_(b.or_(taken, halved))
        with b.if_then(emitter.any(once)):
            largest = self._read(emitter.largest_error)
            self._otherwise.emit(t, self._current, self._trial)
            self._choose(b.not_(once), largest, emitter.largest_error)
            for_each(b, size, lambda i: _store_where(b, once, load(b, self._trial, i), self._new, i))
        with b.if_then(emitter.any(halved)):
            self._otherwise_in_halves(t, halved)
            for_each(b, size, lambda i: _store_where(b, halved, load(b, emitter.y, i), self._new, i))
        copy(b, size, self._new, emitter.y)
        lost = self._history.lost
        for_each(b, size, lambda i: store(b, b.select(taken, load(b, self._lost, i), number(0.0)), lost, i))

    def _otherwise_in_halves(self, t: Value, halved: Value) -> None:
        """Emit two half steps of the other method, whose slopes in the middle count where it is `halved`."""
        emitter, history, b, size = self._emitter, self._history, self._emitter.b, self._emitter.system.size
        whole, place = emitter.h, history.slopes(1)
        emitter.h = h = b.fmul(number(0.5), whole)

        def half(index: Value) -> None:
            start = b.fadd(t, b.fmul(b.sitofp(index, DOUBLE), h))
            with b.if_then(b.icmp_unsigned("!=", index, integer(0))):
                emitter.rates_rarely(start, emitter.y, self._current)
                for_each(b, size, lambda i: _store_where(b, halved, load(b, self._current, i), place, i))
            self._rarely.emit(start, self._current)

        loop(b, 0, 2, half)
        self._choose(halved, b.fadd(self._read(history.halves), number(1.0)), history.halves)
        emitter.h = whole


def _is_set(b: IRBuilder, address: Value) -> Value:
    return b.fcmp_ordered("!=", b.load(address, typ=DOUBLE), number(0.0))


def _store_where(b: IRBuilder, condition: Value, value: Value, array: Value, i: Index) -> None:
    store(b, b.select(condition, value, load(b, array, i)), array, i)
