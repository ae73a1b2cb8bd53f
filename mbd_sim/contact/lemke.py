"""Linear complementarity problems by Lemke's method (Cottle, Pang & Stone, *The Linear Complementarity Problem*)."""

from __future__ import annotations

import numpy as np

from mbd_sim.geometry.pose import Array

TINY = 1e-12  # relative size below which an entry of the tableau counts as zero


def lemke(matrix: Array, right: Array) -> Array | None:
    """z ≥ 0 (n,) with w = M z + q ≥ 0 and w z = 0, or None where the method ends on a ray.

    Ties are resolved by the lexicographic rule, so that the method ends.
    """
    n = len(right)
    if not n or (right >= 0.0).all():
        return np.zeros(n)
    # Columns: w (n), z (n), z0, q. Rows: I w - M z - d z0 = q.
    tableau = np.zeros((n, 2 * n + 2))
    tableau[range(n), range(n)] = 1.0
    tableau[:, n : 2 * n], tableau[:, 2 * n], tableau[:, -1] = -matrix, -1.0, right
    basis = list(range(n))
    entering, row = 2 * n, _first_row(right)
    for _ in range(60 * (n + 1)):
        leaving = basis[row]
        _pivot(tableau, row, entering)
        basis[row] = entering
        if leaving == 2 * n:
            return _solution(tableau, basis, n)
        entering = leaving + n if leaving < n else leaving - n
        found = _leaving_row(tableau, entering, basis, n)
        if found is None:
            return None
        row = found
    return None


def _first_row(right: Array) -> int:
    """The row of the smallest q; of several the last, which the lexicographic rule prefers."""
    return int((right == right.min()).nonzero()[0][-1])


def _pivot(tableau: Array, row: int, column: int) -> None:
    tableau[row] /= tableau[row, column]
    factors = tableau[:, column].copy()
    factors[row] = 0.0
    tableau -= np.multiply.outer(factors, tableau[row])
    tableau[:, column] = 0.0
    tableau[row, column] = 1.0


def _leaving_row(tableau: Array, entering: int, basis: list[int], n: int) -> int | None:
    """The row with the lexicographically least ratio; that of z0 where it is among the least."""
    column = tableau[:, entering]
    rows = (column > TINY * max(1.0, float(np.abs(column).max()))).nonzero()[0]
    if not len(rows):
        return None
    ratios = tableau[rows, -1] / column[rows]
    least = float(ratios.min())
    tied = rows[ratios <= least + TINY * max(1.0, abs(least))]
    artificial = [int(row) for row in tied if basis[row] == 2 * n]
    if artificial:
        return artificial[0]
    for index in range(n):
        if len(tied) == 1:
            break
        values = tableau[tied, index] / column[tied]
        tied = tied[values <= float(np.min(values)) + TINY]
    return int(tied[0])


def _solution(tableau: Array, basis: list[int], n: int) -> Array:
    z: Array = np.zeros(n)
    for row, variable in enumerate(basis):
        if n <= variable < 2 * n:
            z[variable - n] = max(tableau[row, -1], 0.0)
    return z
