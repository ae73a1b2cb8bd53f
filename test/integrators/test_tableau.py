"""The coefficients of every method: consistency, all order conditions, and the order that a compiled run shows."""

from __future__ import annotations

from fractions import Fraction
from functools import cache
from itertools import combinations_with_replacement, groupby
from math import factorial, prod

import casadi as ca
import numpy as np
import pytest

from mbd_sim.compiler.kernel import compile_kernel
from mbd_sim.integrators.tableau import EXPLICIT as METHODS

ALL = pytest.mark.parametrize("method", METHODS.values(), ids=METHODS)


@cache
def trees(order):
    """The rooted trees of this many nodes, each a sorted tuple of the trees at its root (Hairer et al., II.2)."""
    if order == 1:
        return [()]

    def forests(nodes, largest):
        if nodes == 0:
            yield ()
        for size in range(min(nodes, largest), 0, -1):
            for count in range(1, nodes // size + 1):
                for chosen in combinations_with_replacement(trees(size), count):
                    for rest in forests(nodes - size * count, size - 1):
                        yield chosen + rest

    return list(forests(order - 1, order - 1))


def nodes(tree):
    return 1 + sum(map(nodes, tree))


def density(tree):
    """γ: the exact solution has Σ b Φ = 1/γ."""
    return nodes(tree) * prod(map(density, tree))


def weights(tree, a):
    """Φ (stages,): the elementary weight of a tree."""
    found = np.ones(len(a))
    for branch in tree:
        found = found * (a @ weights(branch, a))
    return found


def matrix(method):
    a = np.zeros((method.stages, method.stages))
    for row, values in enumerate(method.a):
        a[row, : len(values)] = values
    return a


def symmetry(tree):
    """The number of ways in which a tree maps onto itself."""
    return prod(
        symmetry(branch) ** len(alike) * factorial(len(alike))
        for branch, alike in ((branch, list(group)) for branch, group in groupby(tree))
    )


def test_there_are_as_many_trees_as_the_literature_says():
    assert [len(trees(order)) for order in range(1, 9)] == [1, 1, 2, 4, 9, 20, 48, 115]
    # Σ n!/(σ γ) over the trees of n nodes counts the labelled ones: (n - 1)!
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


def orbit(method):
    """Kepler's ellipse seen from a point that moves as (sin t, t²): nonlinear rates that depend on time.

    y = [x, x', ∫ sin t dt], x = ellipse + s(t) with s = (sin t, t²).
    """
    t, y, inputs = ca.SX.sym("t"), ca.SX.sym("y", 5), ca.SX.sym("e", 1)
    r = y[:2] - ca.vertcat(ca.sin(t), t * t)
    pull = -r / ca.sqrt(ca.dot(r, r)) ** 3 + ca.vertcat(-ca.sin(t), 2.0)
    rates = ca.Function("rates", [t, y, inputs], [ca.vertcat(y[2:4], pull, ca.sin(t))])
    return compile_kernel(rates, None, {}, method)


ECCENTRICITY = 0.3


def error(kernel, steps):
    """The error after one turn, when the ellipse is where it was."""
    e, turn = ECCENTRICITY, 2.0 * np.pi
    speed = np.sqrt((1.0 + e) / (1.0 - e))
    y, inputs = np.array([1.0 - e, 0.0, 1.0, speed, 0.0]), np.zeros(1)
    assert kernel.advance(y.ctypes.data, inputs.ctypes.data, 0, turn / steps, steps) == 1
    expected = [1.0 - e, turn**2, 1.0, speed + 2.0 * turn, 0.0]
    return np.max(np.abs(y - expected))


@pytest.mark.parametrize(
    ("name", "steps"), [("euler", 100_000), ("midpoint", 4000), ("rk4", 800), ("dop853", 40)], ids=str
)
def test_convergence(name, steps):
    method = METHODS[name]
    kernel = orbit(method)
    coarse, fine = error(kernel, steps), error(kernel, 2 * steps)
    assert 2.0 ** (method.order - 0.7) < coarse / fine < 2.0 ** (method.order + 0.7)


@ALL
def test_rates_of_time_alone_are_integrated_exactly_up_to_the_order(method):
    """y' = t^(p-1) must give 1/p after one step: this is what the nodes c are for."""
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
