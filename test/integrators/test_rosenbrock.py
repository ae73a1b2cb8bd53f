"""Rosenbrock methods: order conditions, L-stability, and the linear systems behind them."""

from __future__ import annotations

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.integrators.rosenbrock import ROSENBROCK
from test.oracles.rooted_trees import density, trees, weights

ALL = pytest.mark.parametrize("method", ROSENBROCK.values(), ids=ROSENBROCK)


def lower(rows):
    matrix = np.zeros((len(rows), len(rows)))
    for row, values in enumerate(rows):
        matrix[row, : len(values)] = values
    return matrix


def classic(method):
    """α, Γ, b and the embedded weights' difference, in the form with products with J (Hairer & Wanner II, eq. IV.7.4)."""
    gamma = np.linalg.inv(np.eye(method.stages) / method.gamma - lower(method.g))
    return lower(method.a) @ gamma, gamma, np.array(method.m) @ gamma, np.array(method.estimate.fine) @ gamma


@ALL
def test_row_sums_are_the_nodes(method):
    alpha, gamma, b, _ = classic(method)
    assert alpha.sum(axis=1) == pytest.approx(method.c, abs=1e-13)
    assert gamma.sum(axis=1) == pytest.approx(method.d, abs=1e-13)
    assert b.sum() == pytest.approx(1.0, abs=1e-13)


@ALL
def test_every_order_condition_holds(method):
    alpha, gamma, b, _ = classic(method)
    for order in range(1, method.order + 1):
        for tree in trees(order):
            assert b @ weights(tree, alpha, alpha + gamma) == pytest.approx(1.0 / density(tree), abs=1e-12)
    missed = [b @ weights(tree, alpha, alpha + gamma) - 1.0 / density(tree) for tree in trees(method.order + 1)]
    assert max(map(abs, missed)) > 1e-5


@ALL
def test_the_embedded_method_has_one_order_less(method):
    alpha, gamma, _, d = classic(method)
    for order in range(1, method.order):
        for tree in trees(order):
            assert abs(d @ weights(tree, alpha, alpha + gamma)) < 1e-12
    assert max(abs(d @ weights(tree, alpha, alpha + gamma)) for tree in trees(method.order)) > 1e-4


@ALL
def test_it_is_l_stable_and_stiffly_accurate(method):
    alpha, gamma, b, _ = classic(method)
    beta, one = alpha + gamma, np.ones(method.stages)

    def stability(z):
        return 1.0 + z * b @ np.linalg.solve(np.eye(method.stages) - z * beta, one)

    assert max(abs(stability(1j * y)) for y in np.geomspace(1e-3, 1e4, 2000)) < 1.0 + 1e-9
    assert abs(stability(-1e9)) < 1e-6
    assert b == pytest.approx(beta[-1], abs=1e-12)


@ALL
def test_singular_configurations_are_passed(method):
    """A parallelogram passes its flat configuration, where the Jacobian is unbounded, about ten times."""
    simulation = Simulation.from_file("a02_four_bars", method=method.name)
    simulation.run(until=20.0)
    assert abs(simulation.energies.residual) < 1e-9
    assert max(simulation.violation) < 1e-9
