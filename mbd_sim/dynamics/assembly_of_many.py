"""Assembly of many variants of a mechanism at once, each with the bits that it would get alone.

The same operations as in `mbd_sim.dynamics.assembly` and `initial_conditions`, on arrays with a row for each variant.
Variants for which Newton's method fails, whose constraints are undefined, whose speeds are not consistent, or which
start with speeds in a singular configuration, are left to those.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mbd_sim.dynamics.assembly import CLOSED, CONSISTENT, ITERATIONS, LONGEST_STEP, STALLED, resting_speeds
from mbd_sim.dynamics.constraint_functions import ManyConstraints
from mbd_sim.dynamics.constraint_rank import RANK, unit_rows
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
        ranks = np.linalg.matrix_rank(unit_rows(constraints.gradient(q[going], going)), tol=RANK)
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
        slopes = constraints.gradient(q, going)[:, constraints.holonomic][:, :, free]
        finite = (norm != 0.0) & np.isfinite(norm) & np.all(np.isfinite(slopes), axis=(1, 2))
        going, norm, slopes = going[finite], norm[finite], slopes[finite]
        if not going.size:
            break
        step = np.zeros((len(going), len(free)))
        if slopes[0].size:
            step[:, free] = [
                -np.linalg.lstsq(slope, gap, rcond=RANK)[0]
                for slope, gap in zip(slopes, gaps[going][:, constraints.holonomic], strict=True)
            ]
        step *= np.minimum(1.0, LONGEST_STEP / np.maximum(np.max(np.abs(step), axis=1), 1e-300))[:, None]
        going = _searched(constraints, q, gaps, going, norm, step)
    closed = np.all(np.abs(gaps) <= CLOSED * constraints.size, axis=1)
    return q, closed & np.all(constraints.branch_checks(q, np.arange(len(q))) > 0.0, axis=1)


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
    mass_matrices, momenta = constraints.mass_matrix(q, which), constraints.momentum(q, which)
    resting = np.array([resting_speeds(*one) for one in zip(mass_matrices, momenta, strict=True)])
    right = right - _times(rows, resting)
    weights, axes = np.linalg.eigh(mass_matrices)
    least = 1e-12 * np.maximum(weights.max(axis=1, initial=0.0), 1e-300)
    to_unit = axes / np.sqrt(np.maximum(weights, least[:, None]))[:, None, :]
    scaled = rows @ to_unit
    sizes = np.linalg.norm(scaled, axis=2)
    sizes[np.linalg.norm(rows, axis=2) < 1e-12] = np.inf
    scaled /= sizes[:, :, None]
    speeds = np.zeros_like(u)
    for _ in range(2):
        rest = (right - _times(rows, speeds)) / sizes
        found = [np.linalg.lstsq(matrix, side, rcond=RANK)[0] for matrix, side in zip(scaled, rest, strict=True)]
        speeds += _times(to_unit, np.array(found))
    speeds += resting
    speeds[:, fixed] = u[:, fixed]
    errors = _times(gradient, speeds) + drift
    reference = np.linalg.norm(gradient, axis=2) * _norms(speeds)[:, None]
    tolerance = CONSISTENT * (reference + np.abs(drift) + constraints.size * 1e-3)
    return speeds, np.all(np.abs(errors) <= tolerance, axis=1)


def _times(matrices: Array, vectors: Array) -> Array:
    """The product of each matrix with its vector, by the routine for one."""
    product: Array = (matrices @ vectors[:, :, None])[:, :, 0]
    return product


def _norms(vectors: Array) -> Array:
    """The Euclidean norm of each row, by the routine for one."""
    norms: Array = np.sqrt((vectors[:, None, :] @ vectors[:, :, None])[:, 0, 0])
    return norms
