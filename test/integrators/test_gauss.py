"""Gauss methods: their conditions, and conservation of energy and reversibility over many steps."""

from __future__ import annotations

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.integrators.implicit import GAUSS

ALL = pytest.mark.parametrize("method", GAUSS.values(), ids=GAUSS)


@ALL
def test_they_are_collocation_at_the_gauss_points(method):
    a, b, c = map(np.array, (method.a, method.b, method.c))
    nodes, weights = np.polynomial.legendre.leggauss(method.stages)
    assert c == pytest.approx((nodes + 1.0) / 2.0, abs=1e-15)
    assert b == pytest.approx(weights / 2.0, abs=1e-15)
    for power in range(1, method.stages + 1):
        assert a @ c ** (power - 1) == pytest.approx(c**power / power, abs=1e-15)
    assert method.order == 2 * method.stages


@ALL
def test_they_are_symplectic_and_symmetric(method):
    """b_i a_ij + b_j a_ji = b_i b_j, and a_ij + a_(s-i)(s-j) = b_j (Hairer, Lubich & Wanner, eq. VI.4.2 and V.2.4)."""
    a, b = np.array(method.a), np.array(method.b)
    assert b[:, None] * a + (b[:, None] * a).T == pytest.approx(np.outer(b, b), abs=1e-16)
    assert a + a[::-1, ::-1] == pytest.approx(np.tile(b, (method.stages, 1)), abs=1e-15)


@ALL
def test_estimates_compare_the_slope_at_the_start_with_its_extrapolation(method):
    """The polynomial of degree s - 1 through the slopes at the nodes, evaluated at 0, less the slope there."""
    first, *others = np.array(method.estimate.fine)
    for power in range(method.stages):
        assert first * 0.0**power + others @ np.array(method.c) ** power == pytest.approx(0.0, abs=1e-15)
    assert abs(others @ np.array(method.c) ** method.stages) > 1e-3


def energies(name, method, step):
    """The largest energy residual in J over the first and over the last tenth of 10⁵ steps."""
    simulation = Simulation.from_file(name, method=method, step=step)
    worst = []
    for _ in range(10):
        largest = 0.0
        for _ in range(10):
            simulation.step(1031)
            largest = max(largest, abs(simulation.energies.residual))
        worst.append(largest)
    return worst[0], worst[-1]


@pytest.mark.parametrize(
    ("name", "method", "bound"),
    [
        ("simple_pendulum", "gauss4", 1e-8),  # a constant mass matrix: symplectic
        ("cart_pendulum_spring", "gauss6", 1e-10),  # the mass matrix changes: symmetric only
    ],
)
def test_energy_does_not_drift_over_many_steps(name, method, bound):
    first, last = energies(name, method, 1e-2)
    assert first < bound
    assert last < 2.0 * first + 3e-12
    _, drifted = energies(name, "rk4", 1e-2)
    assert drifted > 100.0 * last


@pytest.mark.parametrize(("name", "method"), [("cart_pendulum_spring", "gauss4"), ("heavy_top", "gauss6")])
def test_reversed_motion_returns_to_the_start(name, method):
    """Up to round-off, while RK4 at the same step ends far away."""

    def gap(method):
        simulation = Simulation.from_file(name, method=method, step=step)
        start = simulation.q.copy()
        simulation.step(500)
        simulation.reset(simulation.q.copy(), -simulation.u)
        simulation.step(500)
        return np.max(np.abs(simulation.q - start))

    step = 2e-3 if name == "heavy_top" else 5e-2
    assert gap(method) < 1e-12
    assert gap("rk4") > 1e-6


def test_quadratic_invariants_are_conserved():
    """The length of the quaternion, and the energy and momentum of the spin of a free body, at a step of 0.1 s."""
    simulation = Simulation.from_file("tumbling", method="gauss4", step=0.1)
    simulation.step(10_000)
    assert abs(simulation.energies.residual) < 1e-12
