"""The loop over steps, as IR, which all methods share."""

from __future__ import annotations

from mbd_sim.compiler.ir.builder import DOUBLE, INT, IRBuilder, element, integer, local_array, number
from mbd_sim.compiler.ir.lanes import new_builder
from mbd_sim.compiler.ir.module import POINTER, VOID, Function, FunctionType, Module, Value
from mbd_sim.compiler.ir.vectors import cells, copy, folded, for_each, load, loop, store
from mbd_sim.compiler.steps.emitter import Prepare, StepEmitter, System

ESTIMATED_EVERY = 8  # steps, a power of two; an estimate in each step would cost a tenth of a step of RK4


def emit_advance(module: Module, system: System, prepare: Prepare) -> Function:
    """Emit `i64 advance(double* y, double* inputs, i64 first, double h, i64 steps)` and return `estimating_advance`.

    Step k starts at time k h, counted from `first`. Both return 1 if the new state is finite; otherwise they return 0
    and leave y unchanged. `estimating_advance` has a sixth argument, `double* estimate`: it becomes the largest of its
    previous value and the error estimates of every eighth step, infinity for a NaN.

    `prepare` allocates the arrays of a method and returns the function that emits a step.
    """
    arguments = [POINTER, POINTER, INT, DOUBLE, INT]
    function = Function(module, FunctionType(INT, [*arguments, POINTER]), "estimating_advance")
    state, inputs, first, h, steps, estimate = function.args
    function.noalias = True
    b = IRBuilder(function.append_basic_block("entry"))
    emitter = StepEmitter(b, system, inputs, h)
    finite = _emit_steps(emitter, prepare, state, estimate, first, h, steps)
    with b.if_then(finite):
        copy(b, system.size, emitter.y, state)
    b.ret(b.zext(finite, INT))
    emit_plain_advance(module, function)
    return function


def emit_plain_advance(module: Module, estimating: Function) -> None:
    """Emit `advance`, which calls `estimating_advance` and drops the estimate."""
    plain = Function(module, FunctionType(INT, [POINTER, POINTER, INT, DOUBLE, INT]), "advance")
    b = IRBuilder(plain.append_basic_block("entry"))
    unread = local_array(b, 1)
    b.store(number(0.0), unread)
    b.ret(b.call(estimating, [*plain.args, unread]))


def _emit_steps(
    emitter: StepEmitter,
    prepare: Prepare,
    state: Value,
    estimate: Value,
    first: Value,
    h: Value,
    steps: Value,
) -> Value:
    """Emit the loop over the steps, from `state` to the emitter's y; returns whether that is finite."""
    b, size = emitter.b, emitter.system.size
    emit_step, sums = prepare(emitter), emitter.array(cells(b, size))
    copy(b, size, state, emitter.y)
    b.store(b.load(estimate, typ=DOUBLE), emitter.largest_error)
    emitter.index, emitter.steps = first, steps
    if emitter.kept is not None:
        emitter.kept.begin()

    def one_step(index: Value) -> None:
        emitter.index = count = b.add(first, index)
        emitter.is_estimated = b.icmp_unsigned("==", b.and_(count, integer(ESTIMATED_EVERY - 1)), integer(0))
        time = b.fmul(b.sitofp(count, DOUBLE), h)
        emitter.sample(count, time)
        emit_step(time)
        emitter.project(b.fmul(b.sitofp(b.add(count, integer(1)), DOUBLE), h), emitter.y)

    loop(b, 0, steps, one_step)
    b.store(b.load(emitter.largest_error, typ=DOUBLE), estimate)
    finite = emit_is_finite(b, size, emitter.y, sums)
    emitter.index = b.add(first, steps)
    if emitter.kept is not None:
        emitter.kept.end(finite)
    return finite


def emit_is_finite(b: IRBuilder, size: int, y: Value, sums: Value) -> Value:
    """Emit whether a state is finite; `sums` is the address of as many numbers as `cells` says."""
    zero = number(0.0)
    # 0 y is NaN if y is not finite.
    total = folded(b, size, sums, lambda w, sum_of_zeros, i: w.fadd(sum_of_zeros, w.fmul(load(w, y, i), zero)))
    return b.fcmp_ordered("==", total, zero)


def emit_advance_members(module: Module, system: System, prepare: Prepare, lanes: int, inputs_size: int) -> Function:
    """Emit `advance_members(y, inputs, estimates, alive, i64 first, double h, i64 steps, i64 from, i64 to)`.

    It advances the groups of `lanes` members from `from` to before `to`. The numbers of a group are contiguous, with
    one double for each member. A member whose state would not stay finite keeps its state from then on: its `alive`, 1
    until then, becomes 0. See `emit_advance` for the rest.
    """
    arguments = [POINTER] * 4 + [INT, DOUBLE, INT]
    group = Function(module, FunctionType(VOID, arguments), "advance_group")
    group.linkage = "internal"
    group.attributes = ["noinline"]
    y, inputs, estimates, alive, first, h, steps = group.args
    group.noalias = True
    b = new_builder(group.append_basic_block("entry"), lanes)
    emitter = StepEmitter(b, system, inputs, h)
    finite = _emit_steps(emitter, prepare, y, estimates, first, h, steps)
    was_alive = b.load(alive, typ=DOUBLE)
    moved = b.and_(finite, b.fcmp_ordered("!=", was_alive, number(0.0)))
    for_each(b, system.size, lambda i: store(b, b.select(moved, load(b, emitter.y, i), load(b, y, i)), y, i))
    b.store(b.select(moved, number(1.0), number(0.0)), alive)
    b.ret_void()
    return _emit_groups(module, group, lanes, (system.size, inputs_size, 1, 1))


def _emit_groups(module: Module, group: Function, lanes: int, sizes: tuple[int, ...]) -> Function:
    """Emit the loop over groups; `sizes` are the numbers of components of the arrays of a member."""
    function = Function(module, FunctionType(VOID, [*group.function_type.args, INT, INT]), "advance_members")
    b = new_builder(function.append_basic_block("entry"), lanes)
    *arrays, first, h, steps, start, beyond = function.args

    def one_group(index: Value) -> None:
        addresses = [element(b, a, b.mul(index, integer(size))) for a, size in zip(arrays, sizes, strict=True)]
        b.call(group, [*addresses, first, h, steps])

    loop(b, start, beyond, one_group)
    b.ret_void()
    return function
