"""Small matrices on Python's floats have the bits of the stacked decompositions, zeros and their signs included."""

import numpy as np
import pytest

from mbd_sim.base import linear_algebra as la
from test.base.test_linear_algebra import matrices


@pytest.fixture
def both(monkeypatch):
    """A function that calls another one with small matrices on their own path, and without it."""

    def results(function):
        found = []
        for limit in (la.SMALL, -1):
            monkeypatch.setattr(la, "SMALL", limit)
            found.append(function())
        monkeypatch.undo()
        return found

    return results


def test_bits_are_those_of_stacks(both):
    random = np.random.default_rng(6)
    for number, (matrix, _) in enumerate(matrices(40)):
        if number % 5 == 0:
            matrix[random.integers(len(matrix))] = 0.0
        right = random.normal(size=(len(matrix), number % 3))
        for limit in (None, 1e-9):
            small, stacked = both(lambda a=matrix, b=right, most=limit: la.least_solution(a, b, most))
            assert small.shape == stacked.shape and small.tobytes() == stacked.tobytes()
        for function in (la.null_space, lambda a, limit: la.ranks(a[None], limit)):
            small, stacked = both(lambda a=matrix, of=function: of(a, 1e-9))
            assert small.shape == stacked.shape and small.tobytes() == stacked.tobytes()
        symmetric = matrix @ matrix.T - (number % 2) * np.diag(random.normal(size=len(matrix)))
        for small, stacked in zip(*both(lambda a=symmetric: la.eigh(a)), strict=True):
            assert small.shape == stacked.shape and small.tobytes() == stacked.tobytes()


def test_what_is_not_finite_or_empty_is_left_to_stacks(both):
    undefined = np.array([[1.0, np.nan], [np.nan, 2.0]])
    with np.errstate(all="ignore"):
        small, stacked = both(lambda: la.least_solution(undefined, np.ones(2)))
    assert np.array_equal(small, stacked, equal_nan=True)
    assert la.eigh(np.zeros((0, 0)))[1].shape == (0, 0)
