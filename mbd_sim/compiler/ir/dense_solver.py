"""Dense linear systems by Gaussian elimination with partial pivoting, as IR (Golub & Van Loan, sec. 3.4)."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass

from mbd_sim.compiler.ir.builder import DOUBLE, INT, IRBuilder, element, integer, number
from mbd_sim.compiler.ir.lanes import LaneBuilder, new_builder
from mbd_sim.compiler.ir.module import POINTER, VOID, Function, FunctionType, Module, Value
from mbd_sim.compiler.ir.vectors import Index, for_span, load, loop, store

FEW = 12  # components up to which products with zeros cost no more than to leave them out


@dataclass(frozen=True)
class DenseSolver:
    """`factorize(matrix, rows)` once, in place, column by column; `solve(matrix, rows, right, x)` as often as needed.

    `rows` (n,) receives the order of the rows, as doubles. With a singular matrix x is not finite. If `counted`, both
    have a last argument i64, the order of a smaller system at the start of the same arrays.
    """

    factorize: Function
    solve: Function


def emit_dense_solver(module: Module, size: int, *, counted: bool = False, lanes: int = 1) -> DenseSolver:
    """Emit both functions for n = `size`, or for any order up to that.

    With several `lanes` there are as many systems of this order, each with its own order of rows.
    """
    return DenseSolver(_factorize(module, size, counted, lanes), _solve(module, size, counted, lanes))


def _function(module: Module, name: str, arguments: int, counted: bool, lanes: int) -> tuple[Function, IRBuilder]:
    types = [POINTER] * arguments + ([INT] if counted else [])
    function = Function(module, FunctionType(VOID, types), name)
    function.linkage = "internal"
    function.noalias = True
    return function, new_builder(function.append_basic_block("entry"), lanes)


def _offset(b: IRBuilder, size: int, row: Index, column: Index) -> Value:
    """The index of an entry of a matrix that is stored column by column."""
    row, column = (integer(index) if isinstance(index, int) else index for index in (row, column))
    return b.add(row, b.mul(column, integer(size)))


def _factorize(module: Module, size: int, counted: bool, lanes: int) -> Function:
    function, b = _function(module, "factorize", 2, counted, lanes)
    matrix, rows, *counts = function.args
    order: Index = counts[0] if counted else size
    largest, pivot_row = b.alloca(DOUBLE), b.alloca(DOUBLE if isinstance(b, LaneBuilder) else INT)
    loop(b, 0, order, lambda i: store(b, b.sitofp(i, DOUBLE), rows, i))

    def eliminate(k: Value) -> None:
        following = b.add(k, integer(1))
        b.store(number(-1.0), largest)
        if isinstance(b, LaneBuilder):
            _exchange_in_lanes(b, size, order, k, matrix, rows, largest, pivot_row)
        else:
            _exchange(b, size, order, k, matrix, rows, largest, pivot_row)
        inverse = b.fdiv(number(1.0), load(b, matrix, _offset(b, size, k, k)))

        pivots = element(b, matrix, b.mul(k, integer(size)))

        def scale(w: IRBuilder, i: Index) -> None:
            store(w, w.fmul(load(w, pivots, i), inverse), pivots, i)

        for_span(b, size, following, order, scale)

        def update_column(j: Value) -> None:
            target = element(b, matrix, b.mul(j, integer(size)))
            subtract_product(b, size, following, order, target, load(b, target, k), pivots)

        loop(b, following, order, update_column)
        store(b, inverse, matrix, _offset(b, size, k, k))

    loop(b, 0, order, eliminate)
    b.ret_void()
    return function


def _exchange(
    b: IRBuilder, size: int, order: Index, k: Value, matrix: Value, rows: Value, largest: Value, pivot_row: Value
) -> None:
    """Exchange row k with that of the largest entry of column k; `largest` is -1 before."""
    b.store(k, pivot_row)

    def compare(i: Value) -> None:
        value = b.intrinsic("llvm.fabs", load(b, matrix, _offset(b, size, i, k)))
        larger = b.fcmp_ordered(">", value, b.load(largest, typ=DOUBLE))
        b.store(b.select(larger, value, b.load(largest, typ=DOUBLE)), largest)
        b.store(b.select(larger, i, b.load(pivot_row, typ=INT)), pivot_row)

    loop(b, k, order, compare)
    found = b.load(pivot_row, typ=INT)
    with b.if_then(b.icmp_signed("!=", found, k)):
        loop(b, 0, order, lambda j: _swap(b, matrix, _offset(b, size, k, j), _offset(b, size, found, j)))
        _swap(b, rows, k, found)


def _exchange_in_lanes(
    b: LaneBuilder, size: int, order: Index, k: Value, matrix: Value, rows: Value, largest: Value, pivot_row: Value
) -> None:
    """`_exchange` in each lane, where `pivot_row` is a double; most lanes exchange no rows."""
    b.store(b.sitofp(k, DOUBLE), pivot_row)

    def compare(i: Value) -> None:
        value = b.intrinsic("llvm.fabs", load(b, matrix, _offset(b, size, i, k)))
        larger = b.fcmp_ordered(">", value, b.load(largest, typ=DOUBLE))
        b.store(b.select(larger, value, b.load(largest, typ=DOUBLE)), largest)
        b.store(b.select(larger, b.sitofp(i, DOUBLE), b.load(pivot_row, typ=DOUBLE)), pivot_row)

    loop(b, k, order, compare)
    found = b.load(pivot_row, typ=DOUBLE)

    def exchange_with(i: Value) -> None:
        here = b.fcmp_ordered("==", found, b.sitofp(i, DOUBLE))
        with b.if_then(b.any_lane(here)):
            loop(b, 0, order, lambda j: _swap(b, matrix, _offset(b, size, k, j), _offset(b, size, i, j), here))
            _swap(b, rows, k, i, here)

    loop(b, b.add(k, integer(1)), order, exchange_with)


def _solve(module: Module, size: int, counted: bool, lanes: int) -> Function:
    function, b = _function(module, "solve", 4, counted, lanes)
    matrix, rows, right, x, *counts = function.args
    order: Index = counts[0] if counted else size
    last = b.sub(counts[0], integer(1)) if counted else integer(size - 1)

    def gather(i: Value) -> None:
        """Read the right side of row i from where it was before the exchanges."""
        row = load(b, rows, i)
        if not isinstance(b, LaneBuilder):
            store(b, load(b, right, b.fptosi(row, INT)), x, i)
            return

        def take(j: Value) -> None:
            is_row = b.fcmp_ordered("==", row, b.sitofp(j, DOUBLE))
            store(b, b.select(is_row, load(b, right, j), load(b, x, i)), x, i)

        loop(b, 0, order, take)

    loop(b, 0, order, gather)

    def subtract_column(k: Value, first: Index, beyond: Index) -> None:
        subtract_product(b, size, first, beyond, x, load(b, x, k), element(b, matrix, b.mul(k, integer(size))))

    def substitute_back(step: Value) -> None:
        k = b.sub(last, step)
        store(b, b.fmul(load(b, x, k), load(b, matrix, _offset(b, size, k, k))), x, k)
        subtract_column(k, 0, k)

    loop(b, 0, order, lambda k: subtract_column(k, b.add(k, integer(1)), order))
    loop(b, 0, order, substitute_back)
    b.ret_void()
    return function


def subtract_product(
    b: IRBuilder, most: int, first: Index, beyond: Index, target: Value, factor: Value, vector: Value
) -> None:
    """Emit target - factor vector for the components from `first` to before `beyond`, in place: see `for_span`."""

    def subtract(w: IRBuilder, i: Index) -> None:
        store(w, w.fsub(load(w, target, i), w.fmul(factor, load(w, vector, i))), target, i)

    with where_coupled(b, most, factor):
        for_span(b, most, first, beyond, subtract)


def where_coupled(b: IRBuilder, most: int, factor: Value) -> AbstractContextManager[None]:
    """Leave out what is multiplied by zero, in long vectors: groups of rows that are not coupled cost little more."""
    if most <= FEW or isinstance(b, LaneBuilder):
        return nullcontext()
    return b.if_then(b.fcmp_unordered("!=", factor, number(0.0)))


def _swap(b: IRBuilder, array: Value, one: Value, other: Value, where: Value | None = None) -> None:
    """Exchange two components, or only in the lanes `where` a condition holds."""
    first, second = load(b, array, one), load(b, array, other)
    store(b, second if where is None else b.select(where, second, first), array, one)
    store(b, first if where is None else b.select(where, first, second), array, other)
