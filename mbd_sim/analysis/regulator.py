"""The linear-quadratic regulator: gains that stabilize a linearized mechanism."""

from __future__ import annotations

import numpy as np

from mbd_sim.geometry.pose import Array


def lqr(a: Array, b: Array, state_cost: Array, effort_cost: Array) -> Array:
    """The gain K (m, n) of e = -K x that minimizes ∫ xᵀ Q x + eᵀ R e dt for x' = A x + B e.

    The Riccati equation is solved with the stable eigenvectors of its Hamiltonian matrix (Potter 1966; Åström & Murray,
    sec. 7.5). The states may differ greatly in scale, but A must not have nearly equal modes.

    :param a: A (n, n).
    :param b: B (n, m).
    :param state_cost: Q (n, n), symmetric and positive semidefinite.
    :param effort_cost: R (m, m), symmetric and positive definite.
    :raises ValueError: an unstable mode is not controllable through B, or a mode that does not decay has no cost in Q.
    """
    weighted = np.linalg.solve(effort_cost, b.T)
    hamiltonian = np.block([[a, -b @ weighted], [-state_cost, -a.T]])
    values, vectors = np.linalg.eig(hamiltonian)
    stable = vectors[:, values.real < -1e-9 * np.max(np.abs(values), initial=1.0)]
    n = len(a)
    if stable.shape[1] != n or np.linalg.matrix_rank(stable[:n]) < n:
        raise ValueError(
            "no regulator stabilizes this system: these efforts cannot control an unstable mode, or a mode that does "
            "not decay has no cost. Actuate another joint, or give every coordinate a cost."
        )
    solution = np.real(stable[n:] @ np.linalg.inv(stable[:n]))
    return np.asarray(weighted @ solution)
