"""Friction at rest that equilibrium leaves open: as far from its limits as possible.

Of all distributions with the same effect, that with the largest product of 1 - |T|²/L² is taken, where L are the limits
(the analytic center; Boyd & Vandenberghe, *Convex Optimization*, sec. 8.5). It is unique, and does not depend on units,
axes or the order of elements. While the load approaches that at which all slip, all of them approach their limits.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.linear_algebra import added
from mbd_sim.simulation.contact.complementarity import null_space, product, solve, unit_diagonal

INVOLVED = 1e-9  # part of a self-stress, relative to its largest, from which on an element has one
EXHAUSTED = 1e-12  # of the limits, a common reserve that counts as none
NARROW = 1e-10  # excess of limits over those that are just wide enough, at which these are found
CLOSER = 0.25  # part of the way from limits that are too wide to those that are just wide enough
WIDTHS, NEWTON_STEPS, CENTERED = 40, 60, 1e-10


def centered(
    matrix: Array, elements: Sequence[Sequence[int]], limits: Sequence[float], forces: Array
) -> tuple[Array, list[int]]:
    """The forces (n,) with other friction of `elements`, each of one or two rows, and which of these can be changed.

    :param limits: of the elements, positive.

    Where there is no reserve, friction is that which needs the least common factor of all limits.
    """
    rows = [row for own in elements for row in own]
    scaled, factors = unit_diagonal(matrix[rows][:, rows])
    stress = null_space(scaled) * factors[:, None]
    first = np.cumsum([0, *(len(own) for own in elements)])
    places = [slice(start, start + len(own)) for start, own in zip(first.tolist(), elements, strict=False)]
    sizes = np.repeat(np.array(limits), [len(own) for own in elements])
    stress = stress / sizes[:, None]
    largest = np.abs(stress).max(initial=0.0)
    shared = [k for k, place in enumerate(places) if np.abs(stress[place]).max(initial=0.0) > INVOLVED * largest]
    if not shared:
        return forces, shared
    uses = _centered_uses(forces[rows] / sizes, stress, [places[k] for k in shared])
    found = forces.copy()
    found[rows] = uses * sizes
    return found, shared


def _centered_uses(start: Array, stress: Array, own: Sequence[slice]) -> Array:
    """T/L (m,) of least -Σ log(1 - |T|²/L²) over `start` + `stress` z, from limits that may be too narrow for it."""
    uses, width = start, 2.0 * max(1.0, _largest(start, own))
    for _ in range(WIDTHS):
        uses = _center(uses, stress, own, width)
        largest = _largest(uses, own)
        if largest < 1.0 - EXHAUSTED:
            return _center(uses, stress, own, 1.0)
        pulls = [2.0 * size / ((width - size) * (width + size)) for size in _sizes(uses, own)]
        # virtual work: no distribution needs less than this common factor
        least = added(p * size for p, size in zip(pulls, _sizes(uses, own), strict=True)) / added(pulls)
        if (least >= 1.0 - EXHAUSTED and width - least < NARROW) or width - largest <= EXHAUSTED:
            break  # all are at their limits, or one that hardly shares anything
        width = largest + CLOSER * (width - largest)
    return uses


def _sizes(uses: Array, own: Sequence[slice]) -> list[float]:
    return [math.hypot(*uses[place].tolist()) for place in own]


def _largest(uses: Array, own: Sequence[slice]) -> float:
    return max(_sizes(uses, own))


def _center(uses: Array, stress: Array, own: Sequence[slice], width: float) -> Array:
    """The center of limits that are `width` times as wide, by damped steps of Newton's method."""
    for _ in range(NEWTON_STEPS):
        count = stress.shape[1]
        slope, curvature = np.zeros(count), np.zeros((count, count))
        for place, size in zip(own, _sizes(uses, own), strict=True):
            pull = 2.0 / ((width - size) * (width + size))
            by_z = stress[place]
            along = product(by_z.T, uses[place])
            slope += pull * along
            curvature += pull * product(by_z.T, by_z) + pull**2 * np.multiply.outer(along, along)
        step = solve(curvature, -slope)
        decrement = math.sqrt(max(added((-slope * step).tolist()), 0.0))
        uses = uses + product(stress, step) / (1.0 if decrement < 0.25 else 1.0 + decrement)
        if decrement < CENTERED:
            break
    return uses
