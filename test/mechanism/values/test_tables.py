"""Tables of one and two variables: through their points, smooth, linear beyond; the same in numbers and in CasADi."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

from mbd_sim.dynamics.math.piecewise import looked_up
from mbd_sim.mechanism.values.tables import BicubicSurface, Curve

X, Y = (-1.0, 0.0, 0.5, 2.0, 2.5), (0.0, 1.0, 1.5, 4.0)
VALUES = (2.0, -1.0, 3.0, 3.5, 0.0)
CURVE = Curve(X, VALUES)
PERIODIC = Curve((0.5, 1.0, 2.0, 3.5), (1.0, -2.0, 4.0, 1.0), 3.0)
SURFACE = BicubicSurface(X, Y, tuple(map(tuple, np.random.default_rng(3).normal(size=(5, 4)).tolist())))
PLACES = np.random.default_rng(4).uniform(-6.0, 9.0, (400, 2))


def symbolic(table):
    x = ca.SX.sym("x", table.dimension)
    value = looked_up(table, *ca.vertsplit(x))
    return ca.Function("f", [x], [value]), ca.Function("g", [x], [ca.gradient(value, x)])


@pytest.mark.parametrize("table", [CURVE, PERIODIC, SURFACE], ids=["curve", "periodic", "surface"])
def test_kernels_and_numbers_agree(table):
    f, _ = symbolic(table)
    for place in PLACES:
        at = place[: table.dimension]
        assert float(f(at)) == pytest.approx(table.at(*at), rel=1e-13, abs=1e-13)


def test_a_curve_is_the_pchip_of_scipy():
    reference = PchipInterpolator(X, VALUES)
    for x in np.linspace(-1.0, 2.5, 101):
        assert CURVE.at(x) == pytest.approx(float(reference(x)), abs=1e-13)
    assert CURVE.at(3.5) - CURVE.at(2.5) == pytest.approx(float(reference.derivative()(2.5)), abs=1e-13)


def test_a_periodic_curve_repeats_itself_without_a_kink():
    f, slope = symbolic(PERIODIC)
    for x in PLACES[:, 0]:
        assert PERIODIC.at(x) == pytest.approx(PERIODIC.at(x + 6.0), abs=1e-12)
    seam = 0.5
    assert float(slope(seam - 1e-9)) == pytest.approx(float(slope(seam)), abs=1e-6)
    assert float(f(seam - 1e-9)) == pytest.approx(1.0, abs=1e-8)


def test_a_surface_goes_through_its_points_and_is_a_curve_along_each_grid_line():
    for i, x in enumerate(X):
        row = Curve(Y, SURFACE.values[i])
        for y in np.linspace(-2.0, 6.0, 41):
            assert SURFACE.at(x, y) == pytest.approx(row.at(y), abs=1e-12)
    for j, y in enumerate(Y):
        column = Curve(X, tuple(values[j] for values in SURFACE.values))
        for x in np.linspace(-3.0, 5.0, 41):
            assert SURFACE.at(x, y) == pytest.approx(column.at(x), abs=1e-12)


def test_the_slopes_of_a_surface_are_continuous_everywhere():
    _, slopes = symbolic(SURFACE)
    for x in (*X, -0.7, 3.0):
        for y in (*Y, 0.3, -1.0, 5.0):
            around = [np.array(slopes([x + dx, y + dy])).ravel() for dx in (-1e-9, 1e-9) for dy in (-1e-9, 1e-9)]
            assert np.ptp(around, axis=0) == pytest.approx(np.zeros(2), abs=1e-6)
