"""The compiled dense solver against numpy's, and its result for singular matrices."""

from __future__ import annotations

import ctypes

import numpy as np
import pytest

from mbd_sim.compiler.code.host_module import compile_module, new_module
from mbd_sim.compiler.ir.builder import IRBuilder
from mbd_sim.compiler.ir.dense_solver import emit_dense_solver
from mbd_sim.compiler.ir.module import POINTER, VOID, Function, FunctionType


def solver(size, lanes=1):
    """x = solve(matrix, right), compiled; with several lanes, the arrays are as in memory."""
    module = new_module()
    emitted = emit_dense_solver(module, size, lanes=lanes)
    both = Function(module, FunctionType(VOID, [POINTER] * 4), "both")
    matrix, rows, right, x = both.args
    builder = IRBuilder(both.append_basic_block("entry"))
    builder.call(emitted.factorize, [matrix, rows])
    builder.call(emitted.solve, [matrix, rows, right, x])
    builder.ret_void()
    code = compile_module(module)
    call = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 4)(code.address("both"))

    def solve(matrix, right):
        own = matrix.copy() if lanes > 1 else np.asfortranarray(matrix, dtype=float).copy(order="F")
        rows, x = np.empty(right.shape), np.empty(right.shape)
        call(own.ctypes.data, rows.ctypes.data, right.ctypes.data, x.ctypes.data)
        assert code is not None
        return x

    return solve


@pytest.mark.parametrize("size", [1, 2, 3, 7, 40])
def test_it_agrees_with_numpy(size):
    random, solve = np.random.default_rng(size), solver(size)
    for _ in range(20):
        matrix, right = random.standard_normal((size, size)), random.standard_normal(size)
        assert solve(matrix, right) == pytest.approx(np.linalg.solve(matrix, right), rel=1e-9, abs=1e-11)


def test_rows_are_exchanged():
    """A zero pivot on the diagonal, then a tiny one that would destroy the accuracy."""
    solve = solver(3)
    matrix, right = np.array([[0.0, 0.0, 2.0], [4.0, 0.0, 0.0], [0.0, 8.0, 0.0]]), np.array([2.0, 4.0, 8.0])
    assert solve(matrix, right).tolist() == [1.0, 1.0, 1.0]
    matrix[0, 0] = 1e-20
    assert solve(matrix, right) == pytest.approx([1.0, 1.0, 1.0], rel=1e-15)


def test_a_singular_matrix_gives_what_is_not_finite():
    assert not np.all(np.isfinite(solver(2)(np.ones((2, 2)), np.array([1.0, 2.0]))))


def test_each_lane_exchanges_its_own_rows():
    """The same bits as for one system, whichever rows the others exchange; a singular one spoils no other."""
    size, lanes, random = 4, 8, np.random.default_rng(2)
    matrices, right = random.standard_normal((lanes, size, size)), random.standard_normal((lanes, size))
    matrices[3] = np.eye(size)
    matrices[5, 2] = matrices[5, 1]
    alone, together = solver(size), solver(size, lanes)
    matrix = np.ascontiguousarray(matrices.transpose(2, 1, 0))  # column by column, the lanes of an entry side by side
    x = together(matrix, np.ascontiguousarray(right.T))
    for lane in range(lanes):
        assert np.array_equal(x[:, lane], alone(matrices[lane], right[lane]), equal_nan=True), lane
    assert not np.all(np.isfinite(x[:, 5]))
