"""Starts in singular configurations: the speeds with which a mechanism can move on, or whether it can move at all."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base import linear_algebra as la
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.linear_algebra import norm, product
from mbd_sim.dynamics.constraints.functions import ConstraintFunctions
from mbd_sim.dynamics.math.rank import RANK, null_space, rank_of, unit_rows

SATISFIED = 1e-8  # curvature of the constraints that may remain, relative to γ in natural units,
CURVATURE_ROUND_OFF = 1e-13  # or to the squared speeds, where γ itself is round-off, as on the axis of a turning part
SLOPES = (
    1e-12  # of the largest: slopes that vanish with the speeds of a loop at rest, which end at this share of others
)
RETURNED = 1e-5  # distance in natural units up to which gaps, which are about its square, are round-off
STARTS, ITERATIONS = 12, 50


def is_isolated(constraints: ConstraintFunctions, nearby: Sequence[tuple[float, Array]]) -> bool:
    """Whether holonomic constraints allow the start alone, though they leave directions free, as stretched rods do.

    So it is if loops that are closed again after a displacement along free directions are back at the start; and if
    the only free direction d has nᵀ γ(d) ≠ 0 for a stress n, so that there is no G u' + γ(d) = 0: that also shows where
    gaps beside the start are tiny.

    :param nearby: configurations found along free directions, the assembled one first.
    """
    (t, q), others = nearby[0], [at for time, at in nearby[1:] if time == nearby[0][0]]
    moved = [np.abs(at - q) / constraints.coordinate_scales for at in others]
    if moved and np.max(moved) <= RETURNED:
        return True
    gradient = constraints.scaled_gradient(t, q)
    free = null_space(gradient)
    if free.shape[1] != 1 or not np.all(constraints.holonomic):
        return False
    bias = constraints.bias(t, q, constraints.scales * free[:, 0])
    sizes = constraints.row_sizes(t, q)
    bias = np.divide(bias, sizes, out=np.zeros_like(bias), where=sizes > 0.0)
    curvature = product(null_space(gradient.T).T, bias)
    return norm(curvature) > max(SATISFIED * norm(bias), RANK)


def speeds_of_a_branch(
    constraints: ConstraintFunctions, t: float, q: Array, u: Array, fixed: NDArray[np.bool_]
) -> Array:
    """The speeds near u (nv,) with which the mechanism can move on, if its rows depend on each other at q.

    For a stress n with nᵀ G = 0, G u' + γ(u) = 0 requires nᵀ γ(u) = 0: a quadratic equation for u, whose solutions
    belong to the branches that meet at q. Of those found, the one that adds least kinetic energy is taken; `fixed`
    (nv,) speeds stay. u is returned if it is one of them, or if none is found.

    :param u: speeds that satisfy G u + b = 0 with the least kinetic energy.
    """
    gradient, scales = constraints.scaled_gradient(t, q), constraints.scales
    lengths, sizes = la.norms(gradient), constraints.row_sizes(t, q)
    sizes = np.where(sizes > 0.0, sizes, np.inf) * np.where(lengths > RANK, lengths, 1.0)
    unit = unit_rows(gradient)
    stresses = null_space(unit.T, rank_of(gradient))
    # Rows in no stress, such as those of other loops, which may be far faster, have no part in what follows.
    stressed = np.any(np.abs(stresses) > RANK, axis=1)
    stresses[~stressed] = 0.0
    free = scales[:, None] * null_space(np.vstack([unit, np.eye(len(u))[fixed]]))
    if not stresses.shape[1] or not free.shape[1]:
        return u
    mass = constraints.mass_matrix(t, q)
    weights, axes = la.eigh(product(product(free.T, mass), free))
    if not weights[0] > 0.0:
        return u
    free = product(free, axes) / np.sqrt(weights)  # directions of unit energy

    def curvature(speeds: Array) -> Array:
        return np.asarray(product(stresses.T, constraints.bias(t, q, speeds) / sizes))

    # Not γ of the speeds that are judged: on a branch on which the linkage moves without it, all of it is round-off.
    bias = norm((constraints.bias(t, q, u) / sizes)[stressed])

    def satisfied(speeds: Array) -> bool:
        tolerance = max(SATISFIED * bias, CURVATURE_ROUND_OFF * norm(speeds / scales) ** 2)
        return norm(curvature(speeds)) <= tolerance

    if satisfied(u):
        return u
    size, random = float(np.sqrt(product(u, product(mass, u)))) or 1.0, np.random.default_rng(3)
    best: Array | None = None
    for _ in range(STARTS):
        change = size * random.normal(size=free.shape[1])
        for _ in range(ITERATIONS):
            at = u + product(free, change)
            # Differences of a quadratic function are exact.
            slopes = [(curvature(at + move) - curvature(at - move)) / (2.0 * size) for move in size * free.T]
            slope = np.array(slopes).T
            step = la.least_solution(slope, -curvature(at), SLOPES * norm(slope))
            change = change + step
            if norm(step) <= 1e-15 * size:
                break
        if satisfied(u + product(free, change)) and (best is None or norm(change) < (1.0 - 1e-9) * norm(best)):
            best = change
    return u if best is None else u + product(free, best)
