"""Speeds at a start in a singular configuration, such as that of a parallelogram lying flat."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mbd_sim.dynamics.constraint_functions import ConstraintFunctions
from mbd_sim.dynamics.constraint_rank import RANK, null_space, row_sizes, unit_rows
from mbd_sim.geometry.pose import Array

SATISFIED = 1e-8  # curvature of the constraints that may remain, relative to γ,
ROUND_OFF = 1e-13  # or to the squared speeds, where γ itself is round-off, as on the axis of a turning part
SLOPES = (
    1e-12  # of the largest: slopes that vanish with the speeds of a loop at rest, which end at this share of others
)
STARTS, ITERATIONS = 12, 50


def speeds_of_a_branch(
    constraints: ConstraintFunctions, t: float, q: Array, u: Array, fixed: NDArray[np.bool_]
) -> Array:
    """The speeds near u (nv,) with which the mechanism can move on, if its rows depend on each other at q.

    For a stress n with nᵀ G = 0, G u' + γ(u) = 0 requires nᵀ γ(u) = 0: a quadratic equation for u, whose solutions
    belong to the branches that meet at q. Of those found, the one that adds least kinetic energy is taken; `fixed`
    (nv,) speeds stay. u is returned if it is one of them, or if none is found.

    :param u: speeds that satisfy G u + b = 0 with the least kinetic energy.
    """
    gradient = constraints.gradient(t, q)
    stresses = null_space(unit_rows(gradient).T)
    sizes = row_sizes(gradient)
    sizes[sizes == np.inf] = 1.0  # each of these rows is a stress by itself
    free = null_space(np.vstack([unit_rows(gradient), np.eye(len(u))[fixed]]))
    if not stresses.shape[1] or not free.shape[1]:
        return u
    mass = constraints.mass_matrix(t, q)
    weights, axes = np.linalg.eigh(free.T @ mass @ free)
    if not weights[0] > 0.0:
        return u
    free = free @ axes / np.sqrt(weights)  # directions of unit energy

    def curvature(speeds: Array) -> Array:
        return np.asarray(stresses.T @ (constraints.bias(t, q, speeds) / sizes))

    # Not γ of the speeds that are judged: on a branch on which the linkage moves without it, all of it is round-off.
    # Nor γ of rows in no stress, such as those of other loops, which may be far faster.
    stressed = np.any(np.abs(stresses) > RANK, axis=1)
    bias = float(np.linalg.norm((constraints.bias(t, q, u) / sizes)[stressed]))

    def satisfied(speeds: Array) -> bool:
        tolerance = max(SATISFIED * bias, ROUND_OFF * float(speeds @ speeds))
        return float(np.linalg.norm(curvature(speeds))) <= tolerance

    if satisfied(u):
        return u
    size, random = float(np.sqrt(u @ mass @ u)) or 1.0, np.random.default_rng(3)
    best: Array | None = None
    for _ in range(STARTS):
        change = size * random.normal(size=free.shape[1])
        for _ in range(ITERATIONS):
            at = u + free @ change
            # Differences of a quadratic function are exact.
            slopes = [(curvature(at + move) - curvature(at - move)) / (2.0 * size) for move in size * free.T]
            step = np.linalg.lstsq(np.array(slopes).T, -curvature(at), rcond=SLOPES)[0]
            change = change + step
            if np.linalg.norm(step) <= 1e-15 * size:
                break
        if satisfied(u + free @ change) and (
            best is None or np.linalg.norm(change) < (1.0 - 1e-9) * np.linalg.norm(best)
        ):
            best = change
    return u if best is None else u + free @ best
