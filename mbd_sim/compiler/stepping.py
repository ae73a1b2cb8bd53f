"""The loop over steps that every method shares, as IR around the rates of a system."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import llvmlite.ir as ir

from mbd_sim.compiler.ir_types import (
    DOUBLE,
    INT,
    POINTER,
    element,
    integer,
    local_array,
    number,
)
from mbd_sim.compiler.ir_vectors import (
    add_squares,
    copy,
    each,
    load,
    loop,
    store,
    total,
    weighted,
)
from mbd_sim.compiler.simd_builder import LaneBuilder, new_builder
from mbd_sim.integrators.estimate import Estimate

TINIEST = 1e-300  # keeps 0/0 out of estimates
EVERY = 8  # steps of which one is estimated, a power of two; estimating each costs a tenth of a step of RK4


@dataclass(frozen=True)
class System:
    """y' = rates(t, y, inputs), with `settle(t, y)` after each step where it is given; `size` components.

    Where it is `settling_by_inputs`, `settle` takes the inputs as well.
    The first `watched` of them count in estimates of the error. Where `rates` is `judging`, it has a second output: a
    negative one at the start of a step asks for `settle` before each further stage as well.
    """

    size: int
    watched: int
    rates: ir.Function
    settle: ir.Function | None
    judging: bool = False
    settling_by_inputs: bool = False


Estimator = Callable[..., None]


class Frame:
    """What is at hand while a step is emitted: the state `y`, the step `h`, and the functions of the system."""

    def __init__(self, b: ir.IRBuilder, system: System, inputs: ir.Value, h: ir.Value) -> None:
        self.b, self.system, self.inputs, self.h = b, system, inputs, h
        self.y, self.time, self.worst = self.vector(), self.scalar(), self.scalar()
        self.sampled: ir.Value = ir.Constant(ir.IntType(1), 0)
        self._settled = self.vector() if system.settle is not None else None
        self._verdict, self._ignored = self.scalar(), self.scalar()

    def vector(self) -> ir.Value:
        """A new array of the size of the state. Only for the entry block, as all arrays."""
        return local_array(self.b, self.system.size)

    def scalar(self) -> ir.Value:
        """A new number in memory."""
        return local_array(self.b, 1)

    def rates(self, moment: ir.Value, at: ir.Value, slopes: ir.Value, *, first: bool = False) -> None:
        """Slopes = f(moment, at); the `first` of a step judges for all of them."""
        self.b.store(moment, self.time)
        judged = [self._verdict if first else self._ignored] if self.system.judging else []
        self.b.call(self.system.rates, [self.time, at, self.inputs, slopes, *judged])

    def settle(self, moment: ir.Value, array: ir.Value) -> None:
        """Lead a state back to where the system wants it."""
        if self.system.settle is not None:
            self.b.store(moment, self.time)
            more = [self.inputs] if self.system.settling_by_inputs else []
            self.b.call(self.system.settle, [self.time, array, *more, self._settled])
            copy(self.b, self.system.size, self._settled, array)

    def settle_stage(self, moment: ir.Value, array: ir.Value) -> None:
        """The same for a stage, if the first evaluation of the step asked for it."""
        if not self.system.judging:
            return
        asked = self.asked_to_settle()
        if isinstance(self.b, LaneBuilder):
            with self.b.if_then(self.b.any_lane(asked), likely=False):
                self._settle_some(moment, array, asked)
        else:
            with self.b.if_then(asked, likely=False):
                self.settle(moment, array)

    def _settle_some(self, moment: ir.Value, array: ir.Value, asked: ir.Value) -> None:
        """Lead back those members that asked for it."""
        b, before = self.b, [load(self.b, array, index) for index in range(self.system.size)]
        self.settle(moment, array)
        for index, old in enumerate(before):
            store(b, b.select(asked, load(b, array, index), old), array, index)

    def asked_to_settle(self) -> ir.Value:
        """Whether the first evaluation of the step was negative in its judgement."""
        return self.b.fcmp_ordered("<", self.b.load(self._verdict, typ=DOUBLE), number(0.0))

    def later(self, t: ir.Value, c: float) -> ir.Value:
        """t + c h."""
        return t if c == 0.0 else self.b.fadd(t, self.b.fmul(number(c), self.h))

    def scale(self, index: int | ir.Value) -> ir.Value:
        """1 / (1 + |y|) of a component."""
        size = self.b.call(self.b.module.declare_intrinsic("llvm.fabs", [DOUBLE]), [load(self.b, self.y, index)])
        return self.b.fdiv(number(1.0), self.b.fadd(number(1.0), size))

    def estimator(self, estimate: Estimate, slopes: list[ir.Value]) -> Estimator:
        """A function that emits the estimate, given the factor h of the slopes, and what else counts as error.

        It takes every `EVERY`th step into the `worst`; `y` must still be the step's start.
        """
        fine, coarse = self.scalar(), self.scalar()

        def component(i: int | ir.Value, h: ir.Value | None) -> None:
            b = self.b
            scale = self.scale(i) if h is None else b.fmul(h, self.scale(i))
            for into, weights in ((fine, estimate.fine), (coarse, estimate.coarse)):
                if weights:
                    add_squares(b, into, b.fmul(scale, total(b, weighted(weights, slopes), i)))

        def found(h: ir.Value | None) -> ir.Value:
            b = self.b
            b.store(number(0.0), fine)
            b.store(number(0.0), coarse)
            each(b, self.system.watched, lambda i: component(i, h))
            small = b.load(fine, typ=DOUBLE)
            if not estimate.coarse:
                return self.root(small)
            large = b.fmul(number(estimate.weight), b.load(coarse, typ=DOUBLE))
            return b.fdiv(small, self.root(b.fadd(b.fadd(small, large), number(TINIEST))))

        def emit(h: ir.Value | None, more: ir.Value | None = None) -> None:
            b = self.b
            with b.if_then(self.sampled):
                value = found(h) if more is None else b.fadd(found(h), more)
                value = b.select(b.fcmp_unordered("uno", value, value), number(math.inf), value)
                most = b.load(self.worst, typ=DOUBLE)
                b.store(b.select(b.fcmp_ordered(">", value, most), value, most), self.worst)

        return emit

    def root(self, value: ir.Value) -> ir.Value:
        """The square root."""
        return self.b.call(self.b.module.declare_intrinsic("llvm.sqrt", [DOUBLE]), [value])


Step = Callable[[ir.Value], None]
Prepare = Callable[[Frame], Step]


def emit_advance(module: ir.Module, system: System, prepare: Prepare) -> ir.Function:
    """Emit `i64 advance(double* y, double* inputs, i64 first, double h, i64 steps)` and return `estimating_advance`.

    Step k starts at time k h, counted from `first`. Both return 1 where the new state is finite; otherwise they
    return 0 and leave y as it was. `estimating_advance` has a sixth argument, `double* estimate`: it becomes the
    largest of itself and the estimates of the errors of every `EVERY`th step, infinity for what is not a number.

    `prepare` allocates what a method needs and returns a function that emits a step: given the time, it moves the
    frame's y on by h.
    """
    arguments = [POINTER, POINTER, INT, DOUBLE, INT]
    function = ir.Function(module, ir.FunctionType(INT, [*arguments, POINTER]), "estimating_advance")
    state, inputs, first, h, steps, largest = function.args
    for argument in (state, inputs, largest):
        argument.add_attribute("noalias")
    b = ir.IRBuilder(function.append_basic_block("entry"))
    frame = Frame(b, system, inputs, h)
    finite = _emit_steps(frame, prepare, state, largest, first, h, steps)
    with b.if_then(finite):
        copy(b, system.size, frame.y, state)
    b.ret(b.zext(finite, INT))

    plain = ir.Function(module, ir.FunctionType(INT, arguments), "advance")
    b = ir.IRBuilder(plain.append_basic_block("entry"))
    unread = local_array(b, 1)
    b.store(number(0.0), unread)
    b.ret(b.call(function, [*plain.args, unread]))
    return function


def _emit_steps(
    frame: Frame, prepare: Prepare, state: ir.Value, largest: ir.Value, first: ir.Value, h: ir.Value, steps: ir.Value
) -> ir.Value:
    """Emit the loop over the steps, from `state` to the frame's y; returns whether that is finite."""
    b, size = frame.b, frame.system.size
    step, doubt = prepare(frame), frame.scalar()
    copy(b, size, state, frame.y)
    b.store(b.load(largest, typ=DOUBLE), frame.worst)

    def one_step(index: ir.Value) -> None:
        count = b.add(first, index)
        frame.sampled = b.icmp_unsigned("==", b.and_(count, integer(EVERY - 1)), integer(0))
        step(b.fmul(b.sitofp(count, DOUBLE), h))
        frame.settle(b.fmul(b.sitofp(b.add(count, integer(1)), DOUBLE), h), frame.y)

    loop(b, 0, steps, one_step)
    b.store(b.load(frame.worst, typ=DOUBLE), largest)
    b.store(number(0.0), doubt)
    zero = number(0.0)
    each(b, size, lambda i: b.store(b.fadd(b.load(doubt, typ=DOUBLE), b.fmul(load(b, frame.y, i), zero)), doubt))
    return b.fcmp_ordered("==", b.load(doubt, typ=DOUBLE), zero)


def emit_advance_members(
    module: ir.Module, system: System, prepare: Prepare, lanes: int, inputs_size: int
) -> ir.Function:
    """Emit `advance_members(y, inputs, estimates, alive, i64 first, double h, i64 steps, i64 from, i64 to)`.

    It goes through the groups of `lanes` members from one to before another. A group has its numbers together, each
    with one double a member. A member whose state would not stay finite keeps the one it has, then and ever after:
    its `alive`, 1 until then, becomes 0. See `emit_advance` for the rest.
    """
    arguments = [POINTER] * 4 + [INT, DOUBLE, INT]
    group = ir.Function(module, ir.FunctionType(ir.VoidType(), arguments), "advance_group")
    group.linkage = "internal"
    group.attributes.add("noinline")
    y, inputs, estimates, alive, first, h, steps = group.args
    for argument in group.args[:4]:
        argument.add_attribute("noalias")
    b = new_builder(group.append_basic_block("entry"), lanes)
    frame = Frame(b, system, inputs, h)
    finite = _emit_steps(frame, prepare, y, estimates, first, h, steps)
    living = b.load(alive, typ=DOUBLE)
    moved = b.and_(finite, b.fcmp_ordered("!=", living, number(0.0)))
    each(b, system.size, lambda i: store(b, b.select(moved, load(b, frame.y, i), load(b, y, i)), y, i))
    b.store(b.select(moved, number(1.0), number(0.0)), alive)
    b.ret_void()

    every = ir.Function(module, ir.FunctionType(ir.VoidType(), [*arguments, INT, INT]), "advance_members")
    b = new_builder(every.append_basic_block("entry"), lanes)
    *arrays, first, h, steps, start, beyond = every.args
    sizes = (system.size, inputs_size, 1, 1)

    def one_group(index: ir.Value) -> None:
        own = [element(b, a, b.mul(index, integer(size))) for a, size in zip(arrays, sizes, strict=True)]
        b.call(group, [*own, first, h, steps])

    loop(b, start, beyond, one_group)
    b.ret_void()
    return every
