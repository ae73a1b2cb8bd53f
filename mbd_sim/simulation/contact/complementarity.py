"""Linear complementarity problems by Lemke's method, and the small linear systems that contacts need.

The method is that of Cottle, Pang & Stone, *The Linear Complementarity Problem*. Linear systems are solved by
elimination with complete pivoting, in elementwise arithmetic.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mbd_sim.base.geometry.pose import Array

REFINEMENTS = 3  # of solutions with the square of a matrix, to the round-off of the matrix itself
SINGULAR = 1e-11  # of the largest entry, below which a pivot counts as zero


def solve(matrix: Array, right: Array) -> Array:
    """A solution x (n,) of a square system; unknowns of dependent columns are zero.

    Equations that depend on others are not checked.
    """
    return _solved(matrix, right)[0]


def _solved(matrix: Array, right: Array) -> tuple[Array, int]:
    """See `solve`; and the rank."""
    n = len(right)
    a = np.empty((n, n + 1))
    a[:, :n], a[:, n] = matrix, right
    columns = _eliminate(a)
    x: Array = np.zeros(n)
    for index in range(len(columns) - 1, -1, -1):
        value = a[index, n] / a[index, index]
        a[:index, n] -= a[:index, index] * value
        x[columns[index]] = value
    return x, len(columns)


def least_squares(matrix: Array, right: Array, weights: Array) -> tuple[Array, Array]:
    """The solution x (n,) of dependent equations for which Σ w x² is least, and y with w x = matrixᵀ y."""
    scaled = (matrix / weights).T
    x, y, normal = np.zeros(len(weights)), np.zeros(len(right)), product(matrix, scaled)
    for _ in range(REFINEMENTS):
        y = y + solve(normal, right - product(matrix, x))
        x = product(scaled, y)
    return x, y


def least_solution(matrix: Array, right: Array, weights: Array) -> Array:
    """The solution x (n,) of a square system; of several that with the least Σ w x²."""
    x, found = _solved(matrix, right)
    if found == len(matrix):
        return x
    return least_squares(matrix, right, weights)[0]


def product(matrix: Array, other: Array) -> Array:
    """The product with a matrix or a vector, summed in order."""
    total = np.zeros((len(matrix), *other.shape[1:]))
    for column in range(len(other)):
        total += np.multiply.outer(matrix[:, column], other[column])
    return total


def rank(matrix: Array) -> int:
    """The number of independent rows of a square matrix."""
    n = len(matrix)
    a = np.zeros((n, n + 1))
    a[:, :n] = matrix
    return len(_eliminate(a))


def _eliminate(a: Array) -> list[int]:
    """Reduce [matrix | right] (n, n + 1) to triangular form in place; the columns of the pivots, in their order."""
    n = len(a)
    columns = list(range(n))
    largest = float(np.abs(a[:, :n]).max()) if n else 0.0
    done = 0
    while done < n:
        rest = np.abs(a[done:, done:n])
        i, j = divmod(int(rest.argmax()), n - done)
        if not rest[i, j] > SINGULAR * largest:
            break
        if i:
            a[[done, done + i]] = a[[done + i, done]]
        if j:
            a[:, [done, done + j]] = a[:, [done + j, done]]
            columns[done], columns[done + j] = columns[done + j], columns[done]
        factors = a[done + 1 :, done] / a[done, done]
        a[done + 1 :, done + 1 :] -= factors[:, None] * a[done, done + 1 :]
        done += 1
    return columns[:done]


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
