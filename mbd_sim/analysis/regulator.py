"""The linear-quadratic regulator: gains that stabilize a linearized mechanism."""

from __future__ import annotations

import numpy as np

from mbd_sim.geometry.pose import Array
from mbd_sim.geometry.shaped_arrays import finite_matrix

ROUNDING = 1e-12  # relative error of the costs that is accepted


def lqr(a: Array, b: Array, state_cost: Array, effort_cost: Array) -> Array:
    """The gain K (m, n) of e = -K x that minimizes ∫ xᵀ Q x + eᵀ R e dt for x' = A x + B e.

    The Riccati equation is solved with the stable eigenvectors of its Hamiltonian matrix (Potter 1966; Åström & Murray,
    sec. 7.5). The states may differ greatly in scale, but A must not have nearly equal modes.

    :param a: A (n, n).
    :param b: B (n, m).
    :param state_cost: Q (n, n), symmetric and positive semidefinite.
    :param effort_cost: R (m, m), symmetric and positive definite.
    :raises ValueError: a matrix has another shape, a cost is not symmetric or not positive; or an unstable mode is not
        controllable through B, or a mode that does not decay has no cost in Q.
    """
    a = np.asarray(a, dtype=float)
    n = len(a) if a.ndim else 0
    a, b = finite_matrix(a, (n, n), "a"), _columns(b, n)
    state_cost = _cost(state_cost, n, "state_cost")
    effort_cost = _cost(effort_cost, b.shape[1], "effort_cost", positive=True)
    weighted = np.linalg.solve(effort_cost, b.T)
    hamiltonian = np.block([[a, -b @ weighted], [-state_cost, -a.T]])
    values, vectors = np.linalg.eig(hamiltonian)
    stable = vectors[:, values.real < -1e-9 * np.max(np.abs(values), initial=1.0)]
    if stable.shape[1] != n or np.linalg.matrix_rank(stable[:n]) < n:
        raise ValueError(
            "no regulator stabilizes this system: these efforts cannot control an unstable mode, or a mode that does "
            "not decay has no cost. Actuate another joint, or give every coordinate a cost."
        )
    solution = np.real(stable[n:] @ np.linalg.inv(stable[:n]))
    return np.asarray(weighted @ solution)


def _columns(given: Array, size: int) -> Array:
    """A matrix (size, m) with a column for each effort."""
    b = np.asarray(given, dtype=float)
    if b.ndim != 2:
        raise ValueError(
            f"b must be a matrix ({size}, m) with a column for each of m efforts, not an array of shape {b.shape}. "
            "Give the column of a single effort as b[:, :1], or as [[0], [1]]."
        )
    return finite_matrix(b, (size, b.shape[1]), "b")


def _cost(given: Array, size: int, name: str, *, positive: bool = False) -> Array:
    """A symmetric matrix (size, size) that is positive semidefinite, or with `positive` definite."""
    cost = finite_matrix(given, (size, size), name)
    largest = float(np.max(np.abs(cost), initial=0.0))
    if not np.allclose(cost, cost.T, rtol=0.0, atol=ROUNDING * largest):
        raise ValueError(f"{name} must be symmetric.")
    least = float(np.min(np.linalg.eigvalsh(cost), initial=np.inf))
    if positive and not least > 0.0:
        raise ValueError(f"{name} must be positive definite; its least eigenvalue is {least:.6g}.")
    if least < -ROUNDING * largest:
        raise ValueError(f"{name} must be positive semidefinite; its least eigenvalue is {least:.6g}.")
    return cost
