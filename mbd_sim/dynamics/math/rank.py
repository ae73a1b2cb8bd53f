"""Ranks, null spaces and independent rows of constraint matrices.

Matrices are in natural units, see `mbd_sim.dynamics.constraints.functions`: then what is round-off does not depend on
the other rows, which may all be round-off.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base import linear_algebra as la
from mbd_sim.base.geometry.pose import Array

RANK = 1e-9  # rows and singular values in natural units up to this size count as zero


def null_space(matrix: Array, rank: int | None = None) -> Array:
    """An orthonormal basis (n, k) of the null space of a matrix (m, n).

    :param rank: that of the matrix, which is then in any units.
    """
    if not matrix.size:
        return np.eye(matrix.shape[1])
    return la.null_space(matrix, RANK, rank)


def least_solution(matrix: Array, right: Array) -> Array:
    """The x (n,) or (n, k) of least norm among those for which matrix @ x is nearest to `right` (m,) or (m, k)."""
    return la.least_solution(matrix, right, RANK)


def fast_least_solution(matrix: Array, right: Array) -> Array:
    """As `least_solution`, by LAPACK: several times as fast, with bits that depend on the processor, for studies."""
    largest = float(np.linalg.norm(matrix, 2)) if matrix.size else 0.0
    if largest <= RANK:
        return np.zeros((matrix.shape[1], *right.shape[1:]))
    return np.asarray(np.linalg.lstsq(matrix, right, rcond=RANK / largest)[0], dtype=float)


def least_solutions(matrices: Array, rights: Array) -> Array:
    """The solutions (k, n) of many matrices (k, m, n) and right sides (k, m), each with the bits that it has alone."""
    return la.least_solutions(matrices, rights[:, :, None], np.full(len(matrices), RANK))[:, :, 0]


def independent_rows(gradients: Sequence[Array]) -> tuple[list[int], list[int]]:
    """Rows that span all rows of G in as many configurations as possible, and the rank of G in each configuration.

    Rows are chosen one by one; each is judged by the configuration in which it adds least.
    """
    ranks = [rank_of(gradient) for gradient in gradients]
    highest = max(ranks)
    regular = [unit_rows(gradient) for gradient, rank in zip(gradients, ranks, strict=True) if rank == highest]
    return _greedy_rows(regular, highest), ranks


def nonzero_rows(gradients: Sequence[Array]) -> list[int]:
    """The rows that are not zero in all configurations."""
    return [int(row) for row in np.flatnonzero(~np.all([row_is_zero(gradient) for gradient in gradients], axis=0))]


def dependent_rows(gradients: Sequence[Array]) -> NDArray[np.bool_]:
    """Which rows take part in a linear dependence that exists in all configurations of the highest rank."""
    most = max((rank_of(gradient) for gradient in gradients), default=0)
    found = np.zeros(len(gradients[0]) if gradients else 0, dtype=bool)
    for gradient in gradients:
        if rank_of(gradient) == most < len(gradient):
            found |= np.any(np.abs(null_space(unit_rows(gradient).T, most)) > RANK, axis=1)
    return found


def rank_of(matrix: Array) -> int:
    """The rank of a matrix."""
    return int(la.ranks(matrix[None], RANK)[0])


def row_is_zero(matrix: Array) -> NDArray[np.bool_]:
    """Which rows (…, m) of a matrix (…, m, nv) are zero."""
    return np.asarray(la.norms(matrix) <= RANK)


def unit_rows(matrix: Array) -> Array:
    """The rows (…, m, nv) with a length of 1, or 0."""
    sizes = la.norms(matrix)[..., None]
    unit: Array = np.divide(matrix, sizes, out=np.zeros_like(matrix), where=sizes > RANK)
    return unit


def _greedy_rows(gradients: Sequence[Array], rank: int) -> list[int]:
    """Choose rows one by one: the first that adds nearly as much as the best. Chosen rows are projected out."""
    remainders = [gradient.copy() for gradient in gradients]
    chosen: list[int] = []
    for _ in range(rank):
        gain = np.min([la.norms(matrix) for matrix in remainders], axis=0)
        gain[chosen] = 0.0
        best = int(np.argmax(gain > 0.99 * gain.max()))
        chosen.append(best)
        for matrix in remainders:
            size = la.norm(matrix[best])
            if size > 0.0:
                direction = matrix[best] / size
                matrix -= np.outer(la.product(matrix, direction), direction)
    return sorted(chosen)
