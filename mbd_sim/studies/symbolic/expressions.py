"""The outputs of traced functions as matrices of short SymPy expressions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import sympy as sp

from mbd_sim.base.errors import MbdSimError
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.studies.symbolic.algebra.equation_limits import MAX_OPERATIONS, MAX_TERMS, MAX_TOTAL_OPERATIONS, too_large
from mbd_sim.studies.symbolic.algebra.evaluation import evaluate
from mbd_sim.studies.symbolic.algebra.harmonics import shortest
from mbd_sim.studies.symbolic.algebra.polynomial import Algebra, Polynomial, TooLargeError, without_denominators
from mbd_sim.studies.symbolic.coordinates import SymbolicEnergies

Inputs = Sequence[Sequence[Polynomial]]


def simplified(mechanism: Mechanism, algebra: Algebra, function: ca.Function, inputs: Inputs) -> list[list[list[Any]]]:
    """The outputs of a function of scalars, row by row, as short expressions.

    :raises MbdSimError: they are too long to be read.
    """
    try:
        outputs = evaluate(algebra, function, inputs)
        outputs = [[without_denominators(algebra, p) for p in output] for output in outputs]
    except TooLargeError as error:
        raise too_large(mechanism, str(error)) from error
    longest = max((len(p) for output in outputs for p in output), default=0)
    if longest > MAX_TERMS:
        raise too_large(mechanism, f"one of their entries has {longest} terms")
    matrices, total = [], 0
    for number, values in enumerate(outputs):
        rows, columns = function.size_out(number)
        matrix = [[sp.S.Zero] * columns for _ in range(rows)]
        # Equal entries, as in a symmetric matrix, are simplified once.
        known: dict[frozenset[Any], tuple[Any, int]] = {}
        for row, column, p in _entries(function, number, values):
            key = frozenset(p.items())
            if key not in known:
                entry = shortest(algebra, p)
                known[key] = entry, int(entry.count_ops())
            matrix[row][column], length = known[key]
            total += length
            if length > MAX_OPERATIONS:
                raise too_large(mechanism, f"one of their entries has {length} operations")
            if total > MAX_TOTAL_OPERATIONS:
                raise too_large(mechanism, f"their entries have more than {MAX_TOTAL_OPERATIONS} operations")
        matrices.append(matrix)
    return matrices


def energies_if_short(
    mechanism: Mechanism, algebra: Algebra, function: ca.Function, inputs: Inputs
) -> SymbolicEnergies | None:
    """The energies, see `energy_function`; None if they are too long to be read."""
    try:
        return SymbolicEnergies(*(matrix[0][0] for matrix in simplified(mechanism, algebra, function, inputs)))
    except MbdSimError:
        return None


def _entries(function: ca.Function, output: int, values: Sequence[Polynomial]) -> list[tuple[int, int, Polynomial]]:
    """The row, column and value of each nonzero entry of an output."""
    rows, columns = function.sparsity_out(output).get_triplet()
    return list(zip(rows, columns, values, strict=True))
