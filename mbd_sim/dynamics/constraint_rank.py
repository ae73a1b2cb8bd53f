"""Ranks, null spaces and independent rows of constraint matrices."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mbd_sim.geometry.pose import Array

RANK = 1e-9  # singular values below this fraction of the largest count as zero
ZERO = 1e-9  # relative to the norm of all rows, below which a row counts as zero
ROUND_OFF = 1e-12  # the length up to which a single row counts as zero


def null_space(matrix: Array) -> Array:
    """An orthonormal basis (n, k) of the null space of a matrix (m, n)."""
    if not matrix.size:
        return np.eye(matrix.shape[1])
    if matrix.shape[0] > matrix.shape[1]:
        matrix = np.asarray(np.linalg.qr(matrix, mode="r"))  # the same null space with fewer rows
    _, values, axes = np.linalg.svd(matrix)
    rank = int(np.sum(values > RANK * max(values.max(initial=0.0), 1e-300)))
    return np.ascontiguousarray(axes[rank:].T)


def independent_rows(gradients: Sequence[Array]) -> tuple[list[int], list[int]]:
    """Rows that span all rows of G in as many configurations as possible, and the rank of G in each configuration.

    Rows are chosen one by one; each is judged by the configuration in which it adds least.
    """
    unit = [unit_rows(gradient) for gradient in gradients]
    ranks = [rank_of(gradient) for gradient in unit]
    highest = max(ranks)
    regular = [gradient for gradient, rank in zip(unit, ranks, strict=True) if rank == highest]
    return _greedy_rows(regular, highest), ranks


def nonzero_rows(gradients: Sequence[Array]) -> list[int]:
    """The rows that are not zero in all configurations."""
    sizes = [np.linalg.norm(gradient, axis=1) for gradient in gradients]
    return [int(row) for row in np.flatnonzero(np.any([size > ZERO * np.linalg.norm(size) for size in sizes], axis=0))]


def dependent_rows(gradients: Sequence[Array]) -> NDArray[np.bool_]:
    """Which rows take part in a linear dependence that exists in all configurations of the highest rank."""
    unit = [unit_rows(gradient) for gradient in gradients]
    most = max((rank_of(gradient) for gradient in unit), default=0)
    found = np.zeros(len(gradients[0]) if gradients else 0, dtype=bool)
    for gradient in unit:
        if rank_of(gradient) == most < len(gradient):
            found |= np.any(np.abs(null_space(gradient.T)) > RANK, axis=1)
    return found


def rank_of(matrix: Array) -> int:
    """The rank of a matrix with rows of order one, up to the round-off of the assembly."""
    return int(np.linalg.matrix_rank(matrix, tol=RANK)) if matrix.size else 0


def row_sizes(gradient: Array) -> Array:
    """The lengths (…, m) of the rows (…, m, nv), infinite for those that are zero up to round-off."""
    sizes: Array = np.linalg.norm(gradient, axis=-1)
    return np.where(sizes > ROUND_OFF, sizes, np.inf)


def unit_rows(gradient: Array) -> Array:
    """The rows (…, m, nv) with a length of 1, or 0."""
    sizes = row_sizes(gradient)[..., None]
    unit: Array = np.divide(gradient, sizes, out=np.zeros_like(gradient), where=sizes < np.inf)
    return unit


def _greedy_rows(gradients: Sequence[Array], rank: int) -> list[int]:
    """Choose rows one by one: the first that adds nearly as much as the best. Chosen rows are projected out."""
    remainders = [gradient.copy() for gradient in gradients]
    chosen: list[int] = []
    for _ in range(rank):
        gain = np.min([np.linalg.norm(matrix, axis=1) for matrix in remainders], axis=0)
        gain[chosen] = 0.0
        best = int(np.argmax(gain > 0.99 * gain.max()))
        chosen.append(best)
        for matrix in remainders:
            size = np.linalg.norm(matrix[best])
            if size > 0.0:
                direction = matrix[best] / size
                matrix -= np.outer(matrix @ direction, direction)
    return sorted(chosen)
