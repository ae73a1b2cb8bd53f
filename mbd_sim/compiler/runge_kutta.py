"""The stepping loop of an explicit Runge–Kutta method, as IR around the rates of a system."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import llvmlite.ir as ir

from mbd_sim.compiler.types import DOUBLE, INT, POINTER, element, integer, local_array, number
from mbd_sim.integrators.tableau import Tableau

UNROLLED = 40  # components up to which state vectors are unrolled into registers


@dataclass(frozen=True)
class System:
    """y' = rates(t, y, inputs), with `settle(t, y)` after each step where it is given; `size` components.

    Where `rates` is `judging`, it has a second output: a negative one at the start of a step asks for `settle` before
    each further stage as well.
    """

    size: int
    rates: ir.Function
    settle: ir.Function | None
    judging: bool = False


def emit_advance(module: ir.Module, system: System, method: Tableau) -> ir.Function:
    """Emit `i64 advance(double* y, double* inputs, i64 first, double h, i64 steps)`.

    Step k starts at time k h, counted from `first`. It returns 1 where the new state is finite; otherwise it
    returns 0 and leaves y as it was.
    """
    signature = ir.FunctionType(INT, [POINTER, POINTER, INT, DOUBLE, INT])
    function = ir.Function(module, signature, "advance")
    state, inputs, first, h, steps = function.args
    state.add_attribute("noalias")
    inputs.add_attribute("noalias")
    b = ir.IRBuilder(function.append_basic_block("entry"))
    y, time = local_array(b, system.size), local_array(b, 1)
    k = [local_array(b, system.size) for _ in range(method.stages)]
    trial, settled = local_array(b, system.size), local_array(b, system.size)
    verdict, ignored = local_array(b, 1), local_array(b, 1)
    _each(b, system.size, lambda i: b.store(_load(b, state, i), element(b, y, i)))

    def settle(array: ir.Value) -> None:
        b.call(system.settle, [time, array, settled])
        _each(b, system.size, lambda i: b.store(_load(b, settled, i), element(b, array, i)))

    def one_step(index: ir.Value) -> None:
        t = b.fmul(b.sitofp(b.add(first, index), DOUBLE), h)
        for stage in range(method.stages):
            moment = t if method.c[stage] == 0.0 else b.fadd(t, b.fmul(number(method.c[stage]), h))
            b.store(moment, time)
            at = y
            if any(method.a[stage]):
                at = trial
                _combine(b, system.size, trial, y, h, method.a[stage], k)
                if system.judging:
                    with b.if_then(b.fcmp_ordered("<", b.load(verdict, typ=DOUBLE), number(0.0)), likely=False):
                        settle(trial)
            judged = [verdict if stage == 0 else ignored] if system.judging else []
            b.call(system.rates, [time, at, inputs, k[stage], *judged])
        _combine(b, system.size, y, y, h, method.b, k)
        if system.settle is not None:
            b.store(b.fmul(b.sitofp(b.add(b.add(first, index), integer(1)), DOUBLE), h), time)
            settle(y)

    _loop(b, steps, one_step)
    doubt = local_array(b, 1)
    b.store(number(0.0), doubt)
    _each(
        b, system.size, lambda i: b.store(b.fadd(b.load(doubt, typ=DOUBLE), b.fmul(_load(b, y, i), number(0.0))), doubt)
    )
    finite = b.fcmp_ordered("==", b.load(doubt, typ=DOUBLE), number(0.0))
    with b.if_then(finite):
        _each(b, system.size, lambda i: b.store(_load(b, y, i), element(b, state, i)))
    b.ret(b.zext(finite, INT))
    return function


def _load(b: ir.IRBuilder, array: ir.Value, index: int | ir.Value) -> ir.Value:
    return b.load(element(b, array, index), typ=DOUBLE)


def _combine(
    b: ir.IRBuilder,
    size: int,
    target: ir.Value,
    base: ir.Value,
    h: ir.Value,
    weights: Sequence[float],
    slopes: Sequence[ir.Value],
) -> None:
    """Target = base + h Σ weights slopes, summed in the order of the stages."""
    terms = [(weight, slope) for weight, slope in zip(weights, slopes, strict=False) if weight]

    def component(i: int | ir.Value) -> None:
        total = None
        for weight, slope in terms:
            term = _load(b, slope, i) if weight == 1.0 else b.fmul(number(weight), _load(b, slope, i))
            total = term if total is None else b.fadd(total, term)
        b.store(b.fadd(_load(b, base, i), b.fmul(h, total)), element(b, target, i))

    _each(b, size, component)


def _each(b: ir.IRBuilder, size: int, body: Callable[[int | ir.Value], object]) -> None:
    """`body` for every component: unrolled where there are few, a loop where there are many."""
    if size <= UNROLLED:
        for index in range(size):
            body(index)
    else:
        _loop(b, integer(size), body)


def _loop(b: ir.IRBuilder, count: ir.Value, body: Callable[[ir.Value], object]) -> None:
    before = b.block
    head = b.append_basic_block("head")
    inside = b.append_basic_block("inside")
    after = b.append_basic_block("after")
    b.branch(head)
    b.position_at_end(head)
    index = b.phi(INT)
    index.add_incoming(integer(0), before)
    b.cbranch(b.icmp_signed("<", index, count), inside, after)
    b.position_at_end(inside)
    body(index)
    following = b.add(index, integer(1))
    index.add_incoming(following, b.block)
    b.branch(head)
    b.position_at_end(after)
