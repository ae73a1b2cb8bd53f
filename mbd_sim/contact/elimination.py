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
    a = np.column_stack([matrix, right]).astype(float)
    n = len(right)
    rows, columns = list(range(n)), list(range(n))
    largest = float(np.max(np.abs(a[:, :n]), initial=0.0))
    rank = 0
    while rank < n:
        rest = np.abs(a[np.ix_(rows[rank:], columns[rank:])])
        at = int(np.argmax(rest))
        i, j = rank + at // (n - rank), rank + at % (n - rank)
        if not a[rows[i], columns[j]] or abs(a[rows[i], columns[j]]) <= SINGULAR * largest:
            break
        rows[rank], rows[i] = rows[i], rows[rank]
        columns[rank], columns[j] = columns[j], columns[rank]
        pivot, column = rows[rank], columns[rank]
        for other in rows[rank + 1 :]:
            factor = a[other, column] / a[pivot, column]
            if factor:
                a[other] -= factor * a[pivot]
                a[other, column] = 0.0
        rank += 1
    x: Array = np.zeros(n)
    for index in range(rank - 1, -1, -1):
        row, column = rows[index], columns[index]
        value = a[row, n]
        for later in columns[index + 1 : rank]:
            value -= a[row, later] * x[later]
        x[column] = value / a[row, column]
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
