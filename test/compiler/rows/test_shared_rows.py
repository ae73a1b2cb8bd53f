"""The compiled solution of dependent rows against numpy's least squares."""

import ctypes

import numpy as np
import pytest

from mbd_sim.compiler.code.host_module import compile_module, new_module
from mbd_sim.compiler.ir.builder import IRBuilder, integer
from mbd_sim.compiler.ir.dense_solver import emit_dense_solver
from mbd_sim.compiler.ir.module import POINTER, VOID, Function, FunctionType
from mbd_sim.compiler.rows.shared_rows import ActiveRows, emit_active_solver, emit_shared_solver


def shared(matrix, weights, right, basis):
    """x (n,) of rows of which the first ones are a basis."""
    size, module = len(right), new_module()
    solver = emit_dense_solver(module, size, counted=True)
    share = emit_shared_solver(module, size, solver)
    function = Function(module, FunctionType(VOID, [POINTER] * 5), "shared")
    b = IRBuilder(function.append_basic_block("entry"))
    given, order, w, r, x = function.args
    b.call(solver.factorize, [given, order, integer(basis)])
    b.call(solver.solve, [given, order, r, x, integer(basis)])
    b.call(share, [given, order, w, x, integer(basis), integer(size)])
    b.ret_void()
    code = compile_module(module)
    call = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 5)(code.address("shared"))
    arrays = matrix.ravel(order="F").copy(), np.zeros(size), weights, right, np.zeros(size)
    call(*(array.ctypes.data for array in arrays))
    return arrays[-1]


@pytest.mark.parametrize(("count", "rank", "smallest"), [(2, 1, 1.0), (6, 5, 1e-6), (6, 2, 1.0), (7, 3, 1e-6)])
def test_rows_that_share_have_the_least_weighted_sum_of_squares(count, rank, smallest):
    """Of all x with A x = r; also with weights over six decades, and where A has small entries beside large ones."""
    chance = np.random.default_rng(count + rank)
    directions = np.linalg.qr(chance.normal(size=(count, rank)))[0]
    order = np.argsort(-np.abs(directions) @ np.ones(rank))  # the first ones are independent, and well conditioned
    while np.linalg.cond(directions[order[:rank]]) > 50.0:
        order = chance.permutation(count)
    directions = directions[order] @ np.diag(np.geomspace(1.0, smallest, rank) ** 0.5)
    weights = np.geomspace(1.0, smallest, count)[chance.permutation(count)]
    matrix, known = directions @ directions.T, chance.normal(size=count)
    # x = W⁻¹ J z has the least Σ w x² with the same Jᵀ x as `known`
    scaled = directions / np.sqrt(weights)[:, None]
    z = np.linalg.lstsq(scaled.T, directions.T @ known, rcond=None)[0]
    expected = z / np.sqrt(weights)
    assert shared(matrix, weights, matrix @ known, rank) == pytest.approx(
        expected, rel=1e-7, abs=1e-8 * np.max(np.abs(expected))
    )


def solved(matrix, weights, right, given, closed=()):
    """x (n,) of active rows, with given forces; the weights of rows that depend on others are negative."""
    size, gaps, module = len(right), len(closed), new_module()
    active = ActiveRows(size, gaps, gaps + size, emit_dense_solver(module, size, counted=True), gaps)
    solve = emit_active_solver(module, "active", active, 1, adds_given=True, watches=gaps > 0)
    function = Function(module, FunctionType(VOID, [POINTER] * 4), "solved")
    b = IRBuilder(function.append_basic_block("entry"))
    b.call(solve, function.args)
    b.ret_void()
    code = compile_module(module)
    call = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 4)(code.address("solved"))
    arrays = np.concatenate([closed, weights, given]), matrix.ravel(order="F").copy(), right.copy(), np.zeros(size)
    call(*(array.ctypes.data for array in arrays))
    return arrays[-1]


@pytest.mark.parametrize("seed", range(2))
def test_forces_that_share_add_to_given_ones(seed):
    """Of all x with A x = r those of least Σ w (x - ρ)²; where no row depends on others, ρ changes nothing."""
    chance = np.random.default_rng(seed)
    directions, weights = chance.normal(size=(5, 3)), chance.uniform(0.5, 2.0, size=5)
    matrix, given, known = directions @ directions.T, chance.normal(size=5), chance.normal(size=5)
    signs = np.where(np.arange(5) < 3, 1.0, -1.0)
    z = np.linalg.lstsq((directions / np.sqrt(weights)[:, None]).T, directions.T @ (known - given), rcond=None)[0]
    found = solved(matrix, signs * weights, matrix @ known, given)
    assert found == pytest.approx(given + z / np.sqrt(weights), rel=1e-9, abs=1e-9)
    alone = np.array([1.0, 1.0, 1.0, 0.0, 0.0])
    found = solved(matrix, alone, matrix @ known, given)
    assert np.array_equal(found, solved(matrix, alone, matrix @ known, np.zeros(5)))
    assert found[:3] == pytest.approx(np.linalg.solve(matrix[:3, :3], (matrix @ known)[:3]), rel=1e-9)


def test_islands_have_the_solutions_that_they_have_alone(monkeypatch):
    """Rows of three groups that do not act on each other, in mixed order, of which one has a gap that is watched."""
    monkeypatch.setattr("mbd_sim.compiler.rows.shared_rows.MANY", 1)
    chance, alone = np.random.default_rng(3), []
    for rank, count in ((3, 5), (2, 2), (1, 3)):
        directions, weights = chance.normal(size=(count, rank)), chance.uniform(0.5, 2.0, size=count)
        weights[rank:] *= -1.0
        alone.append((directions @ directions.T, weights, chance.normal(size=count), chance.normal(size=count)))
    alone[0][1][0], alone[0][1][3] = 0.0, 1.0  # a gap without a force, and another row of the basis in its place
    closed = [1.0] + [0.0] * 3
    parts = [solved(a, w, a @ x, g, closed[: len(w)]) for a, w, x, g in alone]
    owner = np.array([0, 1, 2, 0, 2, 0, 1, 2, 0, 0])  # the first row is the gap
    whole = np.zeros((10, 10))
    weights, right, given, expected = (np.zeros(10) for _ in range(4))
    for island, (a, w, x, g) in enumerate(alone):
        rows = np.flatnonzero(owner == island)
        whole[np.ix_(rows, rows)], weights[rows], right[rows], given[rows] = a, w, a @ x, g
        expected[rows] = parts[island]
    assert parts[0][0] != 0.0
    found = solved(whole, weights, right, given, closed[:1])
    np.testing.assert_allclose(found, expected, rtol=1e-12)
