"""The coefficients of every method: consistency, all order conditions, and the order of a compiled run."""

from __future__ import annotations

from fractions import Fraction
from math import factorial

import casadi as ca
import numpy as np
import pytest

from mbd_sim.compiler.kernel import compile_kernel
from mbd_sim.integrators.explicit import EXPLICIT as METHODS
from test.oracles.rooted_trees import density, symmetry, trees, weights

ALL = pytest.mark.parametrize("method", METHODS.values(), ids=METHODS)


def matrix(method):
    """Not summed by NumPy's linear algebra, of which round-off depends on the processor."""
    a = np.zeros((method.stages, method.stages), dtype=np.longdouble)
    for row, values in enumerate(method.a):
        a[row, : len(values)] = values
    return a


def test_the_number_of_trees_is_that_of_the_literature():
    assert [len(trees(order)) for order in range(1, 9)] == [1, 1, 2, 4, 9, 20, 48, 115]
    # Σ n!/(σ γ) over the trees of n nodes counts the labeled trees: (n - 1)!
    for order in range(1, 9):
        total = sum(Fraction(factorial(order), symmetry(tree) * density(tree)) for tree in trees(order))
        assert total == factorial(order - 1)


@ALL
def test_shape(method):
    assert len(method.a) == len(method.b) == len(method.c) == method.stages
    assert all(len(row) <= index for index, row in enumerate(method.a))
    assert METHODS[method.name] is method


@ALL
def test_row_sums_are_the_nodes(method):
    for row, c in zip(method.a, method.c, strict=True):
        assert np.sum(row) == pytest.approx(c, abs=4e-15)
    assert np.sum(method.b) == pytest.approx(1.0, abs=2e-15)


@ALL
def test_every_order_condition_holds(method):
    a, b = matrix(method), np.array(method.b)
    for order in range(1, method.order + 1):
        for tree in trees(order):
            assert b @ weights(tree, a) == pytest.approx(1.0 / density(tree), abs=5e-14)


@ALL
def test_the_order_is_not_higher_than_stated(method):
    a, b = matrix(method), np.array(method.b)
    assert max(abs(b @ weights(tree, a) - 1.0 / density(tree)) for tree in trees(method.order + 1)) > 1e-7


# The orders up to which the fine and the coarse estimate vanish, and the steps of a period in `test_convergence`.
KNOWN = {
    "euler": (1, None, 100_000),
    "midpoint": (1, 0, 4000),
    "rk4": (2, 0, 800),
    "verner7": (5, 3, 60),
    "tsitouras8": (6, 4, 30),
    "dop853": (5, 3, 40),
}


@ALL
def test_estimates_vanish_up_to_their_order(method):
    fine, coarse, _ = KNOWN[method.name]
    for row, order in ((method.estimate.fine, fine), (method.estimate.coarse, coarse)):
        if order is None:
            assert not row
            continue
        d = np.array(row + (0.0,) * (method.stages - len(row)))
        for low in range(1, order + 1):
            assert max(abs(d @ weights(tree, matrix(method))) for tree in trees(low)) < 1e-14
        assert max(abs(d @ weights(tree, matrix(method))) for tree in trees(order + 1)) > 1e-5


def orbit(method):
    """Kepler's ellipse relative to a point that moves as (sin t, t²): nonlinear rates that depend on time.

    y = [x, x', ∫ sin t dt], x = ellipse + s(t) with s = (sin t, t²).
    """
    t, y, inputs = ca.SX.sym("t"), ca.SX.sym("y", 5), ca.SX.sym("e", 1)
    r = y[:2] - ca.vertcat(ca.sin(t), t * t)
    pull = -r / ca.sqrt(ca.dot(r, r)) ** 3 + ca.vertcat(-ca.sin(t), 2.0)
    rates = ca.Function("rates", [t, y, inputs], [ca.vertcat(y[2:4], pull, ca.sin(t))])
    return compile_kernel(rates, None, {}, method)


ECCENTRICITY = 0.3


def error(kernel, steps):
    """The error after one period of the ellipse."""
    e, turn = ECCENTRICITY, 2.0 * np.pi
    speed = np.sqrt((1.0 + e) / (1.0 - e))
    y, inputs = np.array([1.0 - e, 0.0, 1.0, speed, 0.0]), np.zeros(1)
    assert kernel.advance(y.ctypes.data, inputs.ctypes.data, 0, turn / steps, steps) == 1
    expected = [1.0 - e, turn**2, 1.0, speed + 2.0 * turn, 0.0]
    return np.max(np.abs(y - expected))


@ALL
def test_convergence(method):
    kernel, (_, _, steps) = orbit(method), KNOWN[method.name]
    coarse, fine = error(kernel, steps), error(kernel, 2 * steps)
    assert 2.0 ** (method.order - 0.7) < coarse / fine < 2.0 ** (method.order + 0.7)


@ALL
def test_rates_of_time_alone_are_integrated_exactly_up_to_the_order(method):
    """y' = t^(p-1) must give 1/p after one step, which checks the nodes c."""
    t, y, inputs = ca.SX.sym("t"), ca.SX.sym("y", method.order), ca.SX.sym("e", 1)
    powers = [ca.SX(1.0)]
    for _ in range(1, method.order):
        powers.append(powers[-1] * t)
    kernel = compile_kernel(ca.Function("rates", [t, y, inputs], [ca.vertcat(*powers)]), None, {}, method)
    state = np.zeros(method.order)
    assert kernel.advance(state.ctypes.data, np.zeros(1).ctypes.data, 0, 1.0, 1)
    assert state == pytest.approx(1.0 / np.arange(1, method.order + 1), abs=1e-14)
    assert kernel.advance(state.ctypes.data, np.zeros(1).ctypes.data, 1, 1.0, 2)  # from t = 1 to t = 3
    expected = 3.0 ** np.arange(1, method.order + 1) / np.arange(1, method.order + 1)
    assert state == pytest.approx(expected, rel=1e-14)
