"""Decompositions of one small matrix on Python's floats, with the bits of those in `linear_algebra`.

The operations and their order are the same. For a few rows and columns, NumPy takes most of its time for its calls:
these functions take a quarter to a half of it, and a start, a reset and a changed length in a loop call them often.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import sqrt
from operator import add, mul

EPSILON = 2.0**-52
Vector = list[float]
Pairs = Sequence[tuple[int, int]]


def _total(terms: Vector) -> float:
    """The sum: halves are added until one is left."""
    while (count := len(terms)) > 1:
        half = count // 2
        folded = list(map(add, terms, terms[count - half :]))
        if count % 2:
            folded[0] += terms[half]
        terms = folded
    return terms[0] if terms else 0.0


def _product(one: Vector, other: Vector) -> float:
    return _total(list(map(mul, one, other)))


@dataclass(frozen=True, eq=False)
class Triangle:
    """The columns of a matrix (m, n) in an `order` as Q R: the columns of R, and the mirrors of which Q is made."""

    columns: list[Vector]
    normals: list[Vector]
    order: list[int]


def triangle(columns: list[Vector], exchange: bool = True) -> Triangle:
    """The decomposition of a matrix, given by its columns, with or without exchanges of columns; `columns` change."""
    m, n = len(columns[0]), len(columns)
    order, normals = list(range(n)), list[Vector]()
    for step in range(min(m, n)):
        squares = [_product(column[step:], column[step:]) for column in columns[step : n if exchange else step + 1]]
        square = max(squares)
        best = step + squares.index(square)
        columns[step], columns[best] = columns[best], columns[step]
        order[step], order[best] = order[best], order[step]
        normal = columns[step][step:]
        first, size = normal[0], sqrt(square)
        length = sqrt(size * (size + abs(first)))
        normal[0] += -size if first < 0.0 else size
        normal = [value / length for value in normal] if length > 0.0 else [0.0] * len(normal)
        for column in columns[step:]:
            column[step:] = _mirrored(column[step:], normal)
        columns[step][step + 1 :] = [0.0] * (m - step - 1)
        normals.append([0.0] * step + normal)
    return Triangle(columns, normals, order)


def _mirrored(vector: Vector, normal: Vector) -> Vector:
    along = _product(normal, vector)
    return [value - component * along for value, component in zip(vector, normal, strict=True)]


def reflected(vector: Vector, normals: Iterable[Vector]) -> Vector:
    """A vector after reflections."""
    for normal in normals:
        vector = _mirrored(vector, normal)
    return vector


def of_rank(found: Triangle, right: Vector, rank: int, second: Triangle | None) -> Vector:
    """The x (n,) of least norm that is nearest to `right` (m,), with a known rank; see `second_of`."""
    x = reflected(right, found.normals)[:rank]
    n = len(found.columns)
    if second is None:
        for index in range(n - 1, -1, -1):
            column = found.columns[index]
            x[index] /= column[index]
            x[:index] = [value - entry * x[index] for value, entry in zip(x[:index], column, strict=False)]
    else:
        for index in range(rank):
            x[index] /= second.columns[index][index]
            for below in range(index + 1, rank):
                x[below] -= second.columns[below][index] * x[index]
        x = reflected(x + [0.0] * (n - rank), reversed(second.normals))
    solution = [0.0] * n
    for place, value in zip(found.order, x, strict=True):
        solution[place] = value
    return solution


def second_of(found: Triangle, rank: int) -> Triangle | None:
    """The decomposition of the transposed first rows of R, for a rank that is less than the number of columns."""
    if rank == len(found.columns):
        return None
    return triangle([[column[row] for column in found.columns] for row in range(rank)], exchange=False)


def eigh(values: list[Vector], rounds: Sequence[Pairs], sweeps: int) -> tuple[Vector, list[Vector]]:
    """The eigenvalues of a symmetric matrix, whose rows change, and its eigenvectors, in no order."""
    n = len(values)
    axes = [[1.0 if i == j else 0.0 for j in range(n)] for i in range(n)]
    for _ in range(sweeps):
        done = True
        for pairs in rounds:
            turns = [_rotation(values[p][p], values[q][q], values[p][q]) for p, q in pairs]
            if not any(turns):
                continue
            done = False
            rotations = [(p, q, *(turn or (1.0, 0.0))) for (p, q), turn in zip(pairs, turns, strict=True)]
            for rows in (values, axes):
                for p, q, cosine, sine in rotations:
                    x, y = rows[p], rows[q]
                    rows[p] = [cosine * a - sine * b for a, b in zip(x, y, strict=True)]
                    rows[q] = [sine * a + cosine * b for a, b in zip(x, y, strict=True)]
            for row in values:
                for p, q, cosine, sine in rotations:
                    a, b = row[p], row[q]
                    row[p], row[q] = cosine * a - sine * b, sine * a + cosine * b
            for (p, q), turn in zip(pairs, turns, strict=True):
                if turn:
                    values[p][q] = values[q][p] = 0.0
        if done:
            break
    return [values[index][index] for index in range(n)], axes


def _rotation(own: float, other: float, shared: float) -> tuple[float, float] | None:
    """Cosine and sine of the rotation that diagonalizes ((own, shared), (shared, other)), if it is not diagonal yet."""
    size = abs(shared)
    if not (size > 0.125 * EPSILON * sqrt(abs(own)) * sqrt(abs(other)) and size > 2.0**-1022):
        return None
    ratio = (other - own) / (2.0 * shared)
    root = abs(ratio) if abs(ratio) > 1e150 else sqrt(1.0 + ratio * ratio)
    tangent = (-1.0 if ratio < 0.0 else 1.0) / (abs(ratio) + root)
    cosine = 1.0 / sqrt(1.0 + tangent * tangent)
    return cosine, tangent * cosine
