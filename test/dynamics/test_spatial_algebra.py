"""Matrices of numbers as CasADi's, with structural zeros."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from mbd_sim.dynamics.spatial_algebra import constant, sparse


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
