"""Linear algebra with the same bits on every processor.

NumPy's products and decompositions call BLAS and LAPACK, whose kernels add in an order of their own on each processor,
some with fused multiply-adds. Numbers from which a run starts, and those in its equations, are computed by the
functions here instead: they are made of additions, multiplications, divisions and square roots of arrays, component by
component, which every processor rounds alike.

Matrices are decomposed by Householder reflections with exchanges of columns (Golub & Van Loan, *Matrix Computations*,
5.4) and by Jacobi's rotations (8.5 and 8.6 there), of pairs of columns that do not touch each other at once. What is
done often with a single small matrix is also in `small_matrices.py`, with the same bits.
"""

from __future__ import annotations

import functools
import operator
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base import small_matrices as small

Array = NDArray[np.float64]

EPSILON = 2.0**-52
SMALL = 120  # entries of a matrix up to which Python's floats are quicker than calls of NumPy
DOUBTFUL = 1e3  # pivots that are less than this factor from a limit of singular values leave the rank to these
LARGE = 2**20  # terms of a product that are held at once
SWEEPS = 40  # of rotations at most; about seven are needed


def total(terms: Array, axis: int) -> Array:
    """The sum along an axis: halves are added until one is left."""
    axis %= terms.ndim
    if axis:
        terms = terms.transpose(axis, *range(axis), *range(axis + 1, terms.ndim))
    while (count := len(terms)) > 3:
        half = count // 2
        folded = terms[:half] + terms[count - half :]
        # An odd one is added to the first of them.
        if count % 2:
            folded[0] += terms[half]
        terms = folded
    if count == 3:
        return np.asarray(terms[0] + terms[2] + terms[1])
    if count == 2:
        return np.asarray(terms[0] + terms[1])
    return np.asarray(terms[0] if count else np.sum(terms, 0))


def added(numbers: Iterable[float]) -> float:
    """The sum, in the order of the numbers. That of Python is compensated from 3.12 on, so that versions differ."""
    return functools.reduce(operator.add, numbers, 0.0)


@overload
def product(left: Array, right: Array) -> Any: ...
@overload
def product(left: Any, right: Any) -> Any: ...
def product(left: Any, right: Any) -> Any:
    """`left @ right`, of arrays or of what defines that operator itself."""
    if not (isinstance(left, np.ndarray) and isinstance(right, np.ndarray)):
        return left @ right
    if left.ndim > 1 and right.ndim > 1:
        return products(left, right)
    _require_product(left, right)
    if right.ndim == 1:
        return total(left * right, -1)[()]
    return total(left[:, None] * right, -2)


def _require_product(left: Array, right: Array) -> None:
    if left.shape[-1] != right.shape[max(right.ndim - 2, 0)]:
        raise ValueError(f"matrices of shapes {left.shape} and {right.shape} have no product")


def products(left: Array, right: Array) -> Array:
    """Products of stacked matrices (…, m, n) and (…, n, k), each with the bits that it has alone."""
    _require_product(left, right)
    rows = max(1, LARGE // max(1, right.size))
    if left.shape[-2] > rows:
        parts = [left[..., first : first + rows, :] for first in range(0, left.shape[-2], rows)]
        return np.concatenate([products(part, right) for part in parts], axis=-2)
    return total(left[..., :, :, None] * right[..., None, :, :], -2)


def norm(vector: Array) -> float:
    """The Euclidean norm of all entries."""
    flat = np.ravel(np.asarray(vector, dtype=float))
    return float(np.sqrt(total(flat * flat, 0)))


def norms(vectors: Array) -> Array:
    """The Euclidean norms (…) of vectors (…, n), each with the bits that it has alone."""
    return np.asarray(np.sqrt(total(vectors * vectors, -1)))


def cross(one: Array, other: Array) -> Array:
    """The cross products of vectors (3,) or (n, 3), with the bits of `np.cross`, which takes ten times as long."""
    a, b, c = one.T
    x, y, z = other.T
    return np.array([b * z - c * y, c * x - a * z, a * y - b * x]).T


@dataclass(frozen=True, eq=False)
class Triangles:
    """Stacked matrices (k, m, n), of which the columns in an `order` (k, n) are Q R.

    `upper` (k, m, n) is R; Q is the product of reflections, `normals` (k, m) of their mirrors with a square of 2, or
    zero. Entries on the diagonal of R do not grow, but for round-off.
    """

    upper: Array
    normals: list[Array]
    order: NDArray[np.intp]

    @property
    def pivots(self) -> Array:
        """The sizes (k, min(m, n)) of the entries on the diagonal of R."""
        return np.abs(np.diagonal(self.upper, axis1=1, axis2=2))

    def onto(self, right: Array) -> Array:
        """Qᵀ times the right side (k, m, c)."""
        return self._reflected(right, self.normals)

    def basis(self) -> Array:
        """The matrices Q (k, m, m)."""
        count, size = self.upper.shape[:2]
        unit = np.broadcast_to(np.eye(size), (count, size, size)).copy()
        return self._reflected(unit, self.normals[::-1])

    def of(self, which: NDArray[np.bool_]) -> Triangles:
        """Those of some of the matrices."""
        return Triangles(self.upper[which], [normal[which] for normal in self.normals], self.order[which])

    @staticmethod
    def _reflected(right: Array, normals: list[Array]) -> Array:
        for normal in normals:
            right = right - normal[:, :, None] * total(normal[:, :, None] * right, 1)[:, None, :]
        return right


def triangles(matrices: Array, exchange: bool = True) -> Triangles:
    """The decomposition of stacked matrices (k, m, n), with or without exchanges of columns."""
    count, m, n = matrices.shape
    if count == 1 and m and n and _is_small(matrices):
        found = small.triangle(matrices[0].T.tolist(), exchange)
        mirrors = [np.array([normal]) for normal in found.normals]
        return Triangles(np.array([found.columns]).transpose(0, 2, 1), mirrors, np.array([found.order]))
    upper = np.array(matrices, dtype=float)
    everyone, order, normals = np.arange(count), np.tile(np.arange(n), (count, 1)), list[Array]()
    for step in range(min(m, n)):
        rest = upper[:, step:, step:]
        squares = total(rest * rest, 1) if exchange else total(rest[:, :, :1] * rest[:, :, :1], 1)
        if exchange:
            best = step + np.argmax(squares, axis=1)
            swapped = upper[everyone, :, best]
            upper[everyone, :, best] = upper[:, :, step]
            upper[:, :, step] = swapped
            order[everyone, best], order[:, step] = order[:, step], order[everyone, best]
            squares = squares[everyone, best - step, None]
        first, size = upper[:, step, step], np.sqrt(squares[:, 0])
        normal = np.zeros((count, m))
        normal[:, step:] = upper[:, step:, step]
        normal[:, step] += np.where(first < 0.0, -size, size)
        length = np.sqrt(size * (size + np.abs(first)))  # so that the square becomes 2
        normal = np.divide(normal, length[:, None], out=np.zeros_like(normal), where=length[:, None] > 0.0)
        own = normal[:, step:, None]
        rest -= own * total(own * rest, 1)[:, None, :]
        upper[:, step + 1 :, step] = 0.0
        normals.append(normal)
    return Triangles(upper, normals, order)


def ranks(matrices: Array, limit: float) -> NDArray[np.intp]:
    """The numbers (k,) of singular values of stacked matrices (k, m, n) that exceed a limit."""
    if not matrices[0].size:
        return np.zeros(len(matrices), dtype=np.intp)
    return _ranks(matrices, triangles(matrices).pivots, np.full(len(matrices), limit))


def _ranks(matrices: Array, pivots: Array, limits: Array) -> NDArray[np.intp]:
    found = np.sum(pivots > limits[:, None], axis=1)
    doubtful = (pivots > limits[:, None] / DOUBTFUL) & (pivots <= limits[:, None] * DOUBTFUL)
    for index in np.flatnonzero(np.any(doubtful, axis=1)):
        found[index] = np.sum(svd(matrices[index])[1] > limits[index])
    return np.asarray(found)


def least_solution(matrix: Array, right: Array, limit: float | None = None) -> Array:
    """The x (n,) or (n, c) of least norm among those for which `matrix` @ x is nearest to `right` (m,) or (m, c).

    :param limit: up to which singular values count as zero; by default ε times the largest, and the larger size.
    """
    columns = right[:, None] if right.ndim == 1 else right
    found = least_solutions(matrix[None], columns[None], None if limit is None else np.array([limit]))[0]
    return np.asarray(found[:, 0] if right.ndim == 1 else found)


def least_solutions(matrices: Array, rights: Array, limits: Array | None = None) -> Array:
    """The solutions (k, n, c) for stacked matrices (k, m, n) and right sides (k, m, c), with the bits of each alone."""
    count, m, n = matrices.shape
    solutions = np.zeros((count, n, rights.shape[2]))
    if not (m and n and count):
        return solutions
    if count == 1 and _is_small(matrices):
        limit = None if limits is None else float(limits[0])
        return _small_solution(matrices[0], rights[0], limit)[None]
    found = triangles(matrices)
    if limits is None:
        limits = EPSILON * max(m, n) * found.pivots[:, 0]
    pivots, doubtful = found.pivots, np.zeros(count, dtype=bool)
    doubtful |= np.any((pivots > limits[:, None] / DOUBTFUL) & (pivots <= limits[:, None] * DOUBTFUL), axis=1)
    rank_of_each = np.sum(pivots > limits[:, None], axis=1)
    for index in np.flatnonzero(doubtful):
        solutions[index] = _by_singular_values(matrices[index], rights[index], float(limits[index]))
    for rank in np.unique(rank_of_each[~doubtful]).tolist():
        which = ~doubtful & (rank_of_each == rank)
        if rank:
            solutions[which] = _of_rank(found.of(which), rights[which], rank)
    return solutions


def _is_small(matrix: Array) -> bool:
    return matrix.size <= SMALL and bool(np.isfinite(matrix).all())


def _small_solution(matrix: Array, rights: Array, limit: float | None) -> Array:
    """As `least_solutions`, of one small matrix."""
    found = small.triangle(matrix.T.tolist())
    pivots = [abs(column[row]) for row, column in enumerate(found.columns[: len(matrix)])]
    if limit is None:
        limit = EPSILON * max(matrix.shape) * pivots[0]
    if any(limit / DOUBTFUL < pivot <= limit * DOUBTFUL for pivot in pivots):
        return _by_singular_values(matrix, rights, limit)
    rank = sum(pivot > limit for pivot in pivots)
    if not rank:
        return np.zeros((matrix.shape[1], rights.shape[1]))
    second = small.second_of(found, rank)
    rows = [small.of_rank(found, right, rank, second) for right in rights.T.tolist()]
    return np.ascontiguousarray(np.array(rows).reshape(rights.shape[1], matrix.shape[1]).T)


def _of_rank(found: Triangles, rights: Array, rank: int) -> Array:
    """The least solutions of matrices with a known rank."""
    right, upper = found.onto(rights)[:, :rank], found.upper[:, :rank]
    count, _, n = upper.shape
    if rank == n:
        ordered = _back_substituted(upper, right)
    else:
        second = triangles(np.swapaxes(upper, 1, 2), exchange=False)
        reduced = np.zeros((count, n, right.shape[2]))
        reduced[:, :rank] = _forward_substituted(np.swapaxes(second.upper[:, :rank], 1, 2), right)
        ordered = second._reflected(reduced, second.normals[::-1])
    solutions = np.zeros_like(ordered)
    np.put_along_axis(solutions, found.order[:, :, None], ordered, axis=1)
    return solutions


def _by_singular_values(matrix: Array, right: Array, limit: float) -> Array:
    left, sizes, axes = svd(matrix, full_matrices=False)
    kept = sizes > limit
    return np.asarray(product(axes[kept].T, product(left[:, kept].T, right) / sizes[kept][:, None]))


def _back_substituted(upper: Array, right: Array) -> Array:
    x = right.copy()
    for index in range(upper.shape[1] - 1, -1, -1):
        x[:, index] /= upper[:, index, index, None]
        x[:, :index] -= upper[:, :index, index, None] * x[:, index, None, :]
    return x


def _forward_substituted(lower: Array, right: Array) -> Array:
    x = right.copy()
    for index in range(lower.shape[1]):
        x[:, index] /= lower[:, index, index, None]
        x[:, index + 1 :] -= lower[:, index + 1 :, index, None] * x[:, index, None, :]
    return x


def null_space(matrix: Array, limit: float, rank: int | None = None) -> Array:
    """An orthonormal basis (n, k) of the null space of a matrix (m, n).

    :param limit: up to which singular values count as zero.
    :param rank: that of the matrix, instead of a limit.
    """
    found = triangles(matrix.T[None])
    pivots = found.pivots[0]
    if rank is None:
        doubtful = bool(np.any((pivots > limit / DOUBTFUL) & (pivots <= limit * DOUBTFUL)))
        rank = int(np.sum(pivots > limit))
    else:
        doubtful = rank < len(pivots) and (rank == 0 or not pivots[rank] * DOUBTFUL <= pivots[rank - 1])
        limit = -1.0
    if doubtful:
        _, sizes, axes = svd(matrix)
        return np.ascontiguousarray(axes[rank if limit < 0.0 else int(np.sum(sizes > limit)) :].T)
    return np.ascontiguousarray(found.basis()[0][:, rank:])


def svd(matrix: Array, full_matrices: bool = True) -> tuple[Array, Array, Array]:
    """U, the singular values (min(m, n),) from the largest, and Vᵀ of a matrix (m, n), as `np.linalg.svd`."""
    m, n = matrix.shape
    if m < n:
        left, sizes, right = svd(matrix.T, full_matrices)
        return np.ascontiguousarray(right.T), sizes, np.ascontiguousarray(left.T)
    found = triangles(matrix[None])
    # The columns of Rᵀ become orthogonal: Rᵀ V = U S, so that R = V S Uᵀ.
    columns, turned = _orthogonalized(found.upper[0, :n])
    sizes = norms(columns)
    order = np.argsort(-sizes, kind="stable")
    columns, turned, sizes = columns[order], turned[order], sizes[order]
    right = np.zeros((n, n))
    right[:, found.order[0]] = _completed(columns, sizes)
    left = np.zeros((m, m))
    left[:n, :n] = turned.T
    left[n:, n:] = np.eye(m - n)
    left = found._reflected(left[None], found.normals[::-1])[0]
    return left if full_matrices else np.ascontiguousarray(left[:, :n]), sizes, right


def _orthogonalized(rows: Array) -> tuple[Array, Array]:
    """Rows (n, m) that are orthogonal, and the rotation (n, n) that makes them from those that are given."""
    n = len(rows)
    both = np.hstack([rows, np.eye(n)])
    m = rows.shape[1]
    for _ in range(SWEEPS):
        done = True
        for p, q in _rounds(n):
            x, y = both[p], both[q]
            own, other = total(x[:, :m] * x[:, :m], 1), total(y[:, :m] * y[:, :m], 1)
            shared = total(x[:, :m] * y[:, :m], 1)
            turn = np.abs(shared) > EPSILON * n * np.sqrt(own) * np.sqrt(other)
            if not turn.any():
                continue
            done = False
            cosine, sine = (each[:, None] for each in _rotation(own, other, shared, turn))
            both[p], both[q] = cosine * x - sine * y, sine * x + cosine * y
        if done:
            break
    return both[:, :m], both[:, m:]


def _rotation(own: Array, other: Array, shared: Array, turn: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Cosines and sines (k,) of the rotations that diagonalize matrices ((own, shared), (shared, other))."""
    ratio = np.divide(other - own, 2.0 * shared, out=np.zeros_like(own), where=turn)
    large = np.abs(ratio) > 1e150  # its square would overflow
    root = np.sqrt(1.0 + np.where(large, 0.0, ratio) ** 2)
    tangent = np.where(ratio < 0.0, -1.0, 1.0) / (np.abs(ratio) + np.where(large, np.abs(ratio), root))
    tangent = np.where(turn, tangent, 0.0)
    cosine = 1.0 / np.sqrt(1.0 + tangent * tangent)
    return cosine, tangent * cosine


def _completed(rows: Array, sizes: Array) -> Array:
    """Orthogonal rows (n, n) with these `sizes` (n,), from the largest, as an orthonormal basis."""
    n = len(sizes)
    rank = int(np.sum(sizes > EPSILON * n * np.max(sizes, initial=0.0)))
    unit = rows[:rank] / sizes[:rank, None]
    if rank == n:
        return unit
    others = triangles(unit.T[None], exchange=False).basis()[0][:, rank:]
    return np.vstack([unit, others.T])


def eigh(matrix: Array) -> tuple[Array, Array]:
    """The eigenvalues (n,) of a symmetric matrix from the least, and its eigenvectors, the columns of (n, n)."""
    n = len(matrix)
    if _is_small(matrix):
        rounds = [list(zip(p.tolist(), q.tolist(), strict=True)) for p, q in _rounds(n)]
        diagonal, rows = small.eigh(np.asarray(matrix, dtype=float).tolist(), rounds, SWEEPS)
        return _ascending(np.array(diagonal), np.array(rows).reshape(n, n))
    values, axes = np.array(matrix, dtype=float), np.eye(n)
    for _ in range(SWEEPS):
        done = True
        for p, q in _rounds(n):
            own, other, shared = values[p, p], values[q, q], values[p, q]
            turn = np.abs(shared) > 0.125 * EPSILON * np.sqrt(np.abs(own)) * np.sqrt(np.abs(other))
            turn &= np.abs(shared) > np.finfo(float).tiny
            if not turn.any():
                continue
            done = False
            cosine, sine = (each[:, None] for each in _rotation(own, other, shared, turn))
            x, y = values[p], values[q]
            values[p], values[q] = cosine * x - sine * y, sine * x + cosine * y
            x, y = values[:, p].T, values[:, q].T
            values[:, p], values[:, q] = (cosine * x - sine * y).T, (sine * x + cosine * y).T
            values[p[turn], q[turn]] = values[q[turn], p[turn]] = 0.0
            x, y = axes[p], axes[q]
            axes[p], axes[q] = cosine * x - sine * y, sine * x + cosine * y
        if done:
            break
    return _ascending(np.diagonal(values), axes)


def _ascending(values: Array, axes: Array) -> tuple[Array, Array]:
    order = np.argsort(values, kind="stable")
    return values[order], np.ascontiguousarray(axes[order].T)


def inverse_of_symmetric(matrix: Array) -> Array:
    """The pseudoinverse of a symmetric matrix."""
    values, axes = eigh(matrix)
    kept = np.abs(values) > 1e-15 * np.max(np.abs(values), initial=0.0)
    return np.asarray(product(axes[:, kept] / values[kept], axes[:, kept].T))


def solve(matrix: Array, right: Array) -> Array:
    """The solution (n,) or (n, k) of a square system, by elimination with exchanges of rows.

    :raises np.linalg.LinAlgError: the matrix is singular.
    """
    n = len(matrix)
    both = np.hstack([matrix, right.reshape(n, -1)])
    for step in range(n):
        best = step + int(np.argmax(np.abs(both[step:, step])))
        if not both[best, step]:
            raise np.linalg.LinAlgError("singular matrix")
        both[[step, best]] = both[[best, step]]
        both[step] /= both[step, step]
        factors = both[:, step].copy()
        factors[step] = 0.0
        both -= factors[:, None] * both[step]
    return np.asarray(both[:, n:].reshape(right.shape))


def inverse(matrix: Array) -> Array:
    """The inverse of a square matrix.

    :raises np.linalg.LinAlgError: it is singular.
    """
    return solve(matrix, np.eye(len(matrix)))


@functools.lru_cache(maxsize=64)
def _rounds(n: int) -> tuple[tuple[NDArray[np.intp], NDArray[np.intp]], ...]:
    """Every pair (p, q) of n indices once, in rounds in which no index occurs twice."""
    return tuple(_drawn(n))


def _drawn(n: int) -> Iterator[tuple[NDArray[np.intp], NDArray[np.intp]]]:
    players = [*range(n), *([-1] * (n % 2))]
    for _ in range(len(players) - 1):
        half = len(players) // 2
        pairs = [
            (min(pair), max(pair))
            for pair in zip(players[:half], reversed(players[half:]), strict=True)
            if min(pair) >= 0
        ]
        yield np.array([p for p, _ in pairs], dtype=np.intp), np.array([q for _, q in pairs], dtype=np.intp)
        players = [players[0], players[-1], *players[1:-1]]
