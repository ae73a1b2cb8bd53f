"""Small linear systems and linear complementarity problems: see `compiled.instant.linear`."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.simulation.contact.compiled.library import called


def solve(matrix: Array, right: Array) -> Array:
    """A solution x (n,) of a square system; unknowns of dependent columns are zero.

    Equations that depend on others are not checked.
    """
    x = np.empty(len(right))
    called("solve", len(right), matrix, right, x)
    return x


def block(matrix: Array, rows: Sequence[int]) -> Array:
    """Some rows and columns (k, k) of a matrix, in an order."""
    own = list(rows)
    return np.asarray(matrix[np.ix_(own, own)])


def null_space(matrix: Array) -> Array:
    """Independent solutions (n, k) of A x = 0."""
    m, n = matrix.shape
    basis = np.empty((n, n))
    count = called("null_space", m, n, matrix, basis)
    return basis[:count].T


def least_solution(matrix: Array, right: Array, weights: Array) -> Array:
    """The solution x (n,) of a square system; of several that with the least Σ w x²."""
    x = np.empty(len(right))
    called("least_solution", len(right), matrix, right, weights, x)
    return x


def least(x: Array, free: Array, weights: Array) -> Array:
    """The sum (n,) of x and of a combination of the columns of `free` (n, k) for which Σ w x² is least."""
    found = x.copy()
    called("least", *free.shape, free.T, weights, found)
    return found


def product(matrix: Array, other: Array) -> Array:
    """The product with a matrix or a vector, summed in order."""
    total = np.empty((len(matrix), *other.shape[1:]))
    called("product", *matrix.shape, math.prod(other.shape[1:]), matrix, other, total)
    return total


def best_conditioned(matrix: Array, rows: Sequence[int]) -> list[int]:
    """Those of some rows of a symmetric positive semidefinite matrix that are independent, by their pivots."""
    return _chosen("best_conditioned", matrix, rows)


def unit_diagonal(matrix: Array) -> tuple[Array, Array]:
    """A symmetric positive semidefinite matrix scaled to a diagonal of ones, and the factors (n,) of its rows."""
    scaled, factors = np.array(matrix, order="C"), np.empty(len(matrix))
    called("unit_diagonal", len(matrix), scaled, factors)
    return scaled, factors


def pivots(matrix: Array) -> list[int]:
    """Columns of a square matrix that are independent, as many as there are, in the order of their pivots."""
    columns = np.empty(len(matrix), dtype=np.int64)
    count = called("pivots", len(matrix), matrix, columns)
    found: list[int] = columns[:count].tolist()
    return found


def independent(matrix: Array, order: Sequence[int]) -> list[int]:
    """Those rows of a symmetric positive semidefinite matrix (n, n), taken in an order, that are independent."""
    return _chosen("independent", matrix, order)


def _chosen(name: str, matrix: Array, rows: Sequence[int]) -> list[int]:
    found, size = np.empty(len(rows), dtype=np.int64), len(rows)
    count = called(name, size, block(matrix, rows), size, np.arange(size), found)
    return [rows[position] for position in found[:count].tolist()]


def lemke(matrix: Array, right: Array) -> Array | None:
    """z ≥ 0 (n,) with w = M z + q ≥ 0 and w z = 0, or None where the method ends on a ray."""
    z = np.empty(len(right))
    return z if called("lemke", len(right), matrix, right, z) else None
