"""The characteristic polynomial of linearized equations, where it is short enough to be read."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

MAX_POLYNOMIAL = 3  # speeds up to which the characteristic polynomial is expanded
MAX_STATES = 2  # of actuators up to which it is
MAX_ROWS = 2  # constraints up to which it is
MAX_POLYNOMIAL_OPERATIONS = 250
MAX_ENTRIES = 250  # operations of the matrices from which it is expanded; with 400 this takes half a minute


def characteristic_polynomial(blocks: Sequence[Any], s: Any, gradient: Any, factor: Any) -> Any | None:
    """The determinant of the linearized equations in s, bordered by -Gᵀ and by G times a factor, by powers of s.

    :param blocks: M, C, K, E, A, B and S, see `SymbolicLinearization`.
    """
    import sympy as sp

    mass, damping, stiffness, coupling, by_q, by_u, by_s = blocks
    own = mass * s**2 + damping * s + stiffness
    right, below, corner = coupling, -by_q - by_u * s, s * sp.eye(by_s.rows) - by_s
    if sum(int(entry.count_ops()) for matrix in (*blocks, gradient) for entry in matrix) > MAX_ENTRIES:
        return None
    if own.rows > MAX_POLYNOMIAL or gradient.rows > MAX_ROWS or corner.rows > MAX_STATES:
        return None
    matrix = sp.Matrix(sp.BlockMatrix([[own, right], [below, corner]])) if corner.rows else own
    if gradient.rows:
        border = gradient.row_join(sp.zeros(gradient.rows, corner.rows))
        matrix = sp.Matrix(sp.BlockMatrix([[matrix, -border.T], [factor * border, sp.zeros(gradient.rows)]]))
    determinant = sp.expand(matrix.det(method="berkowitz"))
    result = sp.collect(determinant, s, sp.factor)
    return result if result.count_ops() <= MAX_POLYNOMIAL_OPERATIONS else None
