"""Assembly of many variants of a mechanism at once, each with the bits that it would get alone.

The same operations as in `mbd_sim.dynamics.assembly` and `initial_conditions`, on arrays with a row for each variant.
Variants for which Newton's method fails, whose constraints are undefined, whose speeds are not consistent, or which
start with speeds in a singular configuration, are left to those.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mbd_sim.dynamics.assembly import (
    CLOSED,
    CONSISTENT,
    ITERATIONS,
    LONGEST_STEP,
    STALLED,
    energy_rows,
    resting_speeds,
)
from mbd_sim.dynamics.constraint_functions import ManyConstraints, scaled
from mbd_sim.dynamics.constraint_rank import RANK, least_solution, row_is_zero
from mbd_sim.geometry.pose import Array

HALVINGS = 12


@dataclass(frozen=True, eq=False)
class ManyStarts:
    """Coordinates (k, nq) and speeds (k, nv), and whether those of each variant (k,) satisfy the constraints."""

    q: Array
    u: Array
    assembled: NDArray[np.bool_]


@np.errstate(all="ignore")
def start_many(
    constraints: ManyConstraints,
    q: Array,
    u: Array,
    fixed_q: NDArray[np.bool_],
    fixed_u: NDArray[np.bool_],
    rank: int,
) -> ManyStarts:
    """Close the loops and fit the speeds of all variants at t = 0.

    :param q: (k, nq) and `u` (k, nv) of the file.
    :param fixed_q: (nv,) which coordinates are kept, as displacements; `fixed_u` (nv,) which speeds.
    :param rank: of the constraint matrix almost everywhere.
    """
    q, closed = _closed(constraints, q, ~fixed_q)
    going = np.flatnonzero(closed & _defined(constraints, q))
    speeds, assembled = np.zeros_like(u), np.zeros(len(q), dtype=bool)
    if going.size:
        speeds[going], consistent = _fitted(constraints, q[going], u[going], fixed_u, going)
        gradient = constraints.gradient(q[going], going)
        matrices = scaled(gradient, constraints.row_sizes(q[going], going), constraints.scales)
        ranks = np.linalg.matrix_rank(matrices, tol=RANK)
        assembled[going] = consistent & ((ranks >= rank) | ~speeds[going].any(axis=1))
    return ManyStarts(q, speeds, assembled)


def _defined(constraints: ManyConstraints, q: Array) -> NDArray[np.bool_]:
    """For which variants (k,) all that speeds and ranks are found from is finite."""
    everyone = np.arange(len(q))
    gradient, mass_matrix = constraints.gradient(q, everyone), constraints.mass_matrix(q, everyone)
    values = [array.reshape(len(q), -1) for array in (gradient, constraints.drift(q, everyone), mass_matrix)]
    return np.asarray(np.all(np.isfinite(np.concatenate(values, axis=1)), axis=1))


def _closed(constraints: ManyConstraints, start: Array, free: NDArray[np.bool_]) -> tuple[Array, NDArray[np.bool_]]:
    """Gauss–Newton as for one mechanism; each variant stops by itself."""
    q, going = start.copy(), np.arange(len(start))
    gaps = constraints.position(q, going)
    for _ in range(ITERATIONS):
        norm = _norms(gaps[going])
        sizes = constraints.row_sizes(q, going)
        slopes = scaled(constraints.gradient(q, going), sizes, constraints.scales)[:, constraints.holonomic][:, :, free]
        finite = (norm != 0.0) & np.isfinite(norm) & np.all(np.isfinite(slopes), axis=(1, 2))
        going, norm, slopes, sizes = going[finite], norm[finite], slopes[finite], sizes[finite]
        if not going.size:
            break
        step = np.zeros((len(going), len(free)))
        if slopes[0].size:
            held = (array[:, constraints.holonomic] for array in (gaps[going], sizes))
            step[:, free] = [_least_step(*of_one) for of_one in zip(slopes, *held, strict=True)]
        step *= np.minimum(1.0, LONGEST_STEP / np.maximum(np.max(np.abs(step), axis=1), 1e-300))[:, None]
        going = _searched(constraints, q, gaps, going, norm, constraints.scales * step)
    everyone = np.arange(len(q))
    closed = np.all(np.abs(gaps) <= CLOSED * constraints.row_sizes(q, everyone), axis=1)
    return q, closed & np.all(constraints.branch_checks(q, everyone) > 0.0, axis=1)


def _least_step(slope: Array, gaps: Array, sizes: Array) -> Array:
    """The displacement of the free coordinates, for one variant."""
    rows = sizes > 0.0
    return -least_solution(slope[rows], gaps[rows] / sizes[rows])


def _searched(
    constraints: ManyConstraints, q: Array, gaps: Array, going: NDArray[np.intp], norm: Array, step: Array
) -> NDArray[np.intp]:
    """Halve steps until the gap falls, and take them, in place; the variants for which it is worth to go on."""
    further: list[NDArray[np.intp]] = []
    for _ in range(HALVINGS):
        moved = constraints.displaced(q[going], step, going)
        moved_gaps = constraints.position(moved, going)
        moved_norm = _norms(moved_gaps)
        falls = moved_norm < norm
        taken = going[falls]
        q[taken], gaps[taken] = moved[falls], moved_gaps[falls]
        further.append(taken[~(moved_norm[falls] > (1.0 - STALLED) * norm[falls])])
        going, norm, step = going[~falls], norm[~falls], step[~falls] * 0.5
        if not going.size:
            break
    return np.sort(np.concatenate(further))


def _fitted(
    constraints: ManyConstraints, q: Array, u: Array, fixed: NDArray[np.bool_], which: NDArray[np.intp]
) -> tuple[Array, NDArray[np.bool_]]:
    """The speeds of least kinetic energy of some variants, as for one mechanism."""
    gradient, drift = constraints.gradient(q, which), constraints.drift(q, which)
    selection = np.broadcast_to(np.eye(u.shape[1])[fixed], (len(q), int(fixed.sum()), u.shape[1]))
    rows, right = np.concatenate([gradient, selection], axis=1), np.concatenate([-drift, u[:, fixed]], axis=1)
    if not rows[0].size:
        return np.zeros_like(u), np.ones(len(q), dtype=bool)
    scales, row_sizes = constraints.scales, constraints.row_sizes(q, which)
    given = np.zeros((len(q), int(fixed.sum())), dtype=bool)
    zero_rows = row_is_zero(scaled(gradient, row_sizes, scales))
    zero = np.concatenate([zero_rows, given], axis=1)
    masses, momenta = constraints.mass_matrix(q, which), constraints.momentum(q, which)
    resting = np.array([resting_speeds(*one, scales) for one in zip(masses, momenta, strict=True)])
    right = right - _times(rows, resting)
    in_energy = [energy_rows(*of_one, scales) for of_one in zip(masses, rows, zero, strict=True)]
    to_unit, unit, lengths = (np.array(each) for each in zip(*in_energy, strict=True))
    speeds = np.zeros_like(u)
    for _ in range(2):
        rest = (right - _times(rows, speeds)) / lengths
        found = [least_solution(matrix, side) for matrix, side in zip(unit, rest, strict=True)]
        speeds += _times(to_unit, np.array(found))
    speeds = np.where(np.all(zero_rows, axis=1)[:, None], 0.0, speeds + resting)
    speeds[:, fixed] = u[:, fixed]
    errors = _times(gradient, speeds) + drift
    rates = np.maximum(np.max(np.abs(speeds) / scales, axis=1, initial=0.0), constraints.rate_of_drives(q, which)[:, 0])
    tolerance = CONSISTENT * (row_sizes * rates[:, None] + np.abs(drift))
    return speeds, np.all(np.abs(errors) <= tolerance, axis=1)


def _times(matrices: Array, vectors: Array) -> Array:
    """The product of each matrix with its vector, by the routine for one."""
    product: Array = (matrices @ vectors[:, :, None])[:, :, 0]
    return product


def _norms(vectors: Array) -> Array:
    """The Euclidean norm of each row, by the routine for one."""
    norms: Array = np.sqrt((vectors[:, None, :] @ vectors[:, :, None])[:, 0, 0])
    return norms
