"""Linear complementarity problems by Lemke's method, and the small linear systems that contacts need.

The method is that of Cottle, Pang & Stone, *The Linear Complementarity Problem*. Linear systems are solved by
elimination with complete pivoting, in elementwise arithmetic.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mbd_sim.base.geometry.pose import Array

SINGULAR = 1e-11  # of the largest entry, below which a pivot counts as zero


def solve(matrix: Array, right: Array) -> Array:
    """A solution x (n,) of a square system; unknowns of dependent columns are zero.

    Equations that depend on others are not checked.
    """
    a, columns, found = _triangular(matrix, right[:, None])
    x: Array = np.zeros(len(right))
    x[columns[:found]] = _back_substituted(a[:found, :found], a[:found, -1])
    return x


def null_space(matrix: Array) -> Array:
    """Independent solutions (n, k) of A x = 0."""
    n = matrix.shape[1]
    a, columns, found = _triangular(matrix, np.zeros((len(matrix), 0)))
    basis: Array = np.zeros((n, n - found))
    for index in range(n - found):
        basis[columns[:found], index] = -_back_substituted(a[:found, :found], a[:found, found + index])
        basis[columns[found + index], index] = 1.0
    return basis


def least_solution(matrix: Array, right: Array, weights: Array) -> Array:
    """The solution x (n,) of a square system; of several that with the least Σ w x²."""
    return least(solve(matrix, right), null_space(matrix), weights)


def least(x: Array, free: Array, weights: Array) -> Array:
    """The sum (n,) of x and of a combination of the columns of `free` (n, k) for which Σ w x² is least."""
    if not free.shape[1]:
        return x
    weighted = (free * weights[:, None]).T
    return x - product(free, solve(product(weighted, free), product(weighted, x)))


def product(matrix: Array, other: Array) -> Array:
    """The product with a matrix or a vector, summed in order."""
    total = np.zeros((len(matrix), *other.shape[1:]))
    for column in range(len(other)):
        total += np.multiply.outer(matrix[:, column], other[column])
    return total


def best_conditioned(matrix: Array, rows: Sequence[int]) -> list[int]:
    """Those of some rows of a symmetric positive semidefinite matrix that are independent, by their pivots."""
    if len(rows) < 2:
        return [row for row in rows if matrix[row, row] > 0.0]
    return [rows[pivot] for pivot in pivots(unit_diagonal(matrix[rows][:, rows])[0])]


def unit_diagonal(matrix: Array) -> tuple[Array, Array]:
    """A symmetric positive semidefinite matrix scaled to a diagonal of ones, and the factors (n,) of its rows."""
    diagonal = np.diag(matrix)
    factors = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    return matrix * factors[:, None] * factors, factors


def pivots(matrix: Array) -> list[int]:
    """Columns of a square matrix that are independent, as many as there are, in the order of their pivots."""
    _, columns, found = _triangular(matrix, np.zeros((len(matrix), 0)))
    return columns[:found]


def _triangular(matrix: Array, right: Array) -> tuple[Array, list[int], int]:
    """Reduce [matrix (m, n) | right (m, k)] to triangular form: it, the order of the n columns, and the rank."""
    m, n = matrix.shape
    a = np.concatenate([matrix, right], axis=1)
    columns = list(range(n))
    largest = float(np.abs(matrix).max(initial=0.0))
    done = 0
    while done < min(m, n):
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
    return a, columns, done


def _back_substituted(upper: Array, right: Array) -> Array:
    """The solution of a triangular system."""
    x = right.copy()
    for index in range(len(x) - 1, -1, -1):
        x[index] /= upper[index, index]
        x[:index] -= upper[:index, index] * x[index]
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


ZERO_ENTRY = 1e-12  # relative size below which an entry of the tableau counts as zero


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
    rows = (column > ZERO_ENTRY * max(1.0, float(np.abs(column).max()))).nonzero()[0]
    if not len(rows):
        return None
    ratios = tableau[rows, -1] / column[rows]
    least = float(ratios.min())
    tied = rows[ratios <= least + ZERO_ENTRY * max(1.0, abs(least))]
    artificial = [int(row) for row in tied if basis[row] == 2 * n]
    if artificial:
        return artificial[0]
    for index in range(n):
        if len(tied) == 1:
            break
        values = tableau[tied, index] / column[tied]
        tied = tied[values <= float(np.min(values)) + ZERO_ENTRY]
    return int(tied[0])


def _solution(tableau: Array, basis: list[int], n: int) -> Array:
    z: Array = np.zeros(n)
    for row, variable in enumerate(basis):
        if n <= variable < 2 * n:
            z[variable - n] = max(tableau[row, -1], 0.0)
    return z
