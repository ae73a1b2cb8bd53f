"""Independent rows span all others where the rank is highest; null spaces are orthonormal."""

import numpy as np
import pytest

from mbd_sim.dynamics.math.rank import independent_rows, null_space, rank_of


def test_independent_rows_span_all_others():
    rng = np.random.default_rng(2)
    basis = rng.normal(size=(3, 6))
    rows = np.vstack([basis[0], 2.0 * basis[0], basis[1], np.zeros(6), basis[0] - basis[1], basis[2]])
    keep, ranks = independent_rows([rows])
    assert ranks == [3]
    assert rank_of(rows[keep]) == 3 == len(keep)
    assert keep == sorted(keep)


def test_rows_are_chosen_for_where_they_add_least():
    """The third row is the first one where the mechanism starts, but the second one nearby."""
    one, two = np.eye(2)
    start = np.array([one, two, one])
    near = np.array([one, two, two])
    tilted = np.array([one, one + 1e-3 * two, two])
    assert independent_rows([start, near])[0] == [0, 1]
    assert independent_rows([start, tilted])[0] != [0, 2]
    assert independent_rows([tilted])[0] == [0, 2]


def test_configurations_of_smaller_rank_do_not_count():
    """A parallelogram that starts flat has one row less there."""
    flat = np.array([[1.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
    usual = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    keep, ranks = independent_rows([flat, usual, usual])
    assert keep == [0, 1]
    assert ranks == [1, 2, 2]


def test_null_space():
    rng = np.random.default_rng(3)
    matrix = rng.normal(size=(2, 5))
    basis = null_space(np.vstack([matrix, matrix[0]]))
    assert basis.shape == (5, 3)
    assert basis.T @ basis == pytest.approx(np.eye(3), abs=1e-14)
    assert matrix @ basis == pytest.approx(np.zeros((2, 3)), abs=1e-14)
    assert null_space(np.zeros((0, 3))).shape == (3, 3)
