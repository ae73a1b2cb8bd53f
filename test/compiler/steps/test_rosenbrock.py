"""The reduced linear systems of Rosenbrock methods against the full ones."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from mbd_sim.compiler.steps.rosenbrock import emit_linearized, unit_inverse
from mbd_sim.dynamics.equations import derive
from mbd_sim.dynamics.math.rank import null_space
from mbd_sim.files.load import load_mechanism

# Off their constraints the multipliers of rows that depend on each other are large and strongly curved.
OVERCONSTRAINED = ("bennett",)
SMALL = ("gas_engine", "stick_slip", "knife_edge", "bennett", "four_bar", "rotating_frame_mass", "spherical_top")


@pytest.mark.parametrize("name", SMALL)
def test_it_solves_the_full_system(name):
    """(I − g J) U = r for all of the state, with J by differences."""
    equations, random = derive(load_mechanism(name)), np.random.default_rng(7)
    nq, nv = equations.layout.nq, equations.layout.nv
    t, y, efforts, g = 0.3, equations.start_state.copy(), random.standard_normal(nv), 0.01
    change, size = 0.1 * random.standard_normal(nv), 1e-6
    if name in OVERCONSTRAINED:
        free = null_space(equations.constraints.gradient(t, y[:nq]))
        change, size = free @ free.T @ change, 3e-8
    y[nq : nq + nv] += change
    right = random.standard_normal(len(y))

    def rates(time, state):
        return np.array(equations.rates.call([time, state, efforts])[0]).ravel()

    jacobian = np.zeros((len(y), len(y)))
    for index in range(len(y)):
        shift = np.zeros(len(y))
        shift[index] = size * (1.0 + abs(y[index]))
        jacobian[:, index] = (rates(t, y + shift) - rates(t, y - shift)) / (2.0 * shift[index])
    linearized = emit_linearized(equations.rates, slice(nq, nq + nv), emit=lambda function, *_: function)
    memory, matrix, time_rates = linearized.at(t, y, efforts, g)
    x = np.linalg.solve(np.array(matrix), np.array(linearized.reduce(memory, right)).ravel())
    found = np.array(linearized.expand(memory, right, x)).ravel()
    expected = np.linalg.solve(np.eye(len(y)) - g * jacobian, right)
    assert found == pytest.approx(expected, rel=1e-5, abs=1e-6 * np.max(np.abs(expected)))
    by_difference = (rates(t + 1e-6, y) - rates(t - 1e-6, y)) / 2e-6
    assert np.array(time_rates).ravel() == pytest.approx(by_difference, rel=1e-5, abs=1e-4)
    assert linearized.timeless == (not np.any(np.array(time_rates)))


def test_the_inverse_of_the_identity_plus_something_skew():
    matrix = np.random.default_rng(1).standard_normal((4, 4))
    matrix -= matrix.T
    symbols = ca.SX.sym("m", 4, 4)
    found = ca.Function("inverse", [symbols], [unit_inverse(symbols)])(matrix)
    assert np.array(found) == pytest.approx(np.linalg.inv(np.eye(4) - matrix), abs=1e-13)
    assert unit_inverse(ca.SX(3, 3)).nnz() == 3
