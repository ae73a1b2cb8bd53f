"""Dense linear systems by Gaussian elimination with partial pivoting, as IR (Golub & Van Loan, sec. 3.4)."""

from __future__ import annotations

from dataclasses import dataclass

import llvmlite.ir as ir

from mbd_sim.compiler.ir_types import (
    DOUBLE,
    INT,
    POINTER,
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
    """`factorize(matrix, rows)` once, in place, column-major; `solve(matrix, rows, right, x)` as often as wanted.

    `rows` (n,) receives the order of the rows, as doubles. A singular matrix gives an x that is not finite.
    """

    factorize: ir.Function
    solve: ir.Function


def emit_dense_solver(module: ir.Module, size: int) -> DenseSolver:
    """Emit both functions for n = `size`."""
    return DenseSolver(_factorize(module, size), _solve(module, size))


def _function(module: ir.Module, name: str, arguments: int) -> tuple[ir.Function, ir.IRBuilder]:
    function = ir.Function(module, ir.FunctionType(ir.VoidType(), [POINTER] * arguments), name)
    function.linkage = "internal"
    for argument in function.args:
        argument.add_attribute("noalias")
    return function, ir.IRBuilder(function.append_basic_block("entry"))


def _place(b: ir.IRBuilder, size: int, row: Index, column: Index) -> ir.Value:
    row, column = (integer(index) if isinstance(index, int) else index for index in (row, column))
    return b.add(row, b.mul(column, integer(size)))


def _factorize(module: ir.Module, size: int) -> ir.Function:
    function, b = _function(module, "factorize", 2)
    matrix, rows = function.args
    fabs = module.declare_intrinsic("llvm.fabs", [DOUBLE])
    largest, where = b.alloca(DOUBLE), b.alloca(INT)
    loop(b, 0, size, lambda i: store(b, b.sitofp(i, DOUBLE), rows, i))

    def eliminate(k: ir.Value) -> None:
        following = b.add(k, integer(1))
        b.store(number(-1.0), largest)
        b.store(k, where)

        def look(i: ir.Value) -> None:
            value = b.call(fabs, [load(b, matrix, _place(b, size, i, k))])
            better = b.fcmp_ordered(">", value, b.load(largest, typ=DOUBLE))
            b.store(b.select(better, value, b.load(largest, typ=DOUBLE)), largest)
            b.store(b.select(better, i, b.load(where, typ=INT)), where)

        loop(b, k, size, look)
        found = b.load(where, typ=INT)
        with b.if_then(b.icmp_signed("!=", found, k)):
            loop(b, 0, size, lambda j: _swap(b, matrix, _place(b, size, k, j), _place(b, size, found, j)))
            _swap(b, rows, k, found)
        inverse = b.fdiv(number(1.0), load(b, matrix, _place(b, size, k, k)))

        def scale(i: ir.Value) -> None:
            place = _place(b, size, i, k)
            store(b, b.fmul(load(b, matrix, place), inverse), matrix, place)

        loop(b, following, size, scale)

        def column(j: ir.Value) -> None:
            factor = load(b, matrix, _place(b, size, k, j))

            def entry(i: ir.Value) -> None:
                taken = b.fmul(factor, load(b, matrix, _place(b, size, i, k)))
                place = _place(b, size, i, j)
                store(b, b.fsub(load(b, matrix, place), taken), matrix, place)

            loop(b, following, size, entry)

        loop(b, following, size, column)
        store(b, inverse, matrix, _place(b, size, k, k))

    loop(b, 0, size, eliminate)
    b.ret_void()
    return function


def _solve(module: ir.Module, size: int) -> ir.Function:
    function, b = _function(module, "solve", 4)
    matrix, rows, right, x = function.args
    loop(b, 0, size, lambda i: store(b, load(b, right, b.fptosi(load(b, rows, i), INT)), x, i))

    def subtract(k: ir.Value, first: Index, beyond: Index) -> None:
        factor = load(b, x, k)

        def entry(i: ir.Value) -> None:
            store(b, b.fsub(load(b, x, i), b.fmul(factor, load(b, matrix, _place(b, size, i, k)))), x, i)

        loop(b, first, beyond, entry)

    def backward(step: ir.Value) -> None:
        k = b.sub(integer(size - 1), step)
        store(b, b.fmul(load(b, x, k), load(b, matrix, _place(b, size, k, k))), x, k)
        subtract(k, 0, k)

    loop(b, 0, size, lambda k: subtract(k, b.add(k, integer(1)), size))
    loop(b, 0, size, backward)
    b.ret_void()
    return function


def _swap(b: ir.IRBuilder, array: ir.Value, one: ir.Value, other: ir.Value) -> None:
    first, second = load(b, array, one), load(b, array, other)
    store(b, second, array, one)
    store(b, first, array, other)
