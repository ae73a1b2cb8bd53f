"""The compiled solution of dependent rows against numpy's least squares, for rows that are well conditioned."""

import ctypes

import numpy as np
import pytest

from mbd_sim.compiler.code.host_module import compile_module, new_module
from mbd_sim.compiler.ir.builder import INT, IRBuilder
from mbd_sim.compiler.ir.dense_solver import emit_dense_solver
from mbd_sim.compiler.ir.module import POINTER, VOID, Function, FunctionType
from mbd_sim.compiler.steps.shared_rows import emit_shared_solver


def shared(matrix, weights, right, sharing):
    """x (n,) of rows of which the first ones share."""
    size, module = len(right), new_module()
    share = emit_shared_solver(module, size, emit_dense_solver(module, size, counted=True))
    function = Function(module, FunctionType(VOID, [POINTER] * 5 + [INT] * 2), "shared")
    b = IRBuilder(function.append_basic_block("entry"))
    b.call(share, list(function.args))
    b.ret_void()
    code = compile_module(module)
    call = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 5, *[ctypes.c_int64] * 2)(code.address("shared"))
    given, x, y = matrix.ravel(order="F").copy(), np.zeros(size), np.zeros(size)
    call(*(array.ctypes.data for array in (given, weights, right.copy(), x, y)), sharing, size)
    return x


@pytest.mark.parametrize(("count", "rank", "others"), [(2, 1, 0), (4, 3, 0), (4, 3, 2), (6, 2, 1), (3, 3, 1)])
def test_rows_that_share_have_the_least_weighted_sum_of_squares(count, rank, others):
    """Of all x with A x = r that with the least Σ w x² over the rows that share; the other rows are independent."""
    chance, size = np.random.default_rng(count + others), count + others
    jacobian = np.linalg.qr(chance.normal(size=(size, rank + others)))[0]
    jacobian[:count] = np.linalg.qr(chance.normal(size=(count, rank)))[0] @ np.eye(rank, rank + others)
    jacobian[count:] += np.eye(others, rank + others, rank)
    matrix, weights = jacobian @ jacobian.T, chance.uniform(0.5, 2.0, size)
    right = matrix @ chance.normal(size=size)
    x = shared(matrix, weights, right, count)
    some, directions = np.linalg.lstsq(matrix, right, rcond=1e-10)[0], np.linalg.svd(matrix)[2]
    free = directions[rank + others :].T
    roots = np.sqrt(np.where(np.arange(size) < count, weights, 0.0))[:, None]
    expected = some - free @ np.linalg.lstsq(roots * free, roots[:, 0] * some, rcond=None)[0] if free.size else some
    assert x == pytest.approx(expected, rel=1e-9, abs=1e-9 * np.max(np.abs(expected)))
