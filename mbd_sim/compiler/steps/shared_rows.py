"""Rows that depend on each other and share their forces: solutions with the least sum of squares, as IR."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from mbd_sim.compiler.ir.builder import DOUBLE, INT, IRBuilder, integer, local_array, number
from mbd_sim.compiler.ir.dense_solver import DenseSolver
from mbd_sim.compiler.ir.module import POINTER, VOID, Function, FunctionType, Module, Value
from mbd_sim.compiler.ir.vectors import load, loop, store

REFINEMENTS = 5  # each of which divides the error by the ratio of the pivots to `SOFTNESS`
SOFTNESS = 1e-12  # of the largest diagonal entry, that is added to that of a singular matrix


def emit_shared_solver(module: Module, rows: int, solver: DenseSolver) -> Function:
    """Emit `void share(matrix, weights, right, x, y, i64 sharing, i64 size)`, if it is not there yet.

    Of `size` rows of a matrix (rows, rows) the first ones, `sharing`, have the least Σ w x². The others are eliminated
    before. Then x is W⁻¹ Aᵀ y with A W⁻¹ Aᵀ y = r, from a factorization of A W⁻¹ Aᵀ + ε I and by refinement; y is that
    of all rows. The right side is changed.
    """
    if (known := module.functions.get("share")) is not None:
        return known
    function = Function(module, FunctionType(VOID, [POINTER] * 5 + [INT] * 2), "share")
    function.linkage = "internal"
    _SharedSolver(IRBuilder(function.append_basic_block("entry")), rows, solver, function.args).emit()
    return function


class _SharedSolver:
    """Emits the steps of the solution with one builder."""

    def __init__(self, b: IRBuilder, n: int, solver: DenseSolver, arguments: Sequence[Value]) -> None:
        self._b, self._n, self._solver = b, n, solver
        self._given, self._weights, self._right, self._x, self._y, self._sharing, self._size = arguments
        self._matrix, self._normal, self._order, self._residual, self._change, self._largest = (
            local_array(b, count) for count in (n * n, n * n, n, n, n, 1)
        )

    def emit(self) -> None:
        b, n, sharing, size = self._b, self._n, self._sharing, self._size
        b.store(number(0.0), self._largest)
        loop(b, 0, integer(n * n), lambda i: store(b, load(b, self._given, i), self._matrix, i))
        loop(b, 0, size, lambda i: store(b, number(0.0), self._x, i))
        loop(b, 0, size, lambda i: store(b, number(0.0), self._y, i))
        loop(b, sharing, size, self._eliminate)
        loop(b, 0, sharing, self._normal_column)
        loop(b, 0, sharing, self._soften)
        b.call(self._solver.factorize, [self._normal, self._order, sharing])
        loop(b, 0, REFINEMENTS, self._refine)
        loop(b, sharing, size, self._eliminated)
        loop(b, sharing, size, self._dual)
        b.ret_void()

    def _place(self, row: Value, column: Value) -> Value:
        return self._b.add(row, self._b.mul(column, integer(self._n)))

    def _entry(self, row: Value, column: Value) -> Value:
        return load(self._b, self._matrix, self._place(row, column))

    def _add_to(self, array: Value, index: Value, factor: Value, value: Value) -> None:
        store(self._b, self._b.fma(factor, value, load(self._b, array, index)), array, index)

    def _others(self, k: Value, body: Callable[[Value], None]) -> None:
        loop(self._b, 0, k, body)
        loop(self._b, self._b.add(k, integer(1)), self._size, body)

    def _eliminate(self, k: Value) -> None:
        """Subtract row k from all others; the factors stay in its column."""
        b = self._b

        def subtract(i: Value) -> None:
            factor = b.fneg(b.fdiv(self._entry(i, k), self._entry(k, k)))

            def column(j: Value) -> None:
                self._add_to(self._matrix, self._place(i, j), factor, self._entry(k, j))

            loop(b, 0, self._sharing, column)
            loop(b, b.add(k, integer(1)), self._size, column)
            self._add_to(self._right, i, factor, load(b, self._right, k))
            store(b, factor, self._matrix, self._place(i, k))

        self._others(k, subtract)

    def _normal_column(self, j: Value) -> None:
        b = self._b

        def entry(i: Value) -> None:
            at = self._place(i, j)
            store(b, number(0.0), self._normal, at)

            def add(k: Value) -> None:
                scaled = b.fdiv(self._entry(i, k), load(b, self._weights, k))
                self._add_to(self._normal, at, scaled, self._entry(j, k))

            loop(b, 0, self._sharing, add)

        loop(b, 0, self._sharing, entry)
        diagonal, known = load(b, self._normal, self._place(j, j)), b.load(self._largest, typ=DOUBLE)
        b.store(b.select(b.fcmp_ordered(">", diagonal, known), diagonal, known), self._largest)

    def _soften(self, j: Value) -> None:
        largest = self._b.load(self._largest, typ=DOUBLE)
        self._add_to(self._normal, self._place(j, j), number(SOFTNESS), largest)

    def _refine(self, _: Value) -> None:
        b, sharing = self._b, self._sharing
        loop(b, 0, sharing, self._residual_of)
        b.call(self._solver.solve, [self._normal, self._order, self._residual, self._change, sharing])
        loop(b, 0, sharing, lambda i: self._add_to(self._y, i, number(1.0), load(b, self._change, i)))
        loop(b, 0, sharing, self._solution_of)

    def _residual_of(self, i: Value) -> None:
        b = self._b
        store(b, load(b, self._right, i), self._residual, i)

        def subtract(k: Value) -> None:
            self._add_to(self._residual, i, b.fneg(self._entry(i, k)), load(b, self._x, k))

        loop(b, 0, self._sharing, subtract)

    def _solution_of(self, k: Value) -> None:
        b = self._b
        store(b, number(0.0), self._x, k)
        loop(b, 0, self._sharing, lambda i: self._add_to(self._x, k, self._entry(i, k), load(b, self._y, i)))
        store(b, b.fdiv(load(b, self._x, k), load(b, self._weights, k)), self._x, k)

    def _eliminated(self, k: Value) -> None:
        self._residual_of(k)
        store(self._b, self._b.fdiv(load(self._b, self._residual, k), self._entry(k, k)), self._x, k)

    def _dual(self, index: Value) -> None:
        """The y of the last row that was eliminated first, from those of all others."""
        b = self._b
        k = b.sub(b.sub(b.add(self._size, self._sharing), integer(1)), index)
        self._others(k, lambda i: self._add_to(self._y, k, self._entry(i, k), load(b, self._y, i)))
