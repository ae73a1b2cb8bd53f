"""Rosenbrock methods: order conditions, L-stability, and the linear systems behind them."""

from __future__ import annotations

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.integrators.implicit import ROSENBROCK
from test.integrators.classic_form import classic, require_l_stable
from test.oracles.rooted_trees import density, trees, weights

ALL = pytest.mark.parametrize("method", ROSENBROCK.values(), ids=ROSENBROCK)


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
    require_l_stable(method, np.geomspace(1e-3, 1e4, 2000))


@ALL
def test_singular_configurations_are_passed(method):
    """A parallelogram passes its flat configuration, where the Jacobian is unbounded, about ten times."""
    simulation = Simulation.from_file("a02_four_bars", method=method.name)
    simulation.run(until=20.0)
    assert abs(simulation.energies.residual) < 1e-9
    assert max(simulation.violation) < 1e-9
