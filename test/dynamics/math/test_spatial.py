"""Matrices of numbers as CasADi's, with structural zeros."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from mbd_sim.dynamics.math.spatial import constant, sparse, symmetric


@pytest.mark.parametrize("array", [np.array([1.0, 0.0, -2.5]), np.arange(6.0).reshape(2, 3).T, np.zeros((0, 2))])
def test_a_constant_has_the_numbers_and_the_zeros_of_the_array(array):
    found = constant(array)
    columns = array[:, None] if array.ndim == 1 else array
    assert found.shape == columns.shape and found.nnz() == np.count_nonzero(array)
    np.testing.assert_array_equal(np.array(ca.DM(found)), columns)


def test_a_constant_that_is_changed_changes_no_other():
    array = np.eye(2)
    constant(array)[0, 0] = 3.0
    np.testing.assert_array_equal(np.array(ca.DM(constant(array))), np.eye(2))


def test_zeros_of_expressions_become_structural():
    x = ca.SX.sym("x", 3)
    with_zero = ca.vertcat(x[0], x[1] - x[1], x[2])
    assert with_zero.nnz() == 3
    assert sparse(with_zero).nnz() == 2
    assert sparse(with_zero).sparsity() == ca.sparsify(with_zero).sparsity()
    assert sparse(x) is x


UPPER = {
    "dense": np.ones((3, 3)),
    "zeros above": np.array([[1.0, 0.0, 1.0], [1.0, 1.0, 0.0], [1.0, 1.0, 1.0]]),
    "zeros below": np.array([[1.0, 1.0, 1.0], [0.0, 0.0, 1.0], [1.0, 0.0, 1.0]]),
    "nothing": np.zeros((2, 2)),
    "one": np.ones((1, 1)),
    "empty": np.zeros((0, 0)),
}


@pytest.mark.parametrize("pattern", UPPER.values(), ids=UPPER)
def test_a_symmetric_matrix_consists_of_the_upper_triangle(pattern):
    size = len(pattern)
    given = ca.sparsify(ca.SX.sym("x", size, size) * ca.SX(pattern))
    found = symmetric(given)
    assert found.shape == given.shape
    assert found.nnz() == np.count_nonzero(np.triu(pattern) + np.triu(pattern, 1).T)
    for row, column in np.ndindex(size, size):
        assert ca.is_equal(found[row, column], given[min(row, column), max(row, column)])


def test_an_entry_of_its_diagonal_is_not_computed_again():
    x = ca.SX.sym("x", 2, 2)
    found = symmetric(0.09 * x)
    assert (
        ca.Function("f", [x], [found]).n_instructions()
        == ca.Function("f", [x], [ca.triu(0.09 * x)]).n_instructions() + 1
    )
    assert float(ca.Function("f", [x], [found])(0.7)[0, 0]) == 0.09 * 0.7
