"""Steps of a mechanism with one-sided rows, which end before a step in which a mode ends, as IR.

There are two systems, one with everything open and one with the active rows. Modes are inputs, and stay the same within
a call. After each step the guards are evaluated; where one is negative, the step is undone and left to the caller.
"""

from __future__ import annotations

from dataclasses import dataclass

import llvmlite.ir as ir

from mbd_sim.compiler.ir_types import DOUBLE, INT, POINTER, integer, local_array, number
from mbd_sim.compiler.ir_vectors import copy, for_each, load, loop
from mbd_sim.compiler.step_emitter import Prepare, StepEmitter, System
from mbd_sim.compiler.stepping import ESTIMATED_EVERY, emit_plain_advance

GRAZING = 4.0 / 27.0  # the largest value of x (1 - x)², by which a cubic falls below its ends for unit slopes
TURNING = 0.25  # of a slip velocity along two directions, by which it may change within a step
STIFF = 0.5  # of the time in which friction can turn such a velocity, that a step may take
AT_REST = 1e-12  # m/s, up to which slip along two directions counts as none


@dataclass(frozen=True)
class Guards:
    """The guards of a mechanism.

    `readings(t, y, inputs, out)` gives gaps (gaps,), rates (rows,), forces (rows,) and guards (count,) with all active
    rows, and the rates in 1/s at which the `slips` may turn; `open_guards(t, y, inputs, out)` gives the gaps (gaps,)
    and their rates (gaps,) while everything is open.
    Modes are the inputs from `first_mode` to before `first_mode` + `modes`. A guard counts as negative below
    -`tolerance`. `slips` are the pairs of rows that slide along two directions: their direction turns ever faster as
    they stop, so a step ends before one in which they change by more than the fraction `TURNING`, or could.
    """

    gaps: int
    rows: int
    count: int
    readings: ir.Function
    open_guards: ir.Function
    first_mode: int
    modes: int
    tolerance: float
    slips: tuple[tuple[int, int], ...] = ()


def emit_guarded_advance(
    module: ir.Module, open_system: System, closed_system: System, prepare: Prepare, guards: Guards
) -> ir.Function:
    """Emit the functions below and return `estimating_advance`, see `mbd_sim.compiler.stepping.emit_advance`.

    `i64 advance_to_event(y, inputs, i64 first, double h, i64 steps, estimate)` takes steps until a guard becomes
    negative, and returns how many were taken; -1 if the state would not stay finite, which is unchanged then.
    `void part_step(y, inputs, double t, double h)` takes one step from t on, without guards.
    """
    steps = [_emit_step(module, name, system, prepare) for name, system in _named(open_system, closed_system)]
    _emit_part_step(module, steps, guards)
    to_event = _emit_advance_to_event(module, open_system.size, steps, guards)
    size, arguments = open_system.size, [POINTER, POINTER, INT, DOUBLE, INT]
    function = ir.Function(module, ir.FunctionType(INT, [*arguments, POINTER]), "estimating_advance")
    state, inputs, first, h, count, estimate = function.args
    b = ir.IRBuilder(function.append_basic_block("entry"))
    y = local_array(b, size)
    copy(b, size, state, y)
    complete = b.icmp_signed("==", b.call(to_event, [y, inputs, first, h, count, estimate]), count)
    with b.if_then(complete):
        copy(b, size, y, state)
    b.ret(b.zext(complete, INT))
    emit_plain_advance(module, function)
    return function


def _named(open_system: System, closed_system: System) -> tuple[tuple[str, System], ...]:
    return ("open_step", open_system), ("closed_step", closed_system)


def _emit_step(module: ir.Module, name: str, system: System, prepare: Prepare) -> ir.Function:
    """Emit `void name(y, inputs, double t, double h, double next, i64 estimated, estimate)`: a step in place."""
    types = [POINTER, POINTER, DOUBLE, DOUBLE, DOUBLE, INT, POINTER]
    function = ir.Function(module, ir.FunctionType(ir.VoidType(), types), name)
    function.linkage = "internal"
    function.attributes.add("noinline")
    state, inputs, t, h, following, estimated, estimate = function.args
    for argument in (state, inputs, estimate):
        argument.add_attribute("noalias")
    b = ir.IRBuilder(function.append_basic_block("entry"))
    emitter = StepEmitter(b, system, inputs, h)
    emit_step = prepare(emitter)
    copy(b, system.size, state, emitter.y)
    b.store(b.load(estimate, typ=DOUBLE), emitter.largest_error)
    emitter.is_estimated = b.icmp_signed("!=", estimated, integer(0))
    emit_step(t)
    emitter.project(following, emitter.y)
    b.store(b.load(emitter.largest_error, typ=DOUBLE), estimate)
    copy(b, system.size, emitter.y, state)
    b.ret_void()
    return function


def _is_closed(b: ir.IRBuilder, inputs: ir.Value, guards: Guards) -> ir.Value:
    """Whether any mode is not open."""
    total = local_array(b, 1)
    b.store(number(0.0), total)

    def add(i: ir.Value) -> None:
        value = load(b, inputs, b.add(i, integer(guards.first_mode)))
        b.store(b.fadd(b.load(total, typ=DOUBLE), b.fmul(value, value)), total)

    loop(b, 0, guards.modes, add)
    return b.fcmp_unordered("!=", b.load(total, typ=DOUBLE), number(0.0))


def _emit_part_step(module: ir.Module, steps: list[ir.Function], guards: Guards) -> None:
    function = ir.Function(module, ir.FunctionType(ir.VoidType(), [POINTER, POINTER, DOUBLE, DOUBLE]), "part_step")
    state, inputs, t, h = function.args
    b = ir.IRBuilder(function.append_basic_block("entry"))
    unread = local_array(b, 1)
    b.store(number(0.0), unread)
    arguments = [state, inputs, t, h, b.fadd(t, h), integer(0), unread]
    with b.if_else(_is_closed(b, inputs, guards)) as (closed, otherwise):
        with closed:
            b.call(steps[1], arguments)
        with otherwise:
            b.call(steps[0], arguments)
    b.ret_void()


def _emit_advance_to_event(module: ir.Module, size: int, steps: list[ir.Function], guards: Guards) -> ir.Function:
    types = [POINTER, POINTER, INT, DOUBLE, INT, POINTER]
    function = ir.Function(module, ir.FunctionType(INT, types), "advance_to_event")
    state, inputs, first, h, count, estimate = function.args
    b = ir.IRBuilder(function.append_basic_block("entry"))
    y, before, time = local_array(b, size), local_array(b, size), local_array(b, 1)
    size_of_readings = guards.gaps + 2 * guards.rows + guards.count + len(guards.slips)
    values = [local_array(b, size_of_readings) for _ in range(2)]  # before and after a step
    ended = local_array(b, 1)
    closed = _is_closed(b, inputs, guards)
    copy(b, size, state, y)
    _read(b, guards, closed, time, b.fmul(b.sitofp(first, DOUBLE), h), y, inputs, values[1])

    entry, head = b.block, b.append_basic_block("step")
    body, event, finished = (b.append_basic_block(name) for name in ("body", "event", "finished"))
    b.branch(head)
    b.position_at_end(head)
    index = b.phi(INT)
    index.add_incoming(integer(0), entry)
    b.cbranch(b.icmp_signed("<", index, count), body, finished)

    b.position_at_end(body)
    step = b.add(first, index)
    t, following = (b.fmul(b.sitofp(value, DOUBLE), h) for value in (step, b.add(step, integer(1))))
    estimated = b.zext(b.icmp_unsigned("==", b.and_(step, integer(ESTIMATED_EVERY - 1)), integer(0)), INT)
    copy(b, size, y, before)
    copy(b, guards.gaps + guards.rows, values[1], values[0])
    arguments = [y, inputs, t, h, following, estimated, estimate]
    with b.if_else(closed) as (with_rows, otherwise):
        with with_rows:
            b.call(steps[1], arguments)
        with otherwise:
            b.call(steps[0], arguments)
    _read(b, guards, closed, time, following, y, inputs, values[1])
    _emit_check(b, guards, closed, values, inputs, h, ended)
    is_event = b.fcmp_unordered("!=", b.load(ended, typ=DOUBLE), number(0.0))
    next_index = b.add(index, integer(1))
    index.add_incoming(next_index, b.block)
    b.cbranch(is_event, event, head)

    b.position_at_end(event)
    copy(b, size, before, state)
    b.ret(index)

    b.position_at_end(finished)
    finite = _is_finite(b, size, y)
    with b.if_then(finite):
        copy(b, size, y, state)
    b.ret(b.select(finite, count, integer(-1)))
    return function


def _read(
    b: ir.IRBuilder,
    guards: Guards,
    closed: ir.Value,
    time: ir.Value,
    t: ir.Value,
    y: ir.Value,
    inputs: ir.Value,
    values: ir.Value,
) -> None:
    b.store(t, time)
    with b.if_else(closed) as (with_rows, otherwise):
        with with_rows:
            b.call(guards.readings, [time, y, inputs, values])
        with otherwise:
            b.call(guards.open_guards, [time, y, inputs, values])


def _emit_check(
    b: ir.IRBuilder,
    guards: Guards,
    closed: ir.Value,
    values: list[ir.Value],
    inputs: ir.Value,
    h: ir.Value,
    ended: ir.Value,
) -> None:
    """Set `ended` to 1 if a guard is negative after the step or not a number, or if a gap may have been in between.

    The same where a slip along two directions has changed too much.
    """
    before, after = values
    b.store(number(0.0), ended)

    def end_if(condition: ir.Value) -> None:
        b.store(b.select(condition, number(1.0), b.load(ended, typ=DOUBLE)), ended)

    def below(value: ir.Value) -> ir.Value:
        return b.fcmp_unordered("<", value, number(-guards.tolerance))

    first = guards.gaps + 2 * guards.rows
    with b.if_else(closed) as (with_rows, otherwise):
        with with_rows:
            loop(b, 0, guards.count, lambda i: end_if(below(load(b, after, b.add(i, integer(first))))))
            for number_of_slip, slip in enumerate(guards.slips):
                turning = load(b, after, first + guards.count + number_of_slip)
                end_if(b.fcmp_unordered(">", b.fmul(h, turning), number(STIFF)))
                end_if(_turns(b, guards, slip, values, inputs))
        with otherwise:
            for_each(b, guards.gaps, lambda i: end_if(below(load(b, after, i))))

    def grazing(i: int | ir.Value) -> None:
        rate = b.add(i, integer(guards.gaps)) if isinstance(i, ir.Value) else integer(i + guards.gaps)
        gap, last_gap = load(b, after, i), load(b, before, i)
        slope, last_slope = load(b, after, rate), load(b, before, rate)
        turns = b.and_(b.fcmp_ordered("<", last_slope, number(0.0)), b.fcmp_ordered(">", slope, number(0.0)))
        lower = b.select(b.fcmp_ordered("<", gap, last_gap), gap, last_gap)
        depth = b.fmul(b.fmul(number(GRAZING), h), b.fsub(slope, last_slope))
        open_before = b.fcmp_ordered(">", last_gap, number(guards.tolerance))
        end_if(b.and_(b.and_(turns, open_before), b.fcmp_ordered("<", lower, depth)))

    for_each(b, guards.gaps, grazing)


def _turns(
    b: ir.IRBuilder, guards: Guards, slip: tuple[int, int], values: list[ir.Value], inputs: ir.Value
) -> ir.Value:
    """Whether a slip that slides has changed by more than `TURNING`."""
    before, after = values
    direction = [load(b, inputs, guards.first_mode + guards.rows + row) for row in slip]
    was = [load(b, before, guards.gaps + row) for row in slip]
    now = [load(b, after, guards.gaps + row) for row in slip]

    def square(parts: list[ir.Value]) -> ir.Value:
        return b.fma(parts[1], parts[1], b.fmul(parts[0], parts[0]))

    change = square([b.fsub(new, old) for new, old in zip(now, was, strict=True)])
    slides = b.fcmp_unordered("!=", square(direction), number(0.0))
    moves = b.fcmp_unordered(">", square(now), number(AT_REST**2))
    too_far = b.fcmp_unordered(">", change, b.fmul(number(TURNING**2), square(was)))
    return b.and_(b.and_(slides, moves), too_far)


def _is_finite(b: ir.IRBuilder, size: int, y: ir.Value) -> ir.Value:
    total, zero = local_array(b, 1), number(0.0)
    b.store(zero, total)
    loop(b, 0, size, lambda i: b.store(b.fadd(b.load(total, typ=DOUBLE), b.fmul(load(b, y, i), zero)), total))
    return b.fcmp_ordered("==", b.load(total, typ=DOUBLE), zero)
