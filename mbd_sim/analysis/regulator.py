"""The linear-quadratic regulator: gains that hold a linearized mechanism in its place."""

from __future__ import annotations

import numpy as np

from mbd_sim.geometry.pose import Array


def lqr(a: Array, b: Array, state_cost: Array, effort_cost: Array) -> Array:
    """The gain K (m, n) of e = -K x that makes ∫ xᵀ Q x + eᵀ R e dt least for x' = A x + B e.

    The Riccati equation is solved by the stable eigenvectors of its Hamiltonian matrix (Potter 1966; Åström & Murray,
    sec. 7.5); states may differ much in size, but A must have no modes that are nearly the same.

    :param state_cost: Q (n, n), symmetric and positive semidefinite.
    :param effort_cost: R (m, m), symmetric and positive definite.
    :raises ValueError: B does not reach an unstable motion, or Q does not see one that does not die away.
    """
    weighted = np.linalg.solve(effort_cost, b.T)
    hamiltonian = np.block([[a, -b @ weighted], [-state_cost, -a.T]])
    values, vectors = np.linalg.eig(hamiltonian)
    stable = vectors[:, values.real < -1e-9 * np.max(np.abs(values), initial=1.0)]
    n = len(a)
    if stable.shape[1] != n or np.linalg.matrix_rank(stable[:n]) < n:
        raise ValueError(
            "there is no regulator: some motion cannot be reached by these efforts, or has no cost and does not die "
            "away. Actuate another joint, or give every coordinate a cost."
        )
    solution = np.real(stable[n:] @ np.linalg.inv(stable[:n]))
    return np.asarray(weighted @ solution)
