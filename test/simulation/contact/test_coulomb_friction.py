"""Contact problems: Lemke's method, elimination, and forces with friction along one and two directions."""

import math

import numpy as np
import pytest

from mbd_sim.simulation.contact.complementarity import independent, lemke, solve
from mbd_sim.simulation.contact.problem import ContactProblem, FrictionLimit, NoSolutionError, contact_forces


def _random_matrix(rng, n, rank=None):
    factor = rng.normal(size=(n, n if rank is None else rank))
    return factor @ factor.T


@pytest.mark.parametrize("seed", range(40))
def test_lemke_satisfies_the_conditions(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 12))
    matrix, right = _random_matrix(rng, n, n if seed % 2 else max(1, n // 2)), rng.normal(size=n)
    if seed % 2 == 0:
        right = matrix @ rng.uniform(-1.0, 0.5, n)  # so that there is a solution
    z = lemke(matrix, right)
    assert z is not None
    w = matrix @ z + right
    assert np.all(z >= 0.0) and np.all(w >= -1e-9) and abs(z @ w) < 1e-8


def test_lemke_ends_on_a_ray_without_a_solution():
    assert lemke(np.array([[0.0]]), np.array([-1.0])) is None


@pytest.mark.parametrize("seed", range(20))
def test_elimination_solves(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 12))
    matrix, right = rng.normal(size=(n, n)), rng.normal(size=n)
    assert solve(matrix, right) == pytest.approx(np.linalg.solve(matrix, right), rel=1e-9)


def test_elimination_of_a_singular_system_gives_a_solution():
    matrix = np.array([[2.0, 2.0, 0.0], [2.0, 2.0, 0.0], [0.0, 0.0, 3.0]])
    x = solve(matrix, np.array([4.0, 4.0, 6.0]))
    assert matrix @ x == pytest.approx([4.0, 4.0, 6.0])


def test_independent_rows_follow_the_order():
    factor = np.array([[1.0, 0.0], [2.0, 0.0], [1.0, 1.0]])
    assert independent(factor @ factor.T, [1, 0, 2]) == [1, 2]
    assert independent(factor @ factor.T, [2, 0, 1]) == [2, 0]


@pytest.mark.parametrize("seed", range(60))
def test_forces_with_friction_in_two_directions_satisfy_coulomb(seed):
    """Several contacts with μ ≤ 0.3 on one mechanism: cones, complementarity and maximum dissipation."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 5))
    matrix = _random_matrix(rng, 3 * count) + 0.1 * np.eye(3 * count)
    free, mu = rng.normal(size=3 * count), 0.3 * rng.random()
    limits = [FrictionLimit((count + 2 * k, count + 2 * k + 1), k, mu) for k in range(count)]
    problem = ContactProblem(matrix, free, list(range(count)), limits)
    try:
        forces = contact_forces(problem)
    except NoSolutionError:
        pytest.fail("no forces were found")
    rates = matrix @ forces + free
    for k, limit in enumerate(limits):
        rows = list(limit.rows)
        assert forces[k] >= 0.0 and rates[k] > -1e-8 and abs(forces[k] * rates[k]) < 1e-8
        size, slip = math.hypot(*forces[rows]), math.hypot(*rates[rows])
        assert size <= mu * forces[k] + 1e-8
        assert forces[rows] @ rates[rows] == pytest.approx(-size * slip, abs=1e-7)
        assert slip < 1e-7 or size == pytest.approx(mu * forces[k], abs=1e-7)


def test_friction_without_a_normal_row_has_a_fixed_limit():
    problem = ContactProblem(np.array([[2.0]]), np.array([-3.0]), [], [FrictionLimit((0,), None, 1.0)])
    assert contact_forces(problem) == pytest.approx([1.0])
    problem = ContactProblem(np.array([[2.0]]), np.array([-1.0]), [], [FrictionLimit((0,), None, 1.0)])
    assert contact_forces(problem) == pytest.approx([0.5])
