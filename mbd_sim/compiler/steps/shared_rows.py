"""Rows that depend on each other and share their forces: solutions with the least sum of squares, as IR.

Of the rows of A x = r some form a basis B, and the others D depend on it. With S = A_BB⁻¹ A_BD all solutions are
x_B = A_BB⁻¹ r_B - S x_D; that with the least Σ w x² has (W_D + Sᵀ W_B S) x_D = Sᵀ W_B A_BB⁻¹ r_B. It does not depend on
the rows that are chosen as a basis.
"""

from __future__ import annotations

from mbd_sim.compiler.ir.builder import INT, IRBuilder, element, integer, local_array, number
from mbd_sim.compiler.ir.dense_solver import DenseSolver
from mbd_sim.compiler.ir.module import POINTER, VOID, Function, FunctionType, Module, Value
from mbd_sim.compiler.ir.vectors import load, loop, store


def emit_shared_solver(module: Module, n: int, solver: DenseSolver) -> Function:
    """Emit `void share(matrix, order, weights, x, i64 basis, i64 size)`, if it is not there yet.

    The matrix (n, n), of which `size` rows are used, has those of the basis first, which are factorized with this
    `order`. x (n,) has A_BB⁻¹ r_B before, and the solution after it.
    """
    if (known := module.functions.get("share")) is not None:
        return known
    function = Function(module, FunctionType(VOID, [POINTER] * 4 + [INT] * 2), "share")
    function.linkage = "internal"
    matrix, order, weights, x, basis, size = function.args
    b = IRBuilder(function.append_basic_block("entry"))
    slopes, normal, right, found, small_order = (local_array(b, count) for count in (n * n, n * n, n, n, n))
    count = b.sub(size, basis)

    def at(row: Value, column: Value) -> Value:
        return b.add(row, b.mul(column, integer(n)))

    def add_to(array: Value, index: Value, factor: Value, value: Value) -> None:
        store(b, b.fma(factor, value, load(b, array, index)), array, index)

    def solve_column(j: Value) -> None:
        column = b.mul(b.add(basis, j), integer(n))
        target = element(b, slopes, b.mul(j, integer(n)))
        b.call(solver.solve, [matrix, order, element(b, matrix, column), target, basis])

    def normal_column(j: Value) -> None:
        def entry(i: Value) -> None:
            store(b, number(0.0), normal, at(i, j))
            loop(b, 0, basis, lambda k: add_to(normal, at(i, j), weighted(k, i), load(b, slopes, at(k, j))))

        loop(b, 0, count, entry)
        add_to(normal, at(j, j), number(1.0), load(b, weights, b.add(basis, j)))
        store(b, number(0.0), right, j)
        loop(b, 0, basis, lambda k: add_to(right, j, weighted(k, j), load(b, x, k)))

    def weighted(row: Value, column: Value) -> Value:
        return b.fmul(load(b, slopes, at(row, column)), load(b, weights, row))

    def finish(j: Value) -> None:
        value = load(b, found, j)
        store(b, value, x, b.add(basis, j))
        loop(b, 0, basis, lambda k: add_to(x, k, b.fneg(load(b, slopes, at(k, j))), value))

    loop(b, 0, count, solve_column)
    loop(b, 0, count, normal_column)
    b.call(solver.factorize, [normal, small_order, count])
    b.call(solver.solve, [normal, small_order, right, found, count])
    loop(b, 0, count, finish)
    b.ret_void()
    return function
