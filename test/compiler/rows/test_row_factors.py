"""The compiled product of factors in blocks against numpy's."""

import ctypes

import numpy as np
import pytest

from mbd_sim.compiler.code.host_module import compile_module, new_module
from mbd_sim.compiler.ir.builder import IRBuilder
from mbd_sim.compiler.ir.dense_solver import emit_dense_solver
from mbd_sim.compiler.ir.module import POINTER, VOID, Function, FunctionType
from mbd_sim.compiler.rows.row_factors import FactorBlock, RowFactor, emit_product
from mbd_sim.compiler.rows.shared_rows import ActiveRows

SIZE, ROWS, GAPS = 11, 9, 3


def random_factor(chance, blocks):
    """Rows that combine none, one or two of the blocks."""
    terms, count = [], 0
    for _ in range(ROWS):
        own = []
        for number in sorted(chance.permutation(len(blocks))[: chance.integers(0, 3)].tolist()):
            own.append((number, count))
            count += blocks[number].columns
        terms.append(tuple(own))
    return RowFactor(SIZE, blocks, tuple(terms), count)


def matrix_of(factor, numbers):
    """The matrix (SIZE, ROWS) of a factor, entry by entry."""
    found = np.zeros((SIZE, ROWS))
    for row, terms in enumerate(factor.terms):
        for number, offset in terms:
            block, start = factor.blocks[number], factor.starts[number]
            for column in range(block.columns):
                for k, place in enumerate(block.places):
                    weight = numbers[factor.starts[-1] + offset + column]
                    found[place, row] += weight * numbers[start + column * len(block.places) + k]
    return found


@pytest.mark.parametrize(("seed", "many"), [(0, 100), (1, 100), (2, 100), (0, 1)])
def test_products_have_the_entries_that_are_needed(seed, many, monkeypatch):
    """Those of rows that are active, closed or have a given force; of sliding friction the diagonal without friction."""
    monkeypatch.setattr("mbd_sim.compiler.rows.row_factors.MANY", many)
    chance = np.random.default_rng(seed)
    places = [tuple(sorted(chance.permutation(SIZE)[: chance.integers(1, SIZE)].tolist())) for _ in range(4)]
    blocks = tuple(
        FactorBlock(own, int(columns)) for own, columns in zip(places, chance.integers(1, 7, size=4), strict=True)
    )
    left, right = random_factor(chance, blocks), random_factor(chance, blocks)
    numbers = [chance.normal(size=each.starts[-1] + each.coefficients) for each in (left, right)]
    masks = [chance.normal(size=size) * (chance.random(size) < 0.4) for size in (GAPS, ROWS, ROWS - GAPS, ROWS)]
    closed, active, directions, given = masks
    module = new_module()
    solver = emit_dense_solver(module, ROWS, counted=True)
    rows = ActiveRows(ROWS, GAPS, GAPS + 2 * ROWS - GAPS, solver, GAPS)
    product = emit_product(module, "product", (left, right), rows)
    function = Function(module, FunctionType(VOID, [POINTER] * 5), "exported")
    b = IRBuilder(function.append_basic_block("entry"))
    b.call(product, function.args)
    b.ret_void()
    code = compile_module(module)
    found, mobility = np.full(ROWS * ROWS, np.nan), np.full(ROWS, np.nan)
    arrays = np.concatenate(masks), *numbers, found, mobility
    ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 5)(code.address("exported"))(*(each.ctypes.data for each in arrays))

    needed = (active != 0.0) | (given != 0.0) | np.concatenate([closed != 0.0, np.zeros(ROWS - GAPS, dtype=bool)])
    first, second = matrix_of(left, numbers[0]), matrix_of(right, numbers[1])
    whole = found.reshape(ROWS, ROWS).T
    np.testing.assert_allclose(whole[np.ix_(needed, needed)], (first.T @ second)[np.ix_(needed, needed)], atol=1e-13)
    assert np.all(np.isnan(whole[~needed]))
    own = np.concatenate([numbers[1][: right.starts[-1]], numbers[0][left.starts[-1] :]])
    expected = np.sum(first * matrix_of(left, own), axis=0)[GAPS:] * (directions != 0.0)
    np.testing.assert_allclose(mobility[GAPS:], expected, atol=1e-13)
