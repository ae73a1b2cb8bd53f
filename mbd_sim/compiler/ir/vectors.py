"""Loops, and the operations on vectors that the steps need, as IR."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from typing import TypeAlias

from mbd_sim.compiler.ir.builder import DOUBLE, IRBuilder, element, integer, number
from mbd_sim.compiler.ir.lanes import ComponentBuilder, LaneBuilder
from mbd_sim.compiler.ir.module import Value

NONE: frozenset[int] = frozenset()
LANES = 4  # components at once, a power of two

Index: TypeAlias = int | Value
Terms: TypeAlias = Sequence[tuple[float, Value]]


def load(b: IRBuilder, array: Value, index: Index) -> Value:
    """The value of a component."""
    return b.load(element(b, array, index), typ=DOUBLE)


def store(b: IRBuilder, value: Value, array: Value, index: Index) -> None:
    """Set one component."""
    b.store(value, element(b, array, index))


def loop(b: IRBuilder, first: Index, beyond: Index, body: Callable[[Value], object]) -> None:
    """Emit `body` for every index from `first` to before `beyond`."""
    start, end = (integer(bound) if isinstance(bound, int) else bound for bound in (first, beyond))
    b.loop(start, end, body)


def for_each(b: IRBuilder, size: int, body: Callable[[Index], object], still: frozenset[int] = NONE) -> None:
    """Emit `body` for every component but those in `still`: unrolled if there are few, as loops if there are many."""
    if size <= b.unrolled:
        for index in range(size):
            if index not in still:
                body(index)
        return
    first = 0
    for beyond in [*sorted(still), size]:
        if first < beyond:
            loop(b, first, beyond, body)
        first = beyond + 1


def for_components(b: IRBuilder, size: int, body: Callable[[IRBuilder, Index], object], *, short: bool = False) -> None:
    """Emit `body(builder, index)` for all components of the vectors of a member, several at once where that pays.

    `body` must use the builder that it is given, and not branch. In modules that are not fast, and for several members,
    it is given single components. `short` code is a loop for any size.
    """
    if isinstance(b, LaneBuilder) or not b.module.fast:
        for_each(b, size, lambda i: body(b, i))
        return
    done, lanes = 0, LANES
    if short or size > b.unrolled:
        done = size - size % lanes
        if done > lanes:

            def block(count: Value) -> None:
                body(ComponentBuilder(b, lanes), b.mul(count, integer(lanes)))

            loop(b, 0, done // lanes, block)
        else:
            done = 0
    while lanes > 1:
        wide = ComponentBuilder(b, lanes)
        while size - done >= lanes:
            body(wide, done)
            done += lanes
        lanes //= 2
    if done < size:
        body(b, done)


def for_span(b: IRBuilder, most: int, first: Index, beyond: Index, body: Callable[[IRBuilder, Index], object]) -> None:
    """Emit `body(builder, index)` for every index from `first` to before `beyond`, several at once if that pays.

    `body` is as in `for_components`. The bounds may become known only when the code runs; there are at most so many.
    """
    start, end = (integer(bound) if isinstance(bound, int) else bound for bound in (first, beyond))
    if most <= 2 * LANES or isinstance(b, LaneBuilder) or not b.module.fast:
        loop(b, start, end, lambda i: body(b, i))
        return
    blocks = b.lshr(b.sub(end, start), integer(LANES.bit_length() - 1))
    rest = b.add(start, b.mul(blocks, integer(LANES)))
    loop(b, 0, blocks, lambda count: body(ComponentBuilder(b, LANES), b.add(start, b.mul(count, integer(LANES)))))
    loop(b, rest, end, lambda i: body(b, i))


def each_component(
    b: IRBuilder, size: int, body: Callable[[IRBuilder, Index], object], still: frozenset[int] = NONE
) -> None:
    """Emit `body(builder, index)` for every component: one by one if there are few, several at once if there are many.

    See `for_each` for `still`, and `for_components` for `body`.
    """
    if size > b.unrolled and not still:
        for_components(b, size, body, short=True)
    else:
        for_each(b, size, partial(body, b), still)


@contextmanager
def looped(b: IRBuilder) -> Iterator[None]:
    """Within, operations on vectors of all sizes are loops, which are shorter code."""
    unrolled, b.unrolled = b.unrolled, 0
    try:
        yield
    finally:
        b.unrolled = unrolled


def copy(b: IRBuilder, size: int, source: Value, target: Value) -> None:
    """Target = source."""

    def component(w: IRBuilder, i: Index) -> None:
        store(w, load(w, source, i), target, i)

    each_component(b, size, component)


def cells(b: IRBuilder, size: int) -> int:
    """The numbers in memory that `folded` needs for a vector."""
    return LANES if size > b.unrolled and b.module.fast and not isinstance(b, LaneBuilder) else 1


def folded(b: IRBuilder, size: int, memory: Value, fold: Callable[[IRBuilder, Value, Index], Value]) -> Value:
    """A number that starts from 0 and becomes `fold(builder, number, i)` for each component i of a long vector.

    There may be several such numbers, each for some of the components; then the result is their sum.

    :param memory: the address of as many numbers as `cells` says.
    """
    count = cells(b, size)
    for cell in range(count):
        store(b, number(0.0), memory, cell)

    def component(w: IRBuilder, i: Index) -> None:
        store(w, fold(w, load(w, memory, 0), i), memory, 0)

    each_component(b, size, component)
    result = load(b, memory, 0)
    for cell in range(1, count):
        result = b.fadd(result, load(b, memory, cell))
    return result


def weighted(weights: Sequence[float], vectors: Sequence[Value]) -> Terms:
    """The terms of Σ weight vector, without those whose weight is zero."""
    return [(weight, vector) for weight, vector in zip(weights, vectors, strict=False) if weight]


def total(b: IRBuilder, terms: Terms, index: Index) -> Value:
    """A component of Σ weight vector with at least one term, summed in order with fused multiply-adds."""
    (weight, vector), *others = terms
    first = load(b, vector, index)
    partial = first if weight == 1.0 else b.fmul(number(weight), first)
    for weight, vector in others:
        partial = b.fma(number(weight), load(b, vector, index), partial)
    return partial


def combine(
    b: IRBuilder,
    size: int,
    target: Value,
    base: Value,
    h: Value | None,
    terms: Terms,
    *,
    still: frozenset[int] = NONE,
) -> None:
    """Target = base + h Σ weight vector, rounded once; without `h` the factor is 1. See `for_each` for `still`."""

    def component(w: IRBuilder, i: Index) -> None:
        added, start = total(w, terms, i), load(w, base, i)
        store(w, w.fadd(start, added) if h is None else w.fma(h, added, start), target, i)

    each_component(b, size, component, still)


def combine_at_once(
    b: IRBuilder,
    size: int,
    target: Value,
    base: Value,
    h: Value,
    terms: Terms,
    *,
    still: frozenset[int] = NONE,
    unread: frozenset[int] = NONE,
) -> None:
    """`combine` where the last vector has just been computed: the other terms are added while that is under way.

    The result is rounded twice, so this is for stages and not for states. Components in `unread` are left out.
    """
    *early, (weight, last) = terms
    factor = b.fmul(h, number(weight))

    def component(w: IRBuilder, i: Index) -> None:
        start = load(w, base, i)
        if early:
            start = w.fma(h, total(w, early, i), start)
        store(w, w.fma(factor, load(w, last, i), start), target, i)

    each_component(b, size, component, still | unread)


def add_square(b: IRBuilder, into: Value, value: Value) -> None:
    """Add value² to the number at the address `into`."""
    b.store(b.fma(value, value, b.load(into, typ=DOUBLE)), into)
