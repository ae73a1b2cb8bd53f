"""The elements of a step that all methods share, as IR: state, rates, projection, and error estimate.

They include what changes in a state at the start of a step, see `BetweenSteps`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import casadi as ca

from mbd_sim.compiler.ir.builder import DOUBLE, FALSE, IRBuilder, integer, local_array, number
from mbd_sim.compiler.ir.lanes import ComponentBuilder, LaneBuilder
from mbd_sim.compiler.ir.module import Function, Module, Value
from mbd_sim.compiler.ir.vectors import Index, add_square, copy, for_each, load, store, total, weighted
from mbd_sim.compiler.lists.lowering import lower
from mbd_sim.integrators.between_steps import BetweenSteps, DelayLine, Sampler
from mbd_sim.integrators.method import ErrorEstimate, Scales


@dataclass(frozen=True, eq=False)
class ChangesBetweenSteps:
    """The delays of a system, and its samplers, each with its lowered function."""

    delays: Sequence[DelayLine]
    sampled: Sequence[tuple[Sampler, Function]]

    def results(self, b: IRBuilder) -> Value:
        """A new array for `emit`; only in the entry block of a function."""
        return local_array(b, max([1, *(len(sampler.components) for sampler, _ in self.sampled)]))

    def emit(self, b: IRBuilder, step: Value, arguments: Sequence[Value], results: Value) -> None:
        """Emit the changes of y before a step.

        :param step: its number.
        :param arguments: the addresses of t, y and the inputs.
        """
        _, y, inputs = arguments
        for delay in self.delays:
            slot = b.add(b.urem(step, integer(delay.length)), integer(delay.first))
            due = load(b, y, slot)
            store(b, load(b, inputs, delay.source), y, slot)
            store(b, due, y, delay.into)
        for sampler, function in self.sampled:
            if sampler.every == 1:
                _emit_sample(b, sampler, function, arguments, results)
                continue
            with b.if_then(b.icmp_unsigned("==", b.urem(step, integer(sampler.every)), integer(0))):
                _emit_sample(b, sampler, function, arguments, results)


def _emit_sample(
    b: IRBuilder, sampler: Sampler, function: Function, arguments: Sequence[Value], results: Value
) -> None:
    b.call(function, [*arguments, results])
    for index, component in enumerate(sampler.components):
        store(b, load(b, results, index), arguments[1], component)


def emit_samples(module: Module, between_steps: BetweenSteps | None, lanes: int = 1) -> ChangesBetweenSteps | None:
    """Emit the sampled functions; None if nothing changes between steps."""
    if between_steps is None or not (between_steps.delays or between_steps.samplers):
        return None
    lowered = [(s, lower(module, s.function, inline=False, lanes=lanes)) for s in between_steps.samplers]
    return ChangesBetweenSteps(between_steps.delays, lowered)


TINIEST = 1e-300  # keeps 0/0 out of estimates


@dataclass(frozen=True)
class System:
    """y' = rates(t, y, inputs) with `size` components, of which the first `error_size` count in error estimates.

    `projection(t, y)` or, if `projection_takes_inputs`, `projection(t, y, inputs)`, moves the state back to the
    constraints after each step; it neither changes nor stores the components in `unmoved`. If it `projects_in_place`,
    it takes no further argument for the result. If `rates` also
    `reports_conditioning`, it has a second output: where that is negative at the start of a step, the constraints are
    ill-conditioned and each further stage is projected too. The components in `still`, after the first `error_size`
    ones, have the rate zero, and no rate depends on them. Those in `held` have the rate zero, and on those in `unread`
    no rate depends. The `samples` change the state at the start of each step. `in_registers`: the arrays of a step are
    kept there, see `local_array`.
    There are `inputs_size` inputs, and the rates have `instructions` operations. Errors of components are relative to
    s + |y| with the `scales` s. A module may have several systems, with different names.
    """

    size: int
    error_size: int
    rates: Function
    projection: Function | None
    reports_conditioning: bool = False
    projection_takes_inputs: bool = False
    projects_in_place: bool = False
    unmoved: frozenset[int] = frozenset()
    still: frozenset[int] = frozenset()
    samples: ChangesBetweenSteps | None = None
    held: frozenset[int] = frozenset()
    unread: frozenset[int] = frozenset()
    in_registers: bool = False
    inputs_size: int = 0
    instructions: int = 0
    scales: Scales = ()
    name: str = ""


# Emits the error estimate of a step, given the factor h of the slopes (None: 1) and a further error to add to it.
EmitEstimate = Callable[..., None]


class KeptSteps(Protocol):
    """Emits what is kept from step to step by a method that uses earlier steps: see `mbd_sim.integrators.method`."""

    belongs: Value  # after `begin`, whether what was kept belongs to the present step, state and inputs

    def begin(self) -> None:
        """Emit what precedes the first step of a call."""

    def end(self, finite: Value) -> None:
        """Emit what follows the last step of a call: if its state is not finite, all is as it was before the call."""


class StepEmitter:
    """Emits the operations of a step on the state `y` (n,), with step size `h` in s, for one method of integration.

    `time` is the address of the time argument, and `largest_error` that of the largest error estimate so far, unless
    the emitter `estimates` none.
    """

    def __init__(
        self,
        b: IRBuilder,
        system: System,
        inputs: Value,
        h: Value,
        y: Value | None = None,
        *,
        estimates: bool = True,
        short: bool = False,
    ) -> None:
        """Allocate the arrays, but for a `y` that is given; `b` must be in the entry block of a function.

        :param short: the code of steps that are rare, in which no rates are inlined.
        """
        self.b, self.system, self.inputs, self.h, self.estimates = b, system, inputs, h, estimates
        self.short = short
        self.y = self.vector() if y is None else y
        self.time, self.largest_error = self.scalar("time"), self.scalar()
        self.history: Value | None = None  # the address of what is kept from step to step, if not behind the inputs
        self.is_estimated: Value = FALSE  # whether the error of this step is estimated
        self.index: Value = integer(0)  # the number of the step
        self.steps: Value = integer(0)  # how many the call takes
        self.kept: KeptSteps | None = None  # by a method that uses earlier steps
        self.start_slopes: Value | None = None  # the address of those at the start of a step, if they are known there
        self._projected = self.vector() if system.projection is not None else None
        self.conditioning, self._ignored = self.scalar("margin"), self.scalar("ignored")
        self._rare = self.scalar(), self.array(system.size), self.array(system.size)
        self._sampled = None if system.samples is None else system.samples.results(b)
        self._scales = list(system.scales) or [1.0] * system.size
        self._scale_array = b.constants(self._scales, self.vector, "scales")

    def vector(self, name: str = "") -> Value:
        """A new array of the size of the state; only in the entry block."""
        size, in_registers = self.system.size, self.system.in_registers
        return local_array(self.b, size, in_registers=in_registers, aligned=size > self.b.unrolled, name=name)

    def array(self, size: int, name: str = "") -> Value:
        """A new array; only in the entry block."""
        return local_array(self.b, size, aligned=size > self.b.unrolled, name=name)

    def any(self, condition: Value) -> Value:
        """Whether a condition holds, for any member if there are several."""
        return self.b.any_lane(condition) if isinstance(self.b, LaneBuilder) else condition

    def scalar(self, name: str = "") -> Value:
        """A new number in memory; only in the entry block."""
        return local_array(self.b, 1, name=name)

    def rates(self, time: Value, state: Value, slopes: Value, *, first: bool = False) -> None:
        """Evaluate the rates into `slopes`; the `first` evaluation of a step reports its conditioning.

        Where the slopes at the start of a step are known, so is the conditioning.
        """
        if first and self.start_slopes is not None:
            copy(self.b, self.system.size, self.start_slopes, slopes)
            return
        if self.short and self.system.rates.is_inlined:
            self._rates_in_call(time, state, slopes, self.conditioning if first else self._ignored)
            return
        at = self.b.by_address(time, self.time)
        reported = [self.conditioning if first else self._ignored] if self.system.reports_conditioning else []
        self.b.call(self.system.rates, [at, state, self.inputs, slopes, *reported])

    def rates_rarely(self, time: Value, state: Value, slopes: Value) -> None:
        """Evaluate the rates in steps that are rare: without another copy of the code where it is inlined elsewhere.

        Arrays whose address is passed to a call cannot be kept in registers, so those of others are copied.
        """
        if not self.system.rates.is_inlined:
            self.rates(time, state, slopes)
        else:
            self._rates_in_call(time, state, slopes, self._ignored)

    def _rates_in_call(self, time: Value, state: Value, slopes: Value, conditioning: Value) -> None:
        own_time, own_state, own_slopes = self._rare
        self.b.store(time, own_time)
        copy(self.b, self.system.size, state, own_state)
        reported = [conditioning] if self.system.reports_conditioning else []
        self.b.call(self.system.rates, [own_time, own_state, self.inputs, own_slopes, *reported], inline=False)
        copy(self.b, self.system.size, own_slopes, slopes)

    def sample(self, step: Value, time: Value) -> None:
        """Make the changes of y that precede the step of this number."""
        if self.system.samples is None or self._sampled is None:
            return
        self.b.store(time, self.time)
        self.system.samples.emit(self.b, step, [self.time, self.y, self.inputs], self._sampled)

    def project(self, time: Value, state: Value) -> None:
        """Move a state back to the constraints, in place."""
        if self.system.projection is not None and self._projected is not None:
            at, inputs = self.b.by_address(time, self.time), [self.inputs] * self.system.projection_takes_inputs
            if self.system.projects_in_place:
                self.b.call(self.system.projection, [at, state, *inputs])
                return
            self.b.call(self.system.projection, [at, state, *inputs, self._projected])
            if not self.system.unmoved:
                copy(self.b, self.system.size, self._projected, state)
                return
            for index in range(self.system.size):
                if index not in self.system.unmoved:
                    store(self.b, load(self.b, self._projected, index), state, index)

    def project_stage(self, time: Value, state: Value) -> None:
        """Move the state of a stage back to the constraints, in steps that start ill-conditioned."""
        if not self.system.reports_conditioning:
            return
        condition = self.is_ill_conditioned()
        if isinstance(self.b, LaneBuilder):
            with self.b.if_then(self.b.any_lane(condition), likely=False):
                self._project_members(time, state, condition)
        else:
            with self.b.if_then(condition, likely=False):
                self.project(time, state)

    def _project_members(self, time: Value, state: Value, condition: Value) -> None:
        """Project those members of a group for which a condition holds."""
        b, before = self.b, [load(self.b, state, index) for index in range(self.system.size)]
        self.project(time, state)
        for index, old in enumerate(before):
            store(b, b.select(condition, load(b, state, index), old), state, index)

    def is_ill_conditioned(self) -> Value:
        """Whether the first evaluation of the step reported ill-conditioned constraints."""
        return self.b.fcmp_ordered("<", self.b.load(self.conditioning, typ=DOUBLE), number(0.0))

    def stage_time(self, t: Value, c: float) -> Value:
        """t + c h."""
        return t if c == 0.0 else self.b.fadd(t, self.b.fmul(number(c), self.h))

    def scale(self, index: Index) -> Value:
        """1 / (s + |y|) for a component."""
        return self.inverse_scale(self.b, self.y, index)

    def inverse_scale(self, b: IRBuilder, state: Value, index: Index) -> Value:
        """1 / (s + |y|) for a component of a state, or several at once."""
        if len(set(self._scales)) == 1:
            scale = number(self._scales[0])
        elif isinstance(index, int) and not isinstance(b, ComponentBuilder):
            scale = number(self._scales[index])
        else:
            scale = load(b, self._scale_array, index)
        size = b.intrinsic("llvm.fabs", load(b, state, index))
        return b.fdiv(number(1.0), b.fadd(scale, size))

    def estimator(self, estimate: ErrorEstimate, slopes: list[Value]) -> EmitEstimate:
        """A function that emits the update of `largest_error` in a step whose error is estimated.

        It must be called while `y` is the state at the start of the step. A NaN counts as infinity.
        """
        if not self.estimates:
            return lambda *_: None
        fine, coarse = self.scalar(), self.scalar()

        def emit(h: Value | None, further: Value | None = None) -> None:
            b = self.b
            with b.if_then(self.is_estimated):
                value = self._estimated(estimate, slopes, fine, coarse, h)
                value = value if further is None else b.fadd(value, further)
                value = b.select(b.fcmp_unordered("uno", value, value), number(math.inf), value)
                largest = b.load(self.largest_error, typ=DOUBLE)
                b.store(b.select(b.fcmp_ordered(">", value, largest), value, largest), self.largest_error)

        return emit

    def _estimated(
        self, estimate: ErrorEstimate, slopes: list[Value], fine: Value, coarse: Value, h: Value | None
    ) -> Value:
        """The estimated error: the norm of the fine estimate, or Hairer's combination with the coarse one."""
        b = self.b

        def component(i: Index) -> None:
            scale = self.scale(i) if h is None else b.fmul(h, self.scale(i))
            for into, weights in ((fine, estimate.fine), (coarse, estimate.coarse)):
                if weights:
                    add_square(b, into, b.fmul(scale, total(b, weighted(weights, slopes), i)))

        b.store(number(0.0), fine)
        b.store(number(0.0), coarse)
        for_each(b, self.system.error_size, component)
        small = b.load(fine, typ=DOUBLE)
        if not estimate.coarse:
            return self.square_root(small)
        large = b.fmul(number(estimate.weight), b.load(coarse, typ=DOUBLE))
        return b.fdiv(small, self.square_root(b.fadd(b.fadd(small, large), number(TINIEST))))

    def square_root(self, value: Value) -> Value:
        """The square root of a double."""
        return self.b.intrinsic("llvm.sqrt", value)


# Emits a function that is not inlined, whose arguments and results have these names for readers of generated C.
Emit = Callable[[ca.Function, Sequence[str], Sequence[str]], Function]
EmitStep = Callable[[Value], None]  # emits a step from the time (the argument) on: it moves the emitter's y by h
Prepare = Callable[
    [StepEmitter], EmitStep
]  # allocates the arrays of a method and returns the function that emits its step
