"""Friction at rest that is as far from its limits as possible, against a general optimizer."""

import numpy as np
import pytest
from scipy.optimize import minimize

from mbd_sim.simulation.contact.centering import centered


def problem(seed, contacts=4):
    """Friction of some contacts of a body in a plane: its rows (2 n, 3), forces, and limits that some forces exceed."""
    chance = np.random.default_rng(seed)
    places = chance.uniform(-1.0, 1.0, (contacts, 2))
    rows = np.array([row for x, y in places for row in ((1.0, 0.0, -y), (0.0, 1.0, x))])
    limits = chance.uniform(0.5, 1.5, contacts)
    return rows, chance.normal(size=2 * contacts) * 0.6, limits


def sizes(forces, limits):
    return np.linalg.norm(forces.reshape(-1, 2), axis=1) / limits


def least_factor(rows, forces, limits):
    """The least factor of all limits, by virtual work: the largest power of the load over that of friction."""
    load = rows.T @ forces

    def power(motion):
        return -(load @ motion) / (limits @ np.linalg.norm((rows @ motion).reshape(-1, 2), axis=1))

    starts = np.random.default_rng(0).normal(size=(8, 3))
    return -min(minimize(power, start, method="Nelder-Mead", options={"xatol": 1e-10}).fun for start in starts)


@pytest.mark.parametrize("seed", range(4))
def test_the_product_of_reserves_is_largest_in_any_order_and_with_other_units(seed):
    rows, forces, limits = problem(seed)
    elements = [(2 * index, 2 * index + 1) for index in range(len(limits))]
    factor = least_factor(rows, forces, limits)
    found, shared = centered(rows @ rows.T, elements, limits, forces)
    assert shared == [0, 1, 2, 3] and rows.T @ found == pytest.approx(rows.T @ forces, abs=1e-12)
    order = np.random.default_rng(seed).permutation(len(limits))
    moved = [row for index in order for row in elements[index]]
    other, _ = centered((rows @ rows.T)[moved][:, moved], elements, 1e-6 * limits[order], 1e-6 * forces[moved])
    assert 1e6 * other == pytest.approx(found[moved], abs=1e-9)
    if factor < 1.0:
        free = np.linalg.svd(rows.T)[2][3:].T
        assert np.max(sizes(found, limits)) < 1.0

        def barrier(z):
            inside = 1.0 - sizes(found + free @ z, limits) ** 2
            return -np.sum(np.log(inside)) if np.min(inside) > 0.0 else 1e9

        better = minimize(barrier, np.full(free.shape[1], 1e-3), method="Nelder-Mead", options={"xatol": 1e-10})
        assert better.fun == pytest.approx(barrier(np.zeros(free.shape[1])), abs=1e-12)
    else:
        assert np.max(sizes(found, limits)) == pytest.approx(factor, rel=0.5) and np.max(sizes(found, limits)) >= 1.0


def test_friction_that_reaches_its_limits_has_the_common_factor_of_all_of_them():
    """Two contacts on a line, with limits of 1 and 3 N: 4 N are just too much, and a little less is not."""
    matrix, elements, limits = np.ones((2, 2)), [(0,), (1,)], [1.0, 3.0]
    found, _ = centered(matrix, elements, limits, np.array([1.0, 3.0]))
    assert found == pytest.approx([1.0, 3.0], abs=1e-9) and np.max(found / limits) >= 1.0 - 1e-9
    found, _ = centered(matrix, elements, limits, np.array([1.0, 3.0 - 1e-6]))
    assert np.max(found / limits) < 1.0 - 1e-7 and found.sum() == pytest.approx(4.0 - 1e-6, abs=1e-14)


def test_friction_at_its_limit_across_the_direction_that_is_shared_stays_there():
    """As of one of two points of a body: it was rounded to its limit in a step of the search, which divided by zero."""
    for seed in range(100):
        chance = np.random.default_rng(seed)
        places = chance.uniform(-1.0, 1.0, (2, 2))
        line = (places[1] - places[0]) / np.linalg.norm(places[1] - places[0])
        rows = np.array([row for x, y in places for row in ((1.0, 0.0, -y), (0.0, 1.0, x))])
        across = np.array([-line[1], line[0]])
        forces = np.concatenate([0.1 * chance.normal(size=2), across + 10.0 ** chance.uniform(-17.0, -5.0) * line])
        limits = np.array([1.0, np.hypot(*across) * (1.0 + chance.integers(-1, 3) * 1.2e-16)])
        found, shared = centered(rows @ rows.T, [(0, 1), (2, 3)], limits.tolist(), forces)
        assert shared == [0, 1] and rows.T @ found == pytest.approx(rows.T @ forces, abs=1e-14)
        assert found[2:] == pytest.approx(across, abs=1e-4) and sizes(found, limits)[1] == pytest.approx(1.0, abs=1e-9)


def test_friction_that_shares_nothing_stays():
    forces = np.array([0.3, 0.2])
    found, shared = centered(np.eye(2), [(0,), (1,)], [1.0, 1.0], forces)
    assert found is forces and shared == []
