"""Decompositions beside those of LAPACK, on random matrices of all ranks; stacks beside single matrices."""

import numpy as np
import pytest

from mbd_sim.base import linear_algebra as la


def matrices(count=120):
    """Random matrices (m, n) with their ranks; every other one has columns of different sizes."""
    random = np.random.default_rng(0)
    for number in range(count):
        m, n = random.integers(1, 12, 2)
        rank = int(random.integers(0, min(m, n) + 1)) if number % 2 else min(m, n)
        matrix = random.normal(size=(m, rank)) @ random.normal(size=(rank, n))
        if number % 4 == 0:
            matrix = random.normal(size=(m, n)) * 10.0 ** random.integers(-6, 6, (1, n))
        yield matrix, rank


def largest(array):
    return float(np.abs(array).max(initial=0.0))


def test_singular_values_and_axes_are_those_of_the_matrix():
    for matrix, _ in matrices():
        left, sizes, right = la.svd(matrix)
        expected = np.linalg.svd(matrix)[1]
        assert largest(sizes - expected) <= 1e-14 * largest(expected)
        assert largest(left.T @ left - np.eye(len(left))) < 1e-14
        assert largest(right @ right.T - np.eye(len(right))) < 1e-14
        assert largest((left[:, : len(sizes)] * sizes) @ right[: len(sizes)] - matrix) <= 1e-14 * largest(expected)


def test_least_solutions_and_null_spaces_of_all_ranks():
    random = np.random.default_rng(1)
    for matrix, rank in matrices():
        right = random.normal(size=(len(matrix), 2))
        reference = np.linalg.norm(matrix, 2)
        if not rank or not reference > 1e-3:
            continue
        found = la.least_solution(matrix, right, 1e-9)
        expected = np.linalg.lstsq(matrix, right, rcond=1e-9 / reference)[0]
        sizes = np.linalg.svd(matrix)[1]
        condition = reference / sizes[sizes > 1e-9].min()
        assert largest(found - expected) <= 1e-14 * condition * max(1.0, largest(expected))
        assert int(la.ranks(matrix[None], 1e-9)[0]) == np.linalg.matrix_rank(matrix, tol=1e-9)
        free = la.null_space(matrix, 1e-9)
        assert free.shape[1] == matrix.shape[1] - np.linalg.matrix_rank(matrix, tol=1e-9)
        assert largest(matrix @ free) < 1e-9
        assert largest(free.T @ free - np.eye(free.shape[1])) < 1e-14


@pytest.mark.parametrize("size", [0.3, 1.0, 3.0])
def test_singular_values_near_the_limit_decide_the_rank(size):
    axes = [la.svd(np.random.default_rng(seed).normal(size=(5, 5)))[0] for seed in (0, 1)]
    matrix = axes[0] @ np.diag([1.0, 0.5, 1e-3, size * 1e-9, 1e-17]) @ axes[1]
    rank = 4 if size > 1.0 else 3
    if size != 1.0:
        assert int(la.ranks(matrix[None], 1e-9)[0]) == rank
        assert la.null_space(matrix, 1e-9).shape[1] == 5 - rank
    assert la.null_space(matrix, 1e-9, rank=4).shape[1] == 1


def test_symmetric_matrices():
    random = np.random.default_rng(2)
    for size in range(1, 9):
        matrix = random.normal(size=(size, size)) * 10.0 ** random.integers(-3, 3, (size, 1))
        matrix = matrix + matrix.T
        values, axes = la.eigh(matrix)
        assert largest(values - np.linalg.eigvalsh(matrix)) <= 1e-14 * largest(matrix) * max(size, 1)
        assert largest(matrix @ axes - axes * values) <= 1e-14 * largest(matrix) * max(size, 1)
        assert largest(la.inverse(matrix) @ matrix - np.eye(size)) < 1e-8
        assert largest(la.inverse_of_symmetric(matrix) @ matrix - np.eye(size)) < 1e-8
    with pytest.raises(np.linalg.LinAlgError):
        la.inverse(np.zeros((2, 2)))


def test_each_of_many_has_the_bits_that_it_has_alone():
    random = np.random.default_rng(3)
    stack = random.normal(size=(7, 5, 4))
    stack[2, :, 1] = stack[2, :, 0]  # of another rank
    stack[3] *= [1.0, 1.0, 1e-9, 1.0]  # of a doubtful one
    rights = random.normal(size=(7, 5, 1))
    together = la.least_solutions(stack, rights, np.full(7, 1e-9))
    alone = [la.least_solutions(stack[[k]], rights[[k]], np.array([1e-9]))[0] for k in range(7)]
    assert np.array_equal(together, np.array(alone))
    vectors = random.normal(size=(7, 4, 1))
    assert np.array_equal(
        la.products(stack, vectors)[:, :, 0], [la.product(m, v[:, 0]) for m, v in zip(stack, vectors, strict=True)]
    )
    assert np.array_equal(la.norms(stack[:, 0]), [la.norm(row) for row in stack[:, 0]])


def test_products_are_those_of_numpy_but_for_round_off():
    random = np.random.default_rng(4)
    for shapes in [
        ((3,), (3,)),
        ((2, 3), (3,)),
        ((3,), (3, 4)),
        ((2, 3), (3, 4)),
        ((5, 2, 3), (3, 4)),
        ((0, 3), (3, 2)),
    ]:
        one, other = (random.normal(size=shape) for shape in shapes)
        assert np.allclose(la.product(one, other), one @ other, rtol=0.0, atol=1e-14)
        assert np.shape(la.product(one, other)) == np.shape(one @ other)
    with pytest.raises(ValueError, match=r"\(2, 3\) and \(2, 4\)"):
        la.product(np.ones((2, 3)), np.ones((2, 4)))


def test_cross_products_have_the_bits_of_numpy():
    one, other = np.random.default_rng(4).normal(size=(2, 5, 3))
    for pair in ((one, other), (one, other[0]), (one[0], other[0])):
        assert np.array_equal(la.cross(*pair), np.cross(*pair))
