"""Pieces are selected without rounding, and there are no more panels than the integrand requires."""

import casadi as ca
import numpy as np
import pytest

from mbd_sim.dynamics.math.piecewise import MAX_PANELS, integral, panels_of, select

X = ca.SX.sym("x")


def test_select_returns_the_numbers_without_rounding():
    knots = np.array([-1.0, 0.5, 2.0])
    columns = np.random.default_rng(72).normal(size=(4, 2)) * [1.0, 1e-20]
    at = ca.Function("at", [X], [select(X, knots, columns)])
    for x, row in ((-9.0, 0), (-1.0, 1), (0.4, 1), (0.5, 2), (1.9, 2), (2.0, 3), (1e9, 3)):
        assert np.array(at(x)).ravel().tolist() == columns[row].tolist()


def test_a_polynomial_needs_one_panel_on_each_side():
    panels = panels_of(lambda x: x**5 - x, -3.0, 20.0)
    assert panels.knots.tolist() == [-3.0, 20.0]
    assert panels.origins.tolist() == [-3.0, 0.0, 20.0]


@pytest.mark.parametrize("upper", [0.0, 2.0])
def test_a_range_may_lie_on_one_side_of_zero(upper):
    panels = panels_of(lambda x: 3.0 * x, 0.0, upper)
    at = ca.Function("at", [X], [integral(lambda x: 3.0 * x, panels, X)])
    for x in (-1.0, 0.0, 1.5, 4.0):
        assert float(at(x)) == pytest.approx(1.5 * x**2, rel=1e-14)


def test_panels_are_halved_about_a_kink_and_are_limited():
    panels = panels_of(lambda x: ca.fmax(x - 0.3, 0.0), 0.0, 8.0)
    assert np.min(np.abs(panels.knots - 0.3)) < 1e-10
    wild = panels_of(lambda x: ca.sin(1e6 * x), 0.0, 8.0)
    assert len(wild.knots) <= MAX_PANELS + 1


def test_panels_end_where_the_force_overflows():
    panels = panels_of(lambda x: ca.exp(x / 0.01), 0.0, 20.0)
    assert 1.0 < panels.knots[-1] < 7.1
    assert np.all(np.isfinite(panels.values))
