"""Couplings that repeat each other but for the digits of their ratios: the nearest ratios with which they do.

With coordinates q, couplings are C q = v. They repeat each other if there is a y with yᵀ C = 0 and yᵀ v = 0. Where
these are zero only nearly, the entries of C and v are changed as little as possible; those that are zero stay so.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.mechanism.elements.constraints import Constraint, Coupling
from mbd_sim.mechanism.elements.parts import Move
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.values.expression import TimeExpression


def exact_couplings(mechanism: Mechanism, nearly: float, round_off: float) -> dict[str, tuple[Constraint, Move]]:
    """The couplings of which a ratio changes, and by which part, by their names.

    :param nearly: a singular value that counts as zero within the digits of a file, and `round_off` what is zero.
    """
    found = [one for one in mechanism.constraints if isinstance(one, Coupling) and _is_linear(one)]
    if len(found) < 2:
        return {}
    columns = list(dict.fromkeys(name for one in found for name in one.factors))
    rows, scaled = _equilibrated(np.array([[one.factors.get(name, 0.0) for name in columns] for one in found]))
    left, sizes, _ = np.linalg.svd(scaled)
    sizes = np.pad(sizes, (0, len(found) - len(sizes)))
    stresses = left[:, sizes < nearly]
    values = np.array([one.value.at(0.0) for one in found])
    offsets = rows * values
    if np.abs(stresses.T @ np.column_stack([scaled, offsets])).max(initial=0.0) <= round_off:
        return {}
    parts = _relative_changes(scaled, stresses)
    of_values = _relative_changes(offsets[:, None], stresses)[:, 0]
    share = np.abs(offsets) / (np.max(np.abs(offsets)) or 1.0)  # a value may be a small difference of large ones
    changed: dict[str, tuple[Constraint, Move]] = {}
    for one, part, of_value, value, of_largest in zip(found, parts, of_values, values, share, strict=True):
        largest = float(np.max(np.abs([*part, of_value * of_largest])))
        if largest > round_off:
            factors = {name: one.factors[name] * (1.0 + part[columns.index(name)]) for name in one.factors}
            offset = TimeExpression(repr(float(value * (1.0 + of_value))), {}) if of_value else one.value
            changed[one.name] = dataclasses.replace(one, factors=factors, value=offset), Move(0.0, largest)
    return changed


def _is_linear(coupling: Coupling) -> bool:
    return coupling.law is None and coupling.play is None and not coupling.value.variables


def _equilibrated(matrix: Array) -> tuple[Array, Array]:
    """The factors (m,) of the rows, and the matrix (m, n) with rows and columns whose entries are about 1 or 0."""
    used, (count, _) = np.nonzero(matrix), matrix.shape
    unknown = np.zeros((len(used[0]), sum(matrix.shape)))  # the logarithms of the factors of rows and columns
    entries = np.arange(len(unknown))
    unknown[entries, used[0]] = unknown[entries, count + used[1]] = 1.0
    factors = np.exp(np.linalg.lstsq(unknown, -np.log(np.abs(matrix[used])), rcond=None)[0])
    return factors[:count], factors[:count, None] * matrix * factors[count:]


def _relative_changes(matrix: Array, stresses: Array) -> Array:
    """The parts (m, n) by which the entries change so that all combinations `stresses` (m, k) of the rows are zero."""
    changes = np.zeros_like(matrix)
    for number, column in enumerate(matrix.T):
        used = column != 0.0
        change = -np.linalg.lstsq(stresses[used].T, stresses.T @ column, rcond=None)[0]
        changes[used, number] = change / column[used]
    return changes
