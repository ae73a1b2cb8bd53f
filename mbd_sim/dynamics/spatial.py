"""Six-dimensional vectors over CasADi scalars (Featherstone, *Rigid Body Dynamics Algorithms*, ch. 2).

A motion vector is [ω; v] and a force vector [moment; force], both at the origin and in the axes of a link's own
frame. Structural zeros are kept, so that planar mechanisms cost no more than planar equations.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from mbd_sim.mechanism.model import Array
from mbd_sim.mechanism.rotation import skew as numeric_skew


def constant(matrix: Array) -> ca.SX:
    """A numeric matrix with its zeros left out."""
    return ca.sparsify(ca.SX(ca.DM(matrix)))


def zeros(rows: int, columns: int = 1) -> ca.SX:
    """A matrix of structural zeros."""
    return ca.SX(rows, columns)


def skew(v: ca.SX) -> ca.SX:
    """The matrix (3, 3) with skew(v) @ w = v × w."""
    return ca.sparsify(
        ca.vertcat(
            ca.horzcat(ca.SX(1, 1), -v[2], v[1]),
            ca.horzcat(v[2], ca.SX(1, 1), -v[0]),
            ca.horzcat(-v[1], v[0], ca.SX(1, 1)),
        )
    )


def motion_transform(rotation: ca.SX, position: ca.SX) -> ca.SX:
    """X (6, 6) that takes motion vectors from the outer frame to an inner one placed in it (Featherstone 2.24).

    :param rotation: (3, 3), inner axes in the outer frame.
    :param position: (3,), inner origin in the outer frame.
    """
    turn = rotation.T
    return ca.sparsify(
        ca.vertcat(
            ca.horzcat(turn, zeros(3, 3)),
            ca.horzcat(-turn @ skew(position), turn),
        )
    )


def motion_cross(v: ca.SX) -> ca.SX:
    """The matrix (6, 6) with motion_cross(v) @ m = v × m for motion vectors (Featherstone 2.31)."""
    angular, linear = skew(v[:3]), skew(v[3:])
    return ca.sparsify(ca.vertcat(ca.horzcat(angular, zeros(3, 3)), ca.horzcat(linear, angular)))


def inertia_matrix(mass: float, center: Array, inertia: Array) -> Array:
    """Spatial inertia (6, 6) about the frame's origin (Featherstone 2.63).

    :param center: (3,) mass centre in m.
    :param inertia: (3, 3) about the mass centre in kg·m².
    """
    c = numeric_skew(center)
    return np.block([[inertia - mass * c @ c, mass * c], [-mass * c, mass * np.eye(3)]])


def symmetric(matrix: ca.SX) -> ca.SX:
    """The matrix with its lower triangle mirrored from the upper one, whose instructions then serve both."""
    upper = ca.triu(matrix)
    return ca.triu2symm(upper)


def solve_spd(matrix: ca.SX, right: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Solve a symmetric positive definite system by L D Lᵀ without pivoting, and return its pivots as well."""
    size = matrix.shape[0]
    if size == 1:
        return right / matrix, matrix
    if matrix.is_constant():
        dense = np.array(ca.DM(matrix))
        pivots = np.diag(np.linalg.cholesky(dense)) ** 2 if np.all(np.linalg.eigvalsh(dense) > 0) else np.zeros(size)
        return constant(np.linalg.pinv(dense)) @ right, ca.SX(ca.DM(pivots))
    pivots, transposed, order = ca.ldl(matrix)
    return ca.ldl_solve(right, pivots, transposed, order), pivots
