"""A step of an Adams–Bashforth–Moulton method, as IR."""

from __future__ import annotations

from mbd_sim.compiler.ir.builder import IRBuilder
from mbd_sim.compiler.ir.lanes import LaneBuilder
from mbd_sim.compiler.ir.module import Value
from mbd_sim.compiler.ir.types import DOUBLE, INT, integer, number
from mbd_sim.compiler.ir.vectors import Index, copy, for_each, load, loop, store
from mbd_sim.compiler.steps.adams_attempt import AdamsAttempt
from mbd_sim.compiler.steps.adams_history import AdamsHistory, finest_level
from mbd_sim.compiler.steps.emitter import EmitStep, Prepare, StepEmitter
from mbd_sim.compiler.steps.runge_kutta import ExplicitStep
from mbd_sim.integrators.adams import PARTS, Adams

LONGEST_PAUSE = 255.0  # steps until the next attempt, after many that failed
# Errors in units of the tolerance: those up to which an attempt that fails now and then changes nothing,
NEARLY = 10.0
REFINABLE = 16.0  # up to which slopes are interpolated, so that the step can be taken in smaller parts,
DIVISIBLE = 1024.0  # and up to which parts of half the length are expected to succeed,
HALVED = 2048.0  # times smaller an error is then
PATIENCE = 16.0  # further slopes, after which one that fails may change nothing, and the pauses are short again
PROBED_EVERY = 8  # divided steps, a power of two, one is attempted in parts of twice the length first


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
        self._finest = finest_level(emitter.system.instructions, emitter.system.size)
        self._history, self._otherwise = AdamsHistory(emitter, method), ExplicitStep(method.otherwise, emitter)
        self._rarely = ExplicitStep(method.otherwise, emitter, rare=True)
        self._at_once, self._in_parts = (AdamsAttempt(method, emitter, rare=rare) for rare in (False, True))
        self._current, self._trial = emitter.vector(), emitter.vector()
        several, attempt = isinstance(emitter.b, LaneBuilder), self._at_once
        self._new = emitter.vector() if several else attempt.moved  # of an attempt that succeeded
        self._lost = emitter.vector() if several else attempt.left
        self._first_predicted = emitter.array(emitter.system.size)
        self._taken, self._refines = emitter.scalar(), emitter.scalar()

    def emit(self, t: Value) -> None:
        """Emit a step of the emitter's y from time t on."""
        emitter, history, b, size = self._emitter, self._history, self._emitter.b, self._emitter.system.size
        history.begin_step()
        emitter.rates(t, emitter.y, self._current, first=True)
        wait = self._read(history.wait)
        counts = ready = b.fcmp_ordered("<=", wait, number(0.0))
        with b.if_then(emitter.any(counts)):
            copy(b, size, self._current, history.slopes(0))
        b.store(b.select(counts, b.fadd(self._read(history.count), number(1.0)), number(0.0)), history.count)
        if emitter.system.reports_conditioning:
            ready = b.and_(ready, b.not_(emitter.is_ill_conditioned()))
        b.store(b.select(counts, number(0.0), b.fsub(wait, number(1.0))), history.wait)
        b.store(number(0.0), self._taken)
        b.store(number(0.0), self._refines)
        probes = b.and_(ready, self._is_probe(integer(0)))
        at_once = b.or_(b.and_(ready, self._is_known(integer(0))), probes)
        with b.if_then(emitter.any(at_once), likely=True):
            attempt = self._at_once
            attempt.begin(history.lost)
            places = range(self._method.length)
            attempt.move(t, emitter.h, [history.slopes(-PARTS * back) for back in places])
            self._judge(attempt, integer(0), at_once, probes)
        if self._finest:
            divided = b.and_(ready, b.not_(self._is_at_level(integer(0))))
            divided = b.and_(divided, b.not_(self._is_taken()))
            with b.if_then(emitter.any(divided), likely=False):
                loop(b, 1, self._finest + 1, lambda level: self._attempt_in_parts(t, level, divided))
        self._complete(t, b.and_(counts, b.fcmp_ordered("<=", self._read(history.wait), number(0.0))))

    def _read(self, address: Value) -> Value:
        return self._emitter.b.load(address, typ=DOUBLE)

    def _choose(self, condition: Value, value: Value, address: Value) -> None:
        """Set a number where a condition holds."""
        b = self._emitter.b
        b.store(b.select(condition, value, self._read(address)), address)

    def _is_taken(self) -> Value:
        return self._emitter.b.fcmp_ordered("!=", self._read(self._taken), number(0.0))

    def _is_at_level(self, level: Value) -> Value:
        b = self._emitter.b
        return b.fcmp_ordered("==", self._read(self._history.level), b.sitofp(level, DOUBLE))

    def _is_known(self, level: Value) -> Value:
        """Whether steps are at a level, and there are enough slopes for it."""
        b, length = self._emitter.b, number(float(self._method.length))
        return b.and_(self._is_at_level(level), b.fcmp_ordered(">=", self._read(self._history.count), length))

    def _is_probe(self, level: Value) -> Value:
        """Whether steps are in parts of half the length of this level, and one is now attempted at this level first."""
        b, count = self._emitter.b, self._read(self._history.count)
        finer = b.add(level, integer(1))
        due = b.and_(b.fptosi(count, INT), b.shl(integer(PROBED_EVERY - 1), finer))
        known = b.fcmp_ordered(">=", count, number(2.0 * self._method.length))
        return b.and_(self._is_at_level(finer), b.and_(known, b.icmp_unsigned("==", due, integer(0))))

    def _parts(self, level: Value) -> tuple[Value, Value, Value]:
        """The number of parts of a step at a level, their length in s, and in quarters of a step."""
        b = self._emitter.b
        parts = b.shl(integer(1), level)
        return parts, b.fdiv(self._emitter.h, b.sitofp(parts, DOUBLE)), b.lshr(integer(PARTS), level)

    def _attempt_in_parts(self, t: Value, level: Value, divided: Value) -> None:
        """Emit the attempt at one of the levels above 0."""
        emitter, history, b, size = self._emitter, self._history, self._emitter.b, self._emitter.system.size
        divided = b.and_(divided, b.not_(self._is_taken()))
        probes = b.and_(divided, self._is_probe(level))
        active = b.or_(b.and_(divided, self._is_known(level)), probes)
        with b.if_then(emitter.any(active)):
            attempt = self._in_parts
            attempt.begin(history.lost)
            parts, h, stride = self._parts(level)
            refines = b.fcmp_ordered("!=", self._read(self._refines), number(0.0))
            with b.if_then(emitter.any(refines)):
                history.refine(refines, b.add(stride, stride), self._first_predicted)
            b.store(number(0.0), self._refines)

            def part(index: Value) -> None:
                with b.if_then(emitter.any(b.and_(active, attempt.is_good()))):
                    start, first = b.fadd(t, b.fmul(b.sitofp(index, DOUBLE), h)), b.mul(index, stride)
                    with b.if_then(b.icmp_unsigned("!=", index, integer(0))):
                        attempt.slopes(start, self._trial)
                        place = history.slopes(first)
                        for_each(b, size, lambda i: _store_where(b, active, load(b, self._trial, i), place, i))
                    places = [b.sub(first, b.mul(stride, integer(back))) for back in range(self._method.length)]
                    attempt.move(start, h, [history.slopes(place) for place in places])
                    with b.if_then(b.icmp_unsigned("==", index, integer(0))):
                        copy(b, size, attempt.predicted, self._first_predicted)

            loop(b, 0, parts, part)
            self._judge(attempt, level, active, probes)

    def _judge(self, attempt: AdamsAttempt, level: Value, active: Value, probes: Value) -> None:
        """Emit whether an attempt succeeded, and how the next steps are taken.

        A probe that fails changes nothing. After another attempt with a small error, the step is attempted in smaller
        parts, with interpolated slopes. Otherwise a new history begins: the slopes may be those of a force with a kink,
        which differences of lower order no longer see after some steps. Its steps are in smaller parts if that promises
        to be enough. It begins after a pause, which becomes longer as more attempts fail. Only a small error of the
        smallest parts after many attempts that succeeded changes nothing.
        """
        emitter, history, b, method = self._emitter, self._history, self._emitter.b, self._method
        error, zero, tolerance = self._read(attempt.worst), number(0.0), method.tolerance
        at_once, length = attempt is self._at_once, float(method.length)
        is_finest = b.icmp_unsigned("==", level, integer(self._finest))

        def is_below(factor: float) -> Value:
            return b.fcmp_ordered("<=", error, number(factor * tolerance))

        passed = b.and_(active, is_below(1.0))
        self._take(attempt, passed)
        count = self._read(history.count)
        lasts = b.fcmp_ordered(">=", count, number(length + PATIENCE))
        self._choose(b.and_(passed, lasts), zero, history.pause)
        coarser = b.sitofp(b.fptosi(b.fmul(number(0.5), count), INT), DOUBLE)
        coarser = b.select(b.and_(passed, probes), coarser, count)
        further = b.sitofp(b.sub(self._parts(level)[0], integer(1)), DOUBLE)
        b.store(b.select(passed, b.fadd(coarser, further), coarser), history.count)
        self._choose(passed, b.sitofp(level, DOUBLE), history.level)
        failed = b.and_(active, b.not_(b.or_(passed, probes)))
        with b.if_then(emitter.any(failed)):
            if self._finest:
                refines = b.and_(b.and_(failed, is_below(REFINABLE)), b.not_(is_finest))
                self._choose(refines, number(1.0), self._refines)
                self._choose(refines, number(length), history.count)
                if at_once:
                    copy(b, emitter.system.size, attempt.predicted, self._first_predicted)
                failed = b.and_(failed, b.not_(refines))
            patient = b.and_(b.and_(failed, is_finest), b.and_(is_below(NEARLY), lasts))
            self._choose(patient, number(length - 1.0), history.count)
            failed = b.and_(failed, b.not_(patient))
            self._choose(failed, zero, history.count)
            self._choose(failed, zero, history.level)
            if self._finest:
                self._choose(refines, self._level_above(level, 1), history.level)
                for finer, factor in ((2, DIVISIBLE * HALVED), (1, DIVISIBLE)):
                    exists = b.icmp_signed("<=", b.add(level, integer(finer)), integer(self._finest))
                    divides = b.and_(failed, b.and_(is_below(factor), exists))
                    self._choose(divides, self._level_above(level, finer), history.level)
            pause = self._read(history.pause)
            longer = b.fadd(b.fadd(pause, pause), number(1.0))
            longer = b.select(b.fcmp_ordered("<", longer, number(LONGEST_PAUSE)), longer, number(LONGEST_PAUSE))
            self._choose(failed, pause, history.wait)
            self._choose(failed, longer, history.pause)
        with b.if_then(emitter.is_estimated):
            larger = b.and_(passed, b.fcmp_ordered(">", error, self._read(emitter.largest_error)))
            self._choose(larger, error, emitter.largest_error)

    def _level_above(self, level: Value, finer: int) -> Value:
        b = self._emitter.b
        return b.sitofp(b.add(level, integer(finer)), DOUBLE)

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

    def _complete(self, t: Value, counts: Value) -> None:
        """Emit the new state, with the other method where no attempt succeeded.

        :param counts: whether the slopes of this step count, so that they are needed at all parts of the step.
        """
        emitter, history, b, size = self._emitter, self._history, self._emitter.b, self._emitter.system.size
        taken = self._is_taken()
        if isinstance(b, LaneBuilder):
            self._complete_members(t, taken, counts)
            return
        with b.if_else(taken, likely=True) as (then, otherwise):
            with then:
                copy(b, size, self._new, emitter.y)
                copy(b, size, self._lost, history.lost)
            with otherwise:
                for_each(b, size, lambda i: store(b, number(0.0), history.lost, i))
                if not self._finest:
                    self._otherwise.emit(t, self._current)
                    return
                divided = b.and_(counts, b.not_(self._is_at_level(integer(0))))
                with b.if_else(divided, likely=False) as (several, once):
                    with once:
                        self._otherwise.emit(t, self._current)
                    with several:
                        level = b.fptosi(self._read(history.level), INT)
                        self._otherwise_in_parts(t, level, self._is_at_level(level))

    def _complete_members(self, t: Value, taken: Value, counts: Value) -> None:
        """`_complete` for a group of members, some of which may need the other method."""
        emitter, b, size = self._emitter, self._emitter.b, self._emitter.system.size
        several = b.and_(b.not_(taken), b.and_(counts, b.not_(self._is_at_level(integer(0)))))
        once = b.not_(b.or_(taken, several))
        with b.if_then(emitter.any(once)):
            largest = self._read(emitter.largest_error)
            self._otherwise.emit(t, self._current, self._trial)
            self._choose(b.not_(once), largest, emitter.largest_error)
            for_each(b, size, lambda i: _store_where(b, once, load(b, self._trial, i), self._new, i))

        def at_level(level: Value) -> None:
            here = b.and_(several, self._is_at_level(level))
            with b.if_then(emitter.any(here)):
                copy(b, size, emitter.y, self._trial)
                self._otherwise_in_parts(t, level, here)
                for_each(b, size, lambda i: _store_where(b, here, load(b, emitter.y, i), self._new, i))
                copy(b, size, self._trial, emitter.y)

        if self._finest:
            loop(b, 1, self._finest + 1, at_level)
        copy(b, size, self._new, emitter.y)
        lost = self._history.lost
        for_each(b, size, lambda i: store(b, b.select(taken, load(b, self._lost, i), number(0.0)), lost, i))

    def _otherwise_in_parts(self, t: Value, level: Value, here: Value) -> None:
        """Emit a step of the other method in parts, whose slopes count where a condition holds."""
        emitter, history, b, size = self._emitter, self._history, self._emitter.b, self._emitter.system.size
        whole = emitter.h
        parts, emitter.h, stride = self._parts(level)

        def part(index: Value) -> None:
            start = b.fadd(t, b.fmul(b.sitofp(index, DOUBLE), emitter.h))
            slopes = self._at_once.predicted
            with b.if_else(b.icmp_unsigned("==", index, integer(0))) as (first, later):
                with first:
                    copy(b, size, self._current, slopes)
                with later:
                    emitter.rates_rarely(start, emitter.y, slopes)
                    place = history.slopes(b.mul(index, stride))
                    for_each(b, size, lambda i: _store_where(b, here, load(b, slopes, i), place, i))
            self._rarely.emit(start, slopes)

        loop(b, 0, parts, part)
        further = b.sitofp(b.sub(parts, integer(1)), DOUBLE)
        self._choose(here, b.fadd(self._read(history.count), further), history.count)
        emitter.h = whole


def _store_where(b: IRBuilder, condition: Value, value: Value, array: Value, i: Index) -> None:
    """Set a component for the members for which a condition holds; a single member gets here only where it does."""
    store(b, b.select(condition, value, load(b, array, i)) if isinstance(b, LaneBuilder) else value, array, i)
