"""Dense linear systems by Gaussian elimination with partial pivoting, as IR (Golub & Van Loan, sec. 3.4)."""

from __future__ import annotations

from dataclasses import dataclass

from mbd_sim.compiler.ir import POINTER, VOID, Function, FunctionType, Module, Value
from mbd_sim.compiler.ir_builder import IRBuilder
from mbd_sim.compiler.ir_types import (
    DOUBLE,
    INT,
    integer,
    number,
)
from mbd_sim.compiler.ir_vectors import (
    Index,
    load,
    loop,
    store,
)


@dataclass(frozen=True)
class DenseSolver:
    """`factorize(matrix, rows)` once, in place, column by column; `solve(matrix, rows, right, x)` as often as needed.

    `rows` (n,) receives the order of the rows, as doubles. With a singular matrix x is not finite. If `counted`, both
    have a last argument i64, the order of a smaller system at the start of the same arrays.
    """

    factorize: Function
    solve: Function


def emit_dense_solver(module: Module, size: int, *, counted: bool = False) -> DenseSolver:
    """Emit both functions for n = `size`, or for any order up to that."""
    return DenseSolver(_factorize(module, size, counted), _solve(module, size, counted))


def _function(module: Module, name: str, arguments: int, counted: bool) -> tuple[Function, IRBuilder]:
    types = [POINTER] * arguments + ([INT] if counted else [])
    function = Function(module, FunctionType(VOID, types), name)
    function.linkage = "internal"
    function.noalias = True
    return function, IRBuilder(function.append_basic_block("entry"))


def _offset(b: IRBuilder, size: int, row: Index, column: Index) -> Value:
    """The index of an entry of a matrix that is stored column by column."""
    row, column = (integer(index) if isinstance(index, int) else index for index in (row, column))
    return b.add(row, b.mul(column, integer(size)))


def _factorize(module: Module, size: int, counted: bool) -> Function:
    function, b = _function(module, "factorize", 2, counted)
    matrix, rows, *counts = function.args
    order: Index = counts[0] if counted else size
    largest, pivot_row = b.alloca(DOUBLE), b.alloca(INT)
    loop(b, 0, order, lambda i: store(b, b.sitofp(i, DOUBLE), rows, i))

    def eliminate(k: Value) -> None:
        following = b.add(k, integer(1))
        b.store(number(-1.0), largest)
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
        inverse = b.fdiv(number(1.0), load(b, matrix, _offset(b, size, k, k)))

        def scale(i: Value) -> None:
            offset = _offset(b, size, i, k)
            store(b, b.fmul(load(b, matrix, offset), inverse), matrix, offset)

        loop(b, following, order, scale)

        def update_column(j: Value) -> None:
            factor = load(b, matrix, _offset(b, size, k, j))

            def update(i: Value) -> None:
                subtracted = b.fmul(factor, load(b, matrix, _offset(b, size, i, k)))
                offset = _offset(b, size, i, j)
                store(b, b.fsub(load(b, matrix, offset), subtracted), matrix, offset)

            loop(b, following, order, update)

        loop(b, following, order, update_column)
        store(b, inverse, matrix, _offset(b, size, k, k))

    loop(b, 0, order, eliminate)
    b.ret_void()
    return function


def _solve(module: Module, size: int, counted: bool) -> Function:
    function, b = _function(module, "solve", 4, counted)
    matrix, rows, right, x, *counts = function.args
    order: Index = counts[0] if counted else size
    last = b.sub(counts[0], integer(1)) if counted else integer(size - 1)
    loop(b, 0, order, lambda i: store(b, load(b, right, b.fptosi(load(b, rows, i), INT)), x, i))

    def subtract_column(k: Value, first: Index, beyond: Index) -> None:
        factor = load(b, x, k)

        def subtract(i: Value) -> None:
            store(b, b.fsub(load(b, x, i), b.fmul(factor, load(b, matrix, _offset(b, size, i, k)))), x, i)

        loop(b, first, beyond, subtract)

    def substitute_back(step: Value) -> None:
        k = b.sub(last, step)
        store(b, b.fmul(load(b, x, k), load(b, matrix, _offset(b, size, k, k))), x, k)
        subtract_column(k, 0, k)

    loop(b, 0, order, lambda k: subtract_column(k, b.add(k, integer(1)), order))
    loop(b, 0, order, substitute_back)
    b.ret_void()
    return function


def _swap(b: IRBuilder, array: Value, one: Value, other: Value) -> None:
    first, second = load(b, array, one), load(b, array, other)
    store(b, second, array, one)
    store(b, first, array, other)
