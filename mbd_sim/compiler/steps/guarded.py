"""Steps of a mechanism with one-sided rows, which end before a step in which a mode ends, as IR.

There are two systems, one with everything open and one with the active rows. Modes are inputs, and stay the same within
a call. After each step the guards are evaluated, together with the slopes for the next step; where one is negative, the
step is undone and left to the caller.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from mbd_sim.compiler.ir.builder import DOUBLE, FALSE, INT, IRBuilder, element, integer, local_array, number
from mbd_sim.compiler.ir.module import BOOL, POINTER, Function, FunctionType, Module, Value
from mbd_sim.compiler.ir.vectors import Index, copy, for_each, load, loop, store
from mbd_sim.compiler.steps.emitter import Prepare, StepEmitter, System
from mbd_sim.compiler.steps.loop import ESTIMATED_EVERY, emit_plain_advance

TO_EVENT, WHOLE = range(2)  # what to do at an event: end before its step, or undo all steps
GRAZING = 1.05  # of the step times the larger rate at both ends: the sum of both gaps below which they may have met
FEW = 40  # guards that are examined one after the other, without a loop
TURNING = 0.25  # of a slip velocity along two directions, by which it may change within a step
STIFF = 0.5  # of the time in which friction can turn such a velocity, that a step may take
NOT_SIGN = 2**63 - 1  # the bits of a double that are zero in both zeros


@dataclass(frozen=True)
class Guards:
    """The guards of a mechanism.

    `closed_start(t, y, inputs, slopes, readings[, margin])` gives the rates of the state, with all active rows, and as
    readings the gaps (gaps,), rates (rows,), forces (rows,) and guards (count,), and the rates in 1/s at which the
    `slips` may turn; those of `open_start` are the gaps (gaps,) and their rates (gaps,) while everything is open.
    Modes are the inputs from `first_mode` to before `first_mode` + `modes`. A guard counts as negative below
    -`tolerance`, an open gap below that times its unit. `slips` are the pairs of rows that slide along two directions:
    their direction turns ever faster as they stop, so a step ends before one in which they change by more than the
    fraction `TURNING`, or could. Up to a `slow` speed in m/s they are at rest.
    """

    gaps: int
    rows: int
    count: int
    closed_start: Function
    open_start: Function
    first_mode: int
    modes: int
    tolerance: float
    gap_units: tuple[float, ...]
    slow: float
    slips: tuple[tuple[int, int], ...] = ()

    @property
    def mode_range(self) -> range:
        """The inputs that are the modes."""
        return range(self.first_mode, self.first_mode + self.modes)


def kept_at_start(size: int, gaps: int, rows: int) -> int:
    """The numbers that are kept besides a history: the slopes (size,), their conditioning, the gaps and their rates."""
    return size + 1 + gaps + rows


@dataclass(frozen=True)
class GuardedSteps:
    """What emits whole steps, and what emits parts of steps, by a method without a history.

    `history` is the size of that of whole steps, which is behind the inputs. What else is kept follows it.
    """

    whole: Prepare
    part: Prepare
    history: int


def emit_one_sided_advance(
    module: Module, open_system: System, closed_system: System, steps: GuardedSteps, guards: Guards
) -> Function:
    """Emit the functions below and return `estimating_advance`, see `mbd_sim.compiler.steps.loop.emit_advance`.

    `i64 advance_to_event(y, inputs, i64 first, double h, i64 steps, estimate)` takes steps until a guard becomes
    negative, and returns how many were taken; -1 if the state would not stay finite, which is unchanged then.
    `i64 part_step(y, inputs, double t, double h)` takes one step from t on, without guards; 1 if the state is finite.
    """
    loops = (
        _emit_loop(module, "advance_closed", closed_system, steps, guards, closed=True),
        _emit_loop(module, "advance_open", open_system, steps, guards, closed=False),
    )
    arguments = [POINTER, POINTER, INT, DOUBLE, INT, POINTER]
    for name, mode in (("advance_to_event", TO_EVENT), ("estimating_advance", WHOLE)):
        function = Function(module, FunctionType(INT, arguments), name)
        state, inputs, first, h, count, estimate = function.args
        b = IRBuilder(function.append_basic_block("entry"))
        given = [state, inputs, first, h, count, integer(mode), estimate]
        taken = call_loop(b, loops, guards.mode_range, given)
        b.ret(taken if mode == TO_EVENT else b.zext(b.icmp_signed("==", taken, count), INT))
    parts = (
        emit_part(module, "part_closed", closed_system, steps.part),
        emit_part(module, "part_open", open_system, steps.part),
    )
    exported = Function(module, FunctionType(INT, [POINTER, POINTER, DOUBLE, DOUBLE]), "part_step")
    b = IRBuilder(exported.append_basic_block("entry"))
    b.ret(call_loop(b, parts, guards.mode_range, exported.args))
    emit_plain_advance(module, function)
    return function


def emit_part(module: Module, name: str, system: System, prepare: Prepare) -> Function:
    """Emit `i64 name(y, inputs, double t, double h)`: see `part_step`."""
    function = internal(module, name, [POINTER, POINTER, DOUBLE, DOUBLE])
    state, inputs, t, h = function.args
    b = IRBuilder(function.append_basic_block("entry"))
    emitter = StepEmitter(b, system, inputs, h, short=True)
    emit_step, sum_of_zeros = prepare(emitter), emitter.scalar()
    b.store(number(0.0), emitter.largest_error)
    copy(b, system.size, state, emitter.y)
    emit_step(t)
    emitter.project(b.fadd(t, h), emitter.y)
    copy(b, system.size, emitter.y, state)
    b.ret(b.select(is_finite(b, system.size, emitter.y, sum_of_zeros), integer(1), integer(-1)))
    return function


def call_loop(b: IRBuilder, loops: Sequence[Function], modes: range, arguments: Sequence[Value]) -> Value:
    """Call the first of two loops if any of the modes, which are inputs, is not open; the second one otherwise."""
    taken, bits = [], integer(0)
    for index in modes:
        bits = b.or_(bits, b.load(element(b, arguments[1], index), typ=INT))
    with b.if_else(b.icmp_unsigned("!=", b.and_(bits, integer(NOT_SIGN)), integer(0))) as branches:
        for branch, function in zip(branches, loops, strict=True):
            with branch:
                taken.append((b.call(function, arguments), b.block))
    result = b.phi(INT)
    for value, block in taken:
        result.add_incoming(value, block)
    return result


def _emit_loop(
    module: Module, name: str, system: System, steps: GuardedSteps, guards: Guards, *, closed: bool
) -> Function:
    """Emit `i64 name(y, inputs, i64 first, double h, i64 steps, i64 mode, estimate)`.

    Step k starts at the time k h, counted from `first`. It returns the number of steps before the first one in which a
    guard becomes negative, or -1 if the state does not stay finite. `mode`: see `TO_EVENT`. Where an input, or what an
    actuator holds, has jumped, a guard may be negative at the start of a step as well.
    """
    function = internal(module, name, [POINTER, POINTER, INT, DOUBLE, INT, INT, POINTER])
    state, inputs, first, h, count, mode, estimate = function.args
    b = IRBuilder(function.append_basic_block("entry"))
    emitter, size = StepEmitter(b, system, inputs, h), system.size
    emit_step, y, before = steps.whole(emitter), emitter.y, emitter.vector()
    check, sum_of_zeros = _Check(emitter, guards, closed), emitter.scalar()
    emitter.start_slopes = check.slopes
    history = element(b, inputs, system.inputs_size)
    kept = element(b, history, steps.history)

    def time_of(step: Value) -> Value:
        return b.fmul(b.sitofp(step, DOUBLE), h)

    _enter(emitter, state, estimate, first, count)
    check.begin(time_of(first), kept, h)

    entry, head = b.block, b.append_basic_block("step")
    body, whole, event, finished = (b.append_basic_block(block) for block in ("body", "whole", "event", "finished"))
    b.branch(head)
    b.position_at_end(head)
    index = b.phi(INT)
    index.add_incoming(integer(0), entry)
    b.cbranch(b.icmp_signed("<", index, count), body, finished)

    b.position_at_end(body)
    emitter.index, next_index = b.add(first, index), b.add(index, integer(1))
    emitter.is_estimated = b.icmp_unsigned("==", b.and_(emitter.index, integer(ESTIMATED_EVERY - 1)), integer(0))
    emitter.sample(emitter.index, time_of(emitter.index))  # also where an event is left to the caller
    copy(b, size, y, before)
    b.cbranch(check.begins_with_event(index, time_of(emitter.index), h), event, whole)

    b.position_at_end(whole)
    emit_step(time_of(emitter.index))
    following = time_of(b.add(emitter.index, integer(1)))
    emitter.project(following, y)
    check.keep()
    check.read(following)
    ended = check.ended(inputs, h)
    index.add_incoming(next_index, b.block)
    b.cbranch(ended, event, head)

    b.position_at_end(event)
    kept_size = steps.history + kept_at_start(size, guards.gaps, guards.rows)
    _emit_undo(emitter, b.icmp_signed("==", mode, integer(TO_EVENT)), (before, state), (history, kept_size))
    _leave(emitter, estimate, index)

    b.position_at_end(finished)
    emitter.index = b.add(first, count)
    finite = _emit_end(emitter, check, state, kept, sum_of_zeros)
    _leave(emitter, estimate, b.select(finite, count, integer(-1)))
    return function


def _enter(emitter: StepEmitter, state: Value, estimate: Value, first: Value, count: Value) -> None:
    b = emitter.b
    copy(b, emitter.system.size, state, emitter.y)
    b.store(b.load(estimate, typ=DOUBLE), emitter.largest_error)
    emitter.index, emitter.steps = first, count


def _leave(emitter: StepEmitter, estimate: Value, result: Value) -> None:
    emitter.b.store(emitter.b.load(emitter.largest_error, typ=DOUBLE), estimate)
    emitter.b.ret(result)


def _emit_undo(emitter: StepEmitter, is_to_event: Value, states: tuple[Value, Value], kept: tuple[Value, int]) -> None:
    """Emit what follows a step with an event: the state before it, where the call ends there, and a new history."""
    b = emitter.b
    with b.if_then(is_to_event):
        copy(b, emitter.system.size, *states)
    if emitter.kept is not None:
        with b.if_else(is_to_event) as (to_event, whole):
            with to_event:
                loop(b, 0, kept[1], lambda i: store(b, number(0.0), kept[0], i))
            with whole:
                emitter.kept.end(FALSE)


def _emit_end(emitter: StepEmitter, check: _Check, state: Value, kept: Value, sum_of_zeros: Value) -> Value:
    """Emit what follows the last step: a finite state and what is kept besides a history; whether it is finite."""
    b, size = emitter.b, emitter.system.size
    finite = is_finite(b, size, emitter.y, sum_of_zeros)
    if emitter.kept is not None:
        emitter.kept.end(finite)
    with b.if_then(finite):
        copy(b, size, emitter.y, state)
        if emitter.kept is not None:
            check.remember(kept)
    return finite


def internal(module: Module, name: str, types: list[str]) -> Function:
    """A function with an integer as its result that only this module calls."""
    function = Function(module, FunctionType(INT, types), name)
    function.linkage = "internal"
    function.attributes = ["noinline"]
    function.noalias = True
    return function


class _Check:
    """The guards before and after a step, and whether one of them ends the step; with or without active rows.

    `slopes` (n,) are those of the state after the step, with which the next one starts.
    """

    def __init__(self, emitter: StepEmitter, guards: Guards, closed: bool) -> None:
        """Allocate the arrays; the emitter's builder must be in the entry block of a function."""
        b, self._emitter = emitter.b, emitter
        self._b, self._guards, self._slips = b, guards, guards.slips if closed else ()
        rates = guards.rows if closed else guards.gaps
        first, count = (guards.gaps + 2 * rates, guards.count) if closed else (0, guards.gaps)
        self._function = guards.closed_start if closed else guards.open_start
        self._kept, self._negative = guards.gaps + rates, range(first, first + count)
        size = guards.gaps + 2 * guards.rows + guards.count + len(guards.slips)
        in_registers = emitter.system.in_registers
        self._event: Value = FALSE  # whether a call begins with an event
        self._after = local_array(b, size, in_registers=in_registers)
        self._before = local_array(b, self._kept, in_registers=in_registers)
        self._found = local_array(b, 1, in_registers=True)
        self.slopes = emitter.vector("start_slopes")

    def read(self, t: Value) -> None:
        """Evaluate the slopes and the guards of the state at time t."""
        emitter = self._emitter
        at = self._b.by_address(t, emitter.time)
        reported = [emitter.conditioning] if emitter.system.reports_conditioning else []
        self._b.call(self._function, [at, emitter.y, emitter.inputs, self.slopes, self._after, *reported])

    def begin(self, t: Value, kept: Value, h: Value) -> None:
        """Begin a call: read what was kept at the end of the last one if it belongs to this state, or evaluate it.

        Actuators that are sampled change the state before each step, which then is read at its start.
        """
        b, history = self._b, self._emitter.kept
        if history is None:
            if self._emitter.system.samples is None:
                self._event = self._start(t, h)
            return
        history.begin()
        with b.if_else(history.belongs, likely=True) as (known, unknown):
            with known:
                self._each_kept(kept, lambda size, inside, outside: copy(b, size, outside, inside))
                was_known = b.block
            with unknown:
                found = self._start(t, h)
                was_unknown = b.block
        self._event = b.phi(BOOL)
        self._event.add_incoming(FALSE, was_known)
        self._event.add_incoming(found, was_unknown)

    def begins_with_event(self, index: Value, t: Value, h: Value) -> Value:
        """Whether a step, the one with this index in the call, begins with an event: see `_start`."""
        b = self._b
        if self._emitter.system.samples is None:
            return b.and_(self._event, b.icmp_signed("==", index, integer(0)))
        return self._start(t, h)

    def remember(self, kept: Value) -> None:
        """Keep the slopes and guards of this state for the next call."""
        self._each_kept(kept, lambda size, inside, outside: copy(self._b, size, inside, outside))

    def _each_kept(self, kept: Value, move: Callable[[int, Value, Value], None]) -> None:
        b, size = self._b, self._emitter.system.size
        move(size, self.slopes, kept)
        if self._emitter.system.reports_conditioning:
            move(1, self._emitter.conditioning, element(b, kept, size))
        move(self._kept, self._after, element(b, kept, size + 1))

    def keep(self) -> None:
        """Keep those that have been read as those before the step."""
        copy(self._b, self._kept, self._after, self._before)

    def ended(self, inputs: Value, h: Value) -> Value:
        """Whether a guard is negative after the step or not a number, or a gap may have been negative within it.

        The same where a slip along two directions has changed too much.
        """
        b, tolerance, first = self._b, self._guards.tolerance, self._negative.start

        def is_negative(index: Index) -> Value:
            limit = number(-tolerance) if first else b.fmul(number(-tolerance), self._unit(index))
            return b.fcmp_unordered("<", load(b, self._after, shifted(b, index, first)), limit)

        found = self._any(len(self._negative), is_negative)
        for index, slip in enumerate(self._slips):
            found = b.or_(found, b.or_(self._is_stiff(index, h), self._turns(slip, inputs)))
        turning = self._any(self._guards.gaps, self._turns_back)
        before = b.block
        with b.if_then(turning, likely=False):
            grazed = b.or_(found, self._grazes(h))
            examined = b.block
        result = b.phi(BOOL)
        result.add_incoming(found, before)
        result.add_incoming(grazed, examined)
        return result

    def _start(self, t: Value, h: Value) -> Value:
        """Read what a step starts with; whether the guard of a force is negative, as after a jump of an input.

        Gaps that are open do not jump. The same where friction could turn a slip by much within the step.
        """
        self.read(t)
        b, guards, first = self._b, self._guards, self._negative.start

        def is_negative(index: Index) -> Value:
            return b.fcmp_unordered("<", load(b, self._after, shifted(b, index, first)), number(-guards.tolerance))

        def is_active(gap: Index) -> Value:
            mode = load(b, self._emitter.inputs, shifted(b, gap, guards.first_mode))
            return b.and_(is_negative(gap), b.fcmp_unordered("!=", mode, number(0.0)))

        found = FALSE
        if first:
            found = self._any(guards.gaps, is_active)
            for place in range(guards.gaps, len(self._negative)):
                found = b.or_(found, is_negative(place))
        for index in range(len(self._slips)):
            found = b.or_(found, self._is_stiff(index, h))
        return found

    def _is_stiff(self, slip: int, h: Value) -> Value:
        """Whether friction could turn a slip by much within a step, with the rate that was read last."""
        b = self._b
        rate = load(b, self._after, self._negative.stop + slip)
        return b.fcmp_unordered(">", b.fmul(h, rate), number(STIFF))

    def _any(self, count: int, condition: Callable[[Index], Value]) -> Value:
        """Whether a condition holds for any index: a loop if there are many."""
        b, found = self._b, FALSE
        if count <= FEW:
            for index in range(count):
                found = b.or_(found, condition(index))
            return found
        store(b, number(0.0), self._found, 0)

        def examine(index: Value) -> None:
            with b.if_then(condition(index), likely=False):
                store(b, number(1.0), self._found, 0)

        loop(b, 0, count, examine)
        return b.fcmp_unordered("!=", load(b, self._found, 0), number(0.0))

    def _unit(self, gap: Index) -> Value:
        units = self._guards.gap_units
        if isinstance(gap, int):
            return number(units[gap])
        bits = struct.unpack(f"<{len(units)}q", struct.pack(f"<{len(units)}d", *units))
        return load(self._b, self._b.module.table("gap_units", bits), gap)

    def _turns_back(self, gap: Index) -> Value:
        """Whether a gap becomes smaller at the start of the step and larger at its end."""
        b, slope = self._b, shifted(self._b, gap, self._guards.gaps)
        falls = b.fcmp_ordered("<", load(b, self._before, slope), number(0.0))
        return b.and_(falls, b.fcmp_ordered(">", load(b, self._after, slope), number(0.0)))

    def _grazes(self, h: Value) -> Value:
        """Whether a gap that turns back within the step may have been negative before that.

        Small bodies that fly past each other approach and part at full speed, without any curve in between.
        """
        b, gaps = self._b, self._guards.gaps
        reach = b.fmul(number(GRAZING), h)

        def grazes(gap: Index) -> Value:
            slope_of = shifted(b, gap, gaps)
            (last_gap, last_slope), (value, slope) = (
                (load(b, values, gap), load(b, values, slope_of)) for values in (self._before, self._after)
            )
            falls = b.fneg(last_slope)
            fastest = b.select(b.fcmp_ordered(">", slope, falls), slope, falls)
            near = b.fcmp_ordered("<", b.fadd(last_gap, value), b.fmul(reach, fastest))
            limit = b.fmul(number(self._guards.tolerance), self._unit(gap))
            open_before = b.fcmp_ordered(">", last_gap, limit)
            return b.and_(b.and_(self._turns_back(gap), open_before), near)

        return self._any(gaps, grazes)

    def _turns(self, slip: tuple[int, int], inputs: Value) -> Value:
        """Whether a slip that slides has changed by more than `TURNING`."""
        b, guards = self._b, self._guards
        direction = [load(b, inputs, guards.first_mode + guards.rows + row) for row in slip]
        was = [load(b, self._before, guards.gaps + row) for row in slip]
        now = [load(b, self._after, guards.gaps + row) for row in slip]

        def square(parts: list[Value]) -> Value:
            return b.fma(parts[1], parts[1], b.fmul(parts[0], parts[0]))

        change = square([b.fsub(new, old) for new, old in zip(now, was, strict=True)])
        slides = b.fcmp_unordered("!=", square(direction), number(0.0))
        moves = b.fcmp_unordered(">", square(now), number(guards.slow**2))
        too_far = b.fcmp_unordered(">", change, b.fmul(number(TURNING**2), square(was)))
        return b.and_(b.and_(slides, moves), too_far)


def shifted(b: IRBuilder, index: Index, by: int) -> Index:
    """An index behind another one."""
    return index + by if isinstance(index, int) else b.add(index, integer(by))


def is_finite(b: IRBuilder, size: int, y: Value, total: Value) -> Value:
    """Emit whether a state is finite; `total` is the address of a number."""
    zero = number(0.0)
    b.store(zero, total)
    for_each(b, size, lambda i: b.store(b.fadd(b.load(total, typ=DOUBLE), b.fmul(load(b, y, i), zero)), total))
    return b.fcmp_ordered("==", b.load(total, typ=DOUBLE), zero)
