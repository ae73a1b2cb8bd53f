"""Gains of the regulator against scipy's Riccati solver."""

import numpy as np
import pytest
from scipy.linalg import solve_continuous_are

from mbd_sim import Simulation
from mbd_sim.analysis.linear.linearization import linearize
from mbd_sim.analysis.linear.state_space import lqr


def test_gains_are_those_of_scipy():
    rng = np.random.default_rng(3)
    for _ in range(20):
        n, m = rng.integers(2, 7), rng.integers(1, 3)
        a, b = rng.normal(size=(n, n)), rng.normal(size=(n, m))
        q, r = np.diag(rng.uniform(0.1, 10, n)), np.diag(rng.uniform(0.1, 10, m))
        assert lqr(a, b, q, r) == pytest.approx(np.linalg.solve(r, b.T @ solve_continuous_are(a, b, q, r)), rel=1e-7)


def test_the_upright_cart_pendulum_is_held():
    sim = Simulation.from_file("cart_pendulum")
    upright = linearize(sim.model.equations, np.array([0.0, np.pi]), np.zeros(2), np.zeros(2))
    assert np.max(np.linalg.eigvals(upright.a).real) > 1.0
    gain = lqr(upright.a, upright.b[:, :1], np.diag([1.0, 1.0, 0.1, 0.1]), np.array([[0.1]]))
    assert np.max(np.linalg.eigvals(upright.a - upright.b[:, :1] @ gain).real) < -0.5


def test_what_cannot_be_stabilized_is_refused():
    with pytest.raises(ValueError, match="no regulator stabilizes"):
        lqr(np.diag([1.0, -1.0]), np.array([[0.0], [1.0]]), np.eye(2), np.eye(1))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"a": np.eye(3)}, r"b must have the shape \(3, 1\), not \(2, 1\)"),
        ({"a": np.ones((2, 3))}, r"a must have the shape \(2, 2\)"),
        ({"b": [0, 1]}, r"b must be a matrix \(2, m\) .*, not an array of shape \(2,\)\. Give .* as b\[:, :1\], or"),
        ({"b": 1.0}, r"b must be a matrix \(2, m\) .*, not an array of shape \(\)"),
        ({"b": [[0.0], [np.nan]]}, "b contains a value that is not finite"),
        ({"state_cost": np.eye(3)}, r"state_cost must have the shape \(2, 2\), not \(3, 3\)"),
        ({"state_cost": [[1.0, 1.0], [0.0, 1.0]]}, "state_cost must be symmetric"),
        ({"state_cost": -np.eye(2)}, "state_cost must be positive semidefinite; its least eigenvalue is -1"),
        ({"effort_cost": 1.0}, r"effort_cost must have the shape \(1, 1\), not \(\)"),
        ({"effort_cost": [[0.0]]}, "effort_cost must be positive definite"),
    ],
)
def test_matrices_that_do_not_fit_are_refused(changes, words):
    given = {"a": [[0, 1], [1, 0]], "b": [[0], [1]], "state_cost": np.eye(2), "effort_cost": [[1]]}
    assert lqr(**given).shape == (1, 2)
    with pytest.raises(ValueError, match=words):
        lqr(**given | changes)
