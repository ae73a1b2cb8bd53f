"""A step of an Adams–Bashforth–Moulton method, as IR."""

from __future__ import annotations

from mbd_sim.compiler.ir.builder import DOUBLE, INT, IRBuilder, integer, number
from mbd_sim.compiler.ir.lanes import LaneBuilder
from mbd_sim.compiler.ir.module import Value
from mbd_sim.compiler.ir.vectors import Index, copy, for_each, load, loop, store
from mbd_sim.compiler.steps.adams_attempt import AdamsAttempt
from mbd_sim.compiler.steps.adams_history import AdamsHistory
from mbd_sim.compiler.steps.adams_policy import AdamsPolicy
from mbd_sim.compiler.steps.emitter import EmitStep, Prepare, StepEmitter
from mbd_sim.compiler.steps.runge_kutta import CalledStep
from mbd_sim.integrators.explicit import PARTS, Adams


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
        self._method, self._emitter, self._policy = method, emitter, AdamsPolicy(method, emitter)
        self._history = AdamsHistory(emitter, method, self._policy.state)
        self._otherwise = CalledStep(method.otherwise, emitter)
        self._in_parts = AdamsAttempt(method, emitter, rare=True)
        # Fast code has a copy for steps that are taken at once, which most of them are.
        self._at_once = AdamsAttempt(method, emitter, rare=False) if emitter.b.module.fast else None
        self._current, self._trial = emitter.vector("current"), emitter.vector("trial")
        several, attempt = isinstance(emitter.b, LaneBuilder), self._at_once or self._in_parts
        self._new = emitter.vector() if several else attempt.moved  # of an attempt that succeeded
        self._lost = emitter.vector() if several else attempt.left
        self._first_predicted = emitter.array(emitter.system.size, "first_predicted")
        self._taken = emitter.scalar("taken")

    def emit(self, t: Value) -> None:
        """Emit a step of the emitter's y from time t on."""
        emitter, history, policy, b = self._emitter, self._history, self._policy, self._emitter.b
        history.begin_step()
        emitter.rates(t, emitter.y, self._current, first=True)
        counts = ready = policy.begin_step()
        with b.if_then(emitter.any(counts)):
            copy(b, emitter.system.size, self._current, b.named(history.slopes(0), "newest"))
        if emitter.system.reports_conditioning:
            ready = b.named(b.and_(ready, b.not_(emitter.is_ill_conditioned())), "ready")
        b.store(number(0.0), self._taken)
        if self._at_once is None:
            loop(b, 0, policy.finest + 1, lambda level: self._attempt_in_parts(t, level, ready))
        else:
            self._attempt_at_once(t, self._at_once, ready)
            if policy.finest:
                divided = b.and_(ready, b.not_(policy.is_at_level(integer(0))))
                divided = b.and_(divided, b.not_(self._is_taken()))
                with b.if_then(emitter.any(divided), likely=False):
                    loop(b, 1, policy.finest + 1, lambda level: self._attempt_in_parts(t, level, divided))
        self._complete(t, b.and_(counts, b.fcmp_ordered("<=", policy.read(policy.wait), number(0.0))))

    def _is_taken(self) -> Value:
        return self._emitter.b.fcmp_unordered("!=", self._policy.read(self._taken), number(0.0))

    def _part(self, level: Value) -> tuple[Value, Value, Value]:
        """The number of parts of a step at a level, their length in s, and in quarters of a step."""
        b, parts = self._emitter.b, self._policy.parts(level)
        parts = b.named(parts, "parts")
        length = b.named(b.fdiv(self._emitter.h, b.sitofp(parts, DOUBLE)), "part_h")
        return parts, length, b.named(b.lshr(integer(PARTS), level), "stride")

    def _attempt_at_once(self, t: Value, attempt: AdamsAttempt, ready: Value) -> None:
        """Emit the attempt at level 0."""
        emitter, history, policy, b = self._emitter, self._history, self._policy, self._emitter.b
        probes = b.and_(ready, policy.is_probe(integer(0)))
        at_once = b.or_(b.and_(ready, policy.is_known(integer(0))), probes)
        with b.if_then(emitter.any(at_once), likely=True):
            attempt.begin(history.lost)
            places = range(self._method.length)
            attempt.move(t, emitter.h, [history.slopes(-PARTS * back) for back in places])
            self._judge(attempt, integer(0), at_once, probes)

    def _attempt_in_parts(self, t: Value, level: Value, divided: Value) -> None:
        """Emit the attempt at any level."""
        emitter, history, policy, b = self._emitter, self._history, self._policy, self._emitter.b
        size, attempt = emitter.system.size, self._in_parts
        b.comment("An attempt at this level: 0 at once, 1 in halves, 2 in quarters.")
        divided = b.and_(divided, b.not_(self._is_taken()))
        probes = b.named(b.and_(divided, policy.is_probe(level)), "probes")
        active = b.named(b.or_(b.and_(divided, policy.is_known(level)), probes), "active")
        with b.if_then(emitter.any(active)):
            attempt.begin(history.lost)
            parts, h, stride = self._part(level)
            refines = b.fcmp_unordered("!=", policy.read(policy.refines), number(0.0))
            with b.if_then(emitter.any(refines)):
                history.refine(refines, b.add(stride, stride), self._first_predicted)
            b.store(number(0.0), policy.refines)

            def part(index: Value) -> None:
                with b.if_then(emitter.any(b.and_(active, attempt.is_good()))):
                    start, first = b.fadd(t, b.fmul(b.sitofp(index, DOUBLE), h)), b.mul(index, stride)
                    start = b.named(start, "part_t")
                    with b.if_then(b.icmp_unsigned("!=", index, integer(0))):
                        attempt.slopes(start, self._trial)
                        place = b.named(history.slopes(first), "place")
                        for_each(b, size, lambda i: _store_where(b, active, load(b, self._trial, i), place, i))
                    places = [b.sub(first, b.mul(stride, integer(back))) for back in range(self._method.length)]
                    slopes = [b.named(history.slopes(place), f"f{back}") for back, place in enumerate(places)]
                    attempt.move(start, h, slopes)
                    with b.if_then(b.icmp_unsigned("==", index, integer(0))):
                        copy(b, size, attempt.predicted, self._first_predicted)

            loop(b, 0, parts, part)
            self._judge(attempt, level, active, probes)

    def _judge(self, attempt: AdamsAttempt, level: Value, active: Value, probes: Value) -> None:
        """Emit what follows from the error of an attempt: see `AdamsPolicy`."""
        emitter, policy, b = self._emitter, self._policy, self._emitter.b
        b.comment("What follows from the error: success, smaller parts, or a new history after a pause.")
        error = policy.read(attempt.worst)
        passed = policy.judge(level, error, active, probes)
        self._take(attempt, passed)
        if attempt is self._at_once and policy.finest:
            refines = b.fcmp_unordered("!=", policy.read(policy.refines), number(0.0))
            with b.if_then(emitter.any(refines), likely=False):
                copy(b, emitter.system.size, attempt.predicted, self._first_predicted)
        if emitter.estimates:
            with b.if_then(emitter.is_estimated):
                larger = b.and_(passed, b.fcmp_ordered(">", error, policy.read(emitter.largest_error)))
                policy.enter(larger, (emitter.largest_error, error))

    def _take(self, attempt: AdamsAttempt, passed: Value) -> None:
        """Keep the state of an attempt that succeeded."""
        b, size = self._emitter.b, self._emitter.system.size
        self._policy.enter(passed, (self._taken, number(1.0)))
        if isinstance(b, LaneBuilder):
            for_each(b, size, lambda i: _store_where(b, passed, load(b, attempt.moved, i), self._new, i))
            for_each(b, size, lambda i: _store_where(b, passed, load(b, attempt.left, i), self._lost, i))
        elif attempt.moved is not self._new:
            copy(b, size, attempt.moved, self._new)
            copy(b, size, attempt.left, self._lost)

    def _complete(self, t: Value, counts: Value) -> None:
        """Emit the new state, with the other method where no attempt succeeded.

        :param counts: whether the slopes of this step count, so that they are needed at all parts of the step.
        """
        emitter, history, b, size = self._emitter, self._history, self._emitter.b, self._emitter.system.size
        b.comment(f"The new state; where no attempt succeeded, by {self._method.otherwise.name}.")
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
                if not self._policy.finest:
                    self._otherwise.emit(t, self._current)
                    return
                divided = b.and_(counts, b.not_(self._policy.is_at_level(integer(0))))
                with b.if_else(divided, likely=False) as (several, once):
                    with once:
                        self._otherwise.emit(t, self._current)
                    with several:
                        level = b.fptosi(self._policy.read(self._policy.level), INT)
                        self._otherwise_in_parts(t, level, self._policy.is_at_level(level))

    def _complete_members(self, t: Value, taken: Value, counts: Value) -> None:
        """`_complete` for a group of members, some of which may need the other method."""
        emitter, b, size = self._emitter, self._emitter.b, self._emitter.system.size
        several = b.and_(b.not_(taken), b.and_(counts, b.not_(self._policy.is_at_level(integer(0)))))
        once = b.not_(b.or_(taken, several))
        with b.if_then(emitter.any(once)):
            largest = self._policy.read(emitter.largest_error)
            copy(b, size, emitter.y, self._trial)
            self._otherwise.emit(t, self._current, self._trial)
            self._policy.enter(b.not_(once), (emitter.largest_error, largest))
            for_each(b, size, lambda i: _store_where(b, once, load(b, self._trial, i), self._new, i))

        def at_level(level: Value) -> None:
            here = b.and_(several, self._policy.is_at_level(level))
            with b.if_then(emitter.any(here)):
                copy(b, size, emitter.y, self._trial)
                self._otherwise_in_parts(t, level, here)
                for_each(b, size, lambda i: _store_where(b, here, load(b, emitter.y, i), self._new, i))
                copy(b, size, self._trial, emitter.y)

        if self._policy.finest:
            loop(b, 1, self._policy.finest + 1, at_level)
        copy(b, size, self._new, emitter.y)
        lost = self._history.lost
        for_each(b, size, lambda i: store(b, b.select(taken, load(b, self._lost, i), number(0.0)), lost, i))

    def _otherwise_in_parts(self, t: Value, level: Value, here: Value) -> None:
        """Emit a step of the other method in parts, whose slopes count where a condition holds."""
        emitter, history, b, size = self._emitter, self._history, self._emitter.b, self._emitter.system.size
        whole = emitter.h
        parts, emitter.h, stride = self._part(level)

        def part(index: Value) -> None:
            start = b.named(b.fadd(t, b.fmul(b.sitofp(index, DOUBLE), emitter.h)), "part_t")
            slopes = self._in_parts.predicted
            with b.if_else(b.icmp_unsigned("==", index, integer(0))) as (first, later):
                with first:
                    copy(b, size, self._current, slopes)
                with later:
                    emitter.rates_rarely(start, emitter.y, slopes)
                    place = b.named(history.slopes(b.mul(index, stride)), "place")
                    for_each(b, size, lambda i: _store_where(b, here, load(b, slopes, i), place, i))
            self._otherwise.emit(start, slopes)

        loop(b, 0, parts, part)
        self._policy.add_slopes(here, parts)
        emitter.h = whole


def _store_where(b: IRBuilder, condition: Value, value: Value, array: Value, i: Index) -> None:
    """Set a component for the members for which a condition holds; a single member gets here only where it does."""
    store(b, b.select(condition, value, load(b, array, i)) if isinstance(b, LaneBuilder) else value, array, i)
