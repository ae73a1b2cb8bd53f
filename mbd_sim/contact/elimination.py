"""Small linear systems by elimination with complete pivoting, in elementwise arithmetic."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mbd_sim.geometry.pose import Array

SINGULAR = 1e-11  # of the largest entry, below which a pivot counts as zero


def solve(matrix: Array, right: Array) -> Array:
    """A solution x (n,) of a square system; unknowns of dependent columns are zero.

    Equations that depend on others are not checked.
    """
    n = len(right)
    a = np.empty((n, n + 1))
    a[:, :n], a[:, n] = matrix, right
    columns = list(range(n))
    largest = float(np.abs(a[:, :n]).max()) if n else 0.0
    rank = 0
    while rank < n:
        rest = np.abs(a[rank:, rank:n])
        i, j = divmod(int(rest.argmax()), n - rank)
        if not rest[i, j] > SINGULAR * largest:
            break
        if i:
            a[[rank, rank + i]] = a[[rank + i, rank]]
        if j:
            a[:, [rank, rank + j]] = a[:, [rank + j, rank]]
            columns[rank], columns[rank + j] = columns[rank + j], columns[rank]
        factors = a[rank + 1 :, rank] / a[rank, rank]
        a[rank + 1 :, rank + 1 :] -= factors[:, None] * a[rank, rank + 1 :]
        rank += 1
    x: Array = np.zeros(n)
    for index in range(rank - 1, -1, -1):
        value = a[index, n] / a[index, index]
        a[:index, n] -= a[:index, index] * value
        x[columns[index]] = value
    return x


def independent(matrix: Array, order: Sequence[int]) -> list[int]:
    """Those rows of a symmetric positive semidefinite matrix (n, n), taken in an order, that are independent."""
    a = matrix.astype(float).copy()
    scale = np.diag(matrix).astype(float).copy()
    chosen: list[int] = []
    for row in order:
        pivot = a[row, row]
        if pivot <= SINGULAR * max(scale[row], 0.0) or pivot <= 0.0:
            continue
        chosen.append(row)
        a = a - np.multiply.outer(a[:, row] / pivot, a[row])
    return chosen
