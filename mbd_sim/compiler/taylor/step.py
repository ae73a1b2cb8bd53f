"""The loop over expansions of a Taylor method, as IR."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import casadi as ca

from mbd_sim.compiler.ir.builder import DOUBLE, INT, IRBuilder, element, integer, number
from mbd_sim.compiler.ir.module import BOOL, POINTER, Function, FunctionType, Module, Value
from mbd_sim.compiler.ir.vectors import cells, copy, load, loop, store
from mbd_sim.compiler.lists.instruction_list import InstructionList
from mbd_sim.compiler.lists.lowering import lower
from mbd_sim.compiler.steps.emitter import StepEmitter, System
from mbd_sim.compiler.steps.loop import emit_is_finite, emit_plain_advance
from mbd_sim.compiler.steps.runge_kutta import CalledStep
from mbd_sim.compiler.taylor.expansion import TaylorExpansion, expansion
from mbd_sim.compiler.taylor.recursion import emit_recursion, stack_size
from mbd_sim.compiler.taylor.rules import NotAnalyticError, series_of, turning_points
from mbd_sim.integrators.explicit import Taylor

LARGEST_EXPANSION = 2_000_000  # bytes; 100 rods take half of them, and threads have 8 MB of stack
SPAN, POSITION, NEXT, SIZE, VECTORS = range(5)  # the numbers at the start of a history


class TaylorHistory:
    """The coefficients of an expansion and what they belong to, in memory behind the inputs of the system.

    First are the number of steps for which the expansion holds (`SPAN`), how many of them were taken (`POSITION`), and
    the number `NEXT` and the `SIZE` in s of the step that follows. Then come the state and the inputs at its start, and
    the coefficients.

    They count as used up if that step, its size, the state or an input has changed in the meantime, for example by a
    command. So whoever sets a state or an input need not know of the history.

    A new expansion is written into memory of the call, `fresh`, and kept only if the new state is finite.
    """

    def __init__(self, emitter: StepEmitter, method: Taylor) -> None:
        """Allocate the arrays; the emitter's builder must be in the entry block of a function."""
        b, size, inputs_size = emitter.b, emitter.system.size, emitter.system.inputs_size
        self._emitter, self._count = emitter, (1 + method.order) * size
        self._start = element(b, emitter.inputs, inputs_size)
        self._kept_y, self._kept_inputs = element(b, self._start, VECTORS), element(b, self._start, VECTORS + size)
        self._kept = element(b, self._start, VECTORS + size + inputs_size)
        self.fresh, self._changed = emitter.array(self._count), emitter.scalar()
        self.span, self.position, self.is_fresh = (b.alloca(INT) for _ in range(3))

    def begin(self) -> None:
        """Read the history if it belongs to this state; otherwise the expansion is used up."""
        emitter, b = self._emitter, self._emitter.b
        b.store(number(0.0), self._changed)
        self._compare(load(b, self._start, NEXT), b.sitofp(emitter.index, DOUBLE))
        self._compare(load(b, self._start, SIZE), emitter.h)
        for size, kept, present in (
            (emitter.system.size, self._kept_y, emitter.y),
            (emitter.system.inputs_size, self._kept_inputs, emitter.inputs),
        ):
            loop(b, 0, size, partial(self._compare_entry, kept, present))
        same = b.fcmp_ordered("==", b.load(self._changed, typ=DOUBLE), number(0.0))
        for address, index in ((self.span, SPAN), (self.position, POSITION)):
            b.store(b.select(same, b.fptosi(load(b, self._start, index), INT), integer(0)), address)
        b.store(integer(0), self.is_fresh)

    def coefficients(self) -> Value:
        """The address of the coefficients, c_0 first."""
        is_fresh = self._emitter.b.icmp_signed("!=", self._emitter.b.load(self.is_fresh, typ=INT), integer(0))
        return self._emitter.b.select(is_fresh, self.fresh, self._kept)

    def replace(self, span: Value) -> None:
        """Emit the beginning of the expansion in `fresh`, which holds for a number of steps."""
        b = self._emitter.b
        b.store(span, self.span)
        b.store(integer(0), self.position)
        b.store(integer(1), self.is_fresh)

    def clear(self) -> None:
        """Emit that there is no expansion, with the same numbers however the steps are divided into calls."""
        b = self._emitter.b
        loop(b, 0, self._count, lambda i: store(b, number(0.0), self.fresh, i))
        self.replace(integer(0))

    def end(self) -> None:
        """Say what the history belongs to, after steps to a finite state."""
        emitter, b = self._emitter, self._emitter.b
        with b.if_then(b.icmp_signed("!=", b.load(self.is_fresh, typ=INT), integer(0))):
            copy(b, self._count, self.fresh, self._kept)
        for address, index in ((self.span, SPAN), (self.position, POSITION)):
            store(b, b.sitofp(b.load(address, typ=INT), DOUBLE), self._start, index)
        store(b, b.sitofp(emitter.index, DOUBLE), self._start, NEXT)
        store(b, emitter.h, self._start, SIZE)
        copy(b, emitter.system.size, emitter.y, self._kept_y)
        copy(b, emitter.system.inputs_size, emitter.inputs, self._kept_inputs)

    def _compare_entry(self, kept: Value, present: Value, index: Value) -> None:
        self._compare(load(self._emitter.b, kept, index), load(self._emitter.b, present, index))

    def _compare(self, kept: Value, present: Value) -> None:
        b = self._emitter.b
        changed = b.fcmp_unordered("!=", kept, present)
        b.store(b.select(changed, number(1.0), b.load(self._changed, typ=DOUBLE)), self._changed)


UNROLLED = 1000  # products of an expansion up to which it has no loops over the order


def without_expansion(rates: ca.Function, order: int, name_of: Callable[[int], str]) -> str:
    """Why the solution has no expansion, or one that is too long, or ""; `name_of` names a row of the rates."""
    try:
        size = stack_size(series_of(rates), order)
    except NotAnalyticError as error:
        return (
            f"cannot treat forces and laws that are not smooth: {name_of(error.result)} depends on "
            f"{error.operation}(…), as of stops, tables and 'where'"
        )
    if size > LARGEST_EXPANSION:
        return f"cannot treat so many parts: an expansion would need {size / 1e6:.1f} MB of the stack"
    return ""


def emit_taylor_advance(module: Module, system: System, method: Taylor, rates: ca.Function) -> Function:
    """Emit `advance` and return `estimating_advance`: see `emit_advance`.

    Steps within an expansion are taken at once, and the state is its polynomial there. It is moved back to the
    constraints where the expansion ends. Estimates are those of each expansion: the last two terms. With functions that
    decay exponentially, an expansion holds for one step at most: its coefficients may say nothing of what follows.
    With |x| it ends before the step at whose end x has another sign, which the other method takes.

    :raises NotAnalyticError: the solution has no series.
    """
    series = series_of(rates)
    if series.products(method.order) > UNROLLED:
        expand = emit_recursion(module, series, system.size, method.order)
    else:
        expand = lower(module, expansion(series, system.size, method.order), inline=False)
    if series.has_exponentials:
        method = replace(method, most_steps=1)
    turning = turning_points(rates)
    if turning is not None:
        method = replace(method, most_parts=1)  # so that an expansion ends with a step
    arguments = [POINTER, POINTER, INT, DOUBLE, INT]
    function = Function(module, FunctionType(INT, [*arguments, POINTER]), "estimating_advance")
    function.noalias = True
    _, inputs, _, h, _, _ = function.args
    emitter = StepEmitter(IRBuilder(function.append_basic_block("entry")), system, inputs, h)
    turns = None if turning is None else _Turns(emitter, lower(module, turning, inline=False), _results(turning))
    _TaylorLoop(emitter, method, expand, turns).emit(function)
    emit_plain_advance(module, function)
    return function


def _results(function: InstructionList) -> int:
    return sum(instruction.operation == ca.OP_OUTPUT for instruction in function.instructions)


class _Turns:
    """A function of (t, y, inputs) with the arguments of |x|, and memory for their values at the start and later."""

    def __init__(self, emitter: StepEmitter, function: Function, size: int) -> None:
        self.function, self.size = function, size
        self.before, self.after = emitter.array(size), emitter.array(size)
        self.steps, self.ends = emitter.b.alloca(INT), emitter.b.alloca(INT)


class _TaylorLoop:
    """Emits steps of a Taylor method.

    `taken` steps of the call are complete, and `offset` s of the next one, where that is divided.
    """

    def __init__(self, emitter: StepEmitter, method: Taylor, expand: Function, turns: _Turns | None) -> None:
        self._emitter, self._method, self._expand, self._turns = emitter, method, expand, turns
        self._history, self._otherwise = TaylorHistory(emitter, method), CalledStep(method.otherwise, emitter)
        self._slopes, self._expansion = emitter.vector(), TaylorExpansion(emitter, method)
        self._taken, self._count = emitter.b.alloca(INT), emitter.system.size
        self._offset, self._sums = emitter.scalar(), emitter.array(cells(emitter.b, self._count))

    def emit(self, function: Function) -> None:
        """Emit the function's body."""
        state, _, first, _, steps, estimate = function.args
        emitter, b = self._emitter, self._emitter.b
        copy(b, self._count, state, emitter.y)
        copy(b, 1, estimate, emitter.largest_error)
        emitter.index = first
        self._history.begin()
        b.store(integer(0), self._taken)
        b.store(number(0.0), self._offset)
        head, inside, after = (b.append_basic_block(name) for name in ("head", "inside", "after"))
        b.branch(head)
        b.position_at_end(head)
        taken = b.load(self._taken, typ=INT)
        b.cbranch(b.icmp_signed("<", taken, steps), inside, after)
        b.position_at_end(inside)
        span, position = (b.load(address, typ=INT) for address in (self._history.span, self._history.position))
        with b.if_else(b.icmp_signed("<", position, span), likely=True) as (then, otherwise):
            with then:
                self._follow(b.add(first, taken), b.sub(steps, taken), b.sub(span, position))
            with otherwise:
                self._begin(b.add(first, taken))
        b.branch(head)
        b.position_at_end(after)
        finite = emit_is_finite(b, self._count, emitter.y, self._sums)
        copy(b, 1, emitter.largest_error, estimate)
        emitter.index = b.add(first, steps)
        with b.if_then(finite):
            copy(b, self._count, emitter.y, state)
            self._history.end()
        b.ret(b.zext(finite, INT))

    def _follow(self, index: Value, wanted: Value, left: Value) -> None:
        """Emit as many steps as the expansion holds for, or the call wants."""
        emitter, b, history = self._emitter, self._emitter.b, self._history
        steps = b.select(b.icmp_signed("<", wanted, left), wanted, left)
        position = b.add(b.load(history.position, typ=INT), steps)
        b.store(position, history.position)
        b.store(b.add(b.load(self._taken, typ=INT), steps), self._taken)
        self._expansion.evaluate(history.coefficients(), b.fmul(b.sitofp(position, DOUBLE), emitter.h))
        with b.if_then(b.icmp_signed("==", steps, left)):
            emitter.project(b.fmul(b.sitofp(b.add(index, steps), DOUBLE), emitter.h), emitter.y)

    def _begin(self, index: Value) -> None:
        """Emit an expansion at the state, and the rest of the step if that ends later than the expansion."""
        emitter, method, b = self._emitter, self._method, self._emitter.b
        offset = b.load(self._offset, typ=DOUBLE)
        time = b.fadd(b.fmul(b.sitofp(index, DOUBLE), emitter.h), offset)
        rest = b.fsub(emitter.h, offset)
        b.store(time, emitter.time)
        b.call(self._expand, [emitter.time, emitter.y, emitter.inputs, self._history.fresh])
        self._expansion.measure(self._history.fresh)
        longest = self._expansion.longest()
        if self._turns is not None:
            longest = self._before_turns(self._turns, time, longest)
        usable = b.fcmp_ordered(">=", longest, b.fmul(emitter.h, number(1.0 / method.most_parts)))
        usable = b.or_(usable, b.fcmp_ordered(">", offset, number(0.0)))
        if emitter.system.reports_conditioning:
            emitter.rates(time, emitter.y, self._slopes, first=True)
            usable = b.and_(usable, b.not_(emitter.is_ill_conditioned()))
        with b.if_else(usable, likely=True) as (then, otherwise):
            with then, b.if_else(b.fcmp_unordered("<", longest, rest), likely=False) as (shorter, longer):
                with shorter:
                    self._divide(index, offset, rest, longest)
                with longer:
                    self._extend(index, offset, rest, longest)
            with otherwise:
                self._step_otherwise(index, time)

    def _before_turns(self, turns: _Turns, time: Value, longest: Value) -> Value:
        """The longest τ; if an argument of |x| changes its sign, half a step more than until the step that it ends."""
        emitter, b = self._emitter, self._emitter.b
        b.call(turns.function, [emitter.time, emitter.y, emitter.inputs, turns.before])
        b.store(integer(0), turns.steps)
        b.store(integer(0), turns.ends)
        head, inside, after = (b.append_basic_block(name) for name in ("turns", "turns_inside", "turns_after"))
        b.branch(head)
        b.position_at_end(head)
        following = b.add(b.load(turns.steps, typ=INT), integer(1))
        tau = b.fmul(b.sitofp(following, DOUBLE), emitter.h)
        goes_on = b.and_(
            b.fcmp_ordered("<=", tau, longest), b.icmp_signed("<=", following, integer(self._method.most_steps))
        )
        goes_on = b.and_(goes_on, b.icmp_signed("==", b.load(turns.ends, typ=INT), integer(0)))
        b.cbranch(goes_on, inside, after)
        b.position_at_end(inside)
        self._expansion.evaluate(self._history.fresh, tau)
        b.store(b.fadd(time, tau), emitter.time)
        b.call(turns.function, [emitter.time, emitter.y, emitter.inputs, turns.after])
        same = Value(BOOL, "true")
        for index in range(turns.size):
            product = b.fmul(load(b, turns.before, index), load(b, turns.after, index))
            same = b.and_(same, b.fcmp_ordered(">", product, number(0.0)))
        b.store(b.select(same, following, b.load(turns.steps, typ=INT)), turns.steps)
        b.store(b.select(same, integer(0), integer(1)), turns.ends)
        b.branch(head)
        b.position_at_end(after)
        copy(b, self._count, self._history.fresh, emitter.y)  # the state at the start
        b.store(time, emitter.time)
        shorter = b.fmul(b.fadd(b.sitofp(b.load(turns.steps, typ=INT), DOUBLE), number(0.5)), emitter.h)
        return b.select(b.icmp_signed("==", b.load(turns.ends, typ=INT), integer(0)), longest, shorter)

    def _extend(self, index: Value, offset: Value, rest: Value, longest: Value) -> None:
        """Emit the span of an expansion that holds for whole steps, or the end of a divided step."""
        emitter, b, history = self._emitter, self._emitter.b, self._history
        whole = b.fcmp_ordered("==", offset, number(0.0))
        with b.if_else(whole, likely=True) as (then, otherwise):
            with then:
                steps = b.fdiv(longest, emitter.h)
                most = number(float(self._method.most_steps))
                steps = b.select(b.fcmp_ordered("<", steps, most), steps, most)
                span = b.fptosi(steps, INT)
                history.replace(span)
                self._expansion.estimate(b.fmul(b.sitofp(span, DOUBLE), emitter.h))
            with otherwise:
                self._expansion.evaluate(history.fresh, rest)
                self._expansion.estimate(rest)
                self._complete(index)

    def _divide(self, index: Value, offset: Value, rest: Value, longest: Value) -> None:
        """Emit a part of a step; the last one of as many as there may be ends the step in any case."""
        emitter, method, b = self._emitter, self._method, self._emitter.b
        least = b.fmul(emitter.h, number(1.0 / method.most_parts))
        part = b.select(b.fcmp_ordered(">", longest, least), longest, least)
        ends = b.fcmp_unordered(">=", part, rest)
        part = b.select(ends, rest, part)
        self._expansion.evaluate(self._history.fresh, part)
        self._expansion.estimate(part)
        b.store(b.fadd(offset, part), self._offset)
        with b.if_then(ends):
            self._complete(index)

    def _step_otherwise(self, index: Value, time: Value) -> None:
        """Emit a step of the other method."""
        emitter = self._emitter
        emitter.is_estimated = Value(BOOL, "true")
        if not emitter.system.reports_conditioning:
            emitter.rates(time, emitter.y, self._slopes, first=True)
        self._otherwise.emit(time, self._slopes)
        self._complete(index)

    def _complete(self, index: Value) -> None:
        """Emit the end of a step after which a new expansion follows."""
        emitter, b = self._emitter, self._emitter.b
        emitter.project(b.fmul(b.sitofp(b.add(index, integer(1)), DOUBLE), emitter.h), emitter.y)
        b.store(number(0.0), self._offset)
        self._history.clear()
        b.store(b.add(b.load(self._taken, typ=INT), integer(1)), self._taken)
