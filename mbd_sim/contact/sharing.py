"""Forces that rigid bodies leave undetermined, as equal elastic supports would share them."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from mbd_sim.contact.elimination import least_squares, product, rank
from mbd_sim.geometry.pose import Array

if TYPE_CHECKING:
    from mbd_sim.contact.problem import ContactProblem

SOFTNESS = 1e-6  # of elastic supports, relative to the largest diagonal entry
SLIPS = 20.0  # times the motion of elastic supports, beyond which friction at its limit slides
SHARING_STEPS, SETTLED = 60, 1e-15  # until forces that are shared do not change any more, relative to their size
UNPRESSED = 1e-9  # of the largest force, that counts as none where a support is left out or added


def shared_forces(problem: ContactProblem, forces: Array) -> Array:
    """The forces of least Σ C λ² near some that satisfy all conditions: with the same contacts closed, and sticking.

    Friction that slides follows its normal force in the direction that it has.
    """
    assert problem.compliance is not None
    size = float(np.abs(forces).max())
    pressed = [row for row in problem.normals if forces[row] > 0.0]
    closed = _closed(problem, forces)
    for _ in range(SHARING_STEPS):
        unit, constant, held = _followers(problem, forces)
        matrix, free = product(problem.matrix, unit), problem.rates(constant)
        chosen, others = [*pressed, *held], [row for row in closed if row not in pressed]
        found, duals = least_squares(matrix[chosen][:, chosen], -free[chosen], problem.compliance[chosen])
        pulls = [row for row, force in zip(pressed, found.tolist(), strict=False) if force < -UNPRESSED * size]
        pressed = [row for row in pressed if row not in pulls]
        gains = product(matrix[chosen][:, others].T, duals)
        added = [row for row, gain in zip(others, gains.tolist(), strict=True) if gain > UNPRESSED * size and not pulls]
        pressed = sorted([*pressed, *added])
        new = constant + product(unit[:, chosen], found)
        change, forces = float(np.abs(new - forces).max()), new
        if not pulls and not added and change <= SETTLED * size:
            break
    return forces


def is_unique(problem: ContactProblem, forces: Array) -> bool:
    """Whether closed contacts and friction at rest are independent, so that nothing is shared."""
    unit, _, held = _followers(problem, forces, limited=True)
    chosen = [*_closed(problem, forces), *held]
    return rank(product(problem.matrix, unit)[chosen][:, chosen]) == len(chosen)


def _closed(problem: ContactProblem, forces: Array) -> list[int]:
    """The normal rows that bear a force, or could bear one."""
    still, rates = UNPRESSED * float(np.abs(forces).max()), problem.rates(forces)
    return [row for row in problem.normals if forces[row] > 0.0 or rates[row] <= still]


def at_rest(problem: ContactProblem, forces: Array) -> Array:
    """The rates (n,) of elastic supports that bear a force and do not slide; others are zero."""
    rates, slow, found = problem.rates(forces), _slow(forces), np.zeros(len(forces))
    for row in problem.normals:
        if forces[row] > 0.0:
            found[row] = rates[row]
    for friction in problem.frictions:
        rows = list(friction.rows)
        if math.hypot(*rates[rows]) <= slow:
            found[rows] = rates[rows]
    return found


def _slow(forces: Array) -> float:
    """The rate beyond which friction at its limit slides."""
    return SLIPS * SOFTNESS * (1.0 + float(np.abs(forces).max()))


def _followers(problem: ContactProblem, forces: Array, limited: bool = False) -> tuple[Array, Array, list[int]]:
    """All forces are `unit` (n, n) times those of the normal rows and of the `held` ones, and `constant` (n,).

    :param limited: friction of constant size that is at its limit, but does not slide, is held as well.
    """
    n, rates = len(forces), problem.rates(forces)
    trial, slow = forces - rates, _slow(forces)
    unit, constant, held = np.zeros((n, n)), np.zeros(n), list[int]()
    for row in problem.normals:
        unit[row, row] = 1.0
    for friction in problem.frictions:
        rows, own = list(friction.rows), trial[list(friction.rows)]
        limit = friction.size * (1.0 if friction.normal is None else float(forces[friction.normal]))
        length, slips = math.hypot(*own), math.hypot(*rates[rows]) > slow
        if length < limit * (1.0 - UNPRESSED) or not (slips or (friction.normal is None and not limited)):
            held += rows
            unit[rows, rows] = 1.0
        elif length > 0.0 and friction.normal is None:
            constant[rows] = own * (limit / length)
        elif length > 0.0:
            unit[rows, friction.normal] = own * (friction.size / length)
    return unit, constant, held
