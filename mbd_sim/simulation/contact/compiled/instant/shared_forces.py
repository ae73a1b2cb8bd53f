"""Forces at contacts that may depend on each other, in the subset of Python that is compiled.

Of several forces those that equal elastic supports share: see `mbd_sim.simulation.contact.problem`.
"""

from __future__ import annotations

import math

from mbd_sim.compiler.ir.python_kinds import Array, zeros
from mbd_sim.simulation.contact.compiled.instant.forces import (
    ACCURATE,
    SLIPS,
    SOFTNESS,
    ForceProblem,
    find_weights,
    is_unique,
    length_of,
    newton,
    quick_forces,
    rates_of,
    residual_of,
    scaled_problem,
)
from mbd_sim.simulation.contact.compiled.instant.least_forces import share
from mbd_sim.simulation.contact.compiled.instant.linear import rank_of

SOFTER, SOFTENINGS = 0.1, 6  # ratio of the softnesses of supports that follow each other, down from 1 to `SOFTNESS`
STIFFENINGS = 5  # each of which divides the rates of supports at rest by the ratio of their stiffness to `SOFTNESS`


def settled_together(p: ForceProblem, compliance: Array, forces: Array) -> bool:
    """λ (n,) that satisfies all conditions, of several those of least Σ C λ²; False where it is not found quickly.

    :param compliance: (n,) of the supports.
    """
    n, scale, found, elastic = p.n, zeros(p.n), zeros(p.n), zeros(p.n)
    matrix, free, sizes, own = zeros(p.n * p.n), zeros(p.n), zeros(p.frictions), zeros(p.n)
    if n == 0:
        return True
    scaled_problem(p, matrix, free, sizes, scale)
    scaled = ForceProblem(n, matrix, free, p.normals, p.normal_rows, p.frictions, p.friction_rows, p.loads, sizes)
    is_found, is_single = quick_forces(scaled, found), p.normals < 2 and p.frictions < 2
    if not (is_found and (is_single or is_unique(scaled, found))):
        if is_single or rank_of(n, matrix) == n:
            if not is_found:
                return False
        else:
            find_weights(p, own)
            scaled_compliance(n, compliance, own, own)
            if elastic_forces(scaled, own, elastic):
                is_found = settle(scaled, own, elastic, is_found, found)
            elif is_found:
                copy(n, found, elastic)
                is_found = settle(scaled, own, elastic, True, found)
            if not is_found:
                return False
    for i in range(n):
        forces[i] = found[i] * scale[i]
    return True


def settle(p: ForceProblem, compliance: Array, elastic: Array, is_found: bool, forces: Array) -> bool:
    """The forces of least Σ C λ² near those of elastic supports, or these, or else those that are found."""
    n, least, trial, natural = p.n, zeros(p.n), zeros(p.n), zeros(p.n)
    copy(n, elastic, least)
    share(p, compliance, least)
    if residual_of(p, least, trial, natural) <= ACCURATE:
        newton(p, least, False)
        copy(n, least, forces)
        return True
    if newton(p, elastic, False) <= ACCURATE:
        copy(n, elastic, forces)
        return True
    return is_found


def copy(n: int, values: Array, to: Array) -> None:
    """Copy n numbers."""
    for i in range(n):
        to[i] = values[i]


def scaled_compliance(n: int, compliance: Array, scale: Array, own: Array) -> None:
    """The compliance of the supports of a scaled problem, of which the largest is 1."""
    largest = 0.0
    for i in range(n):
        own[i] = scale[i] * scale[i] * compliance[i]
        largest = max(largest, own[i])
    for i in range(n):
        own[i] = own[i] / largest


def elastic_forces(p: ForceProblem, compliance: Array, forces: Array) -> bool:
    """The forces of elastic supports that become stiffer and stiffer; False if they were not found.

    Rates by which supports yield are made up for by a shift of their rest positions (method of multipliers).
    """
    n, softness, last, residual = p.n, 1.0, math.inf, math.inf
    matrix, free, rates, stiffer = zeros(p.n * p.n), zeros(p.n), zeros(p.n), zeros(p.n)
    softened = ForceProblem(n, matrix, free, p.normals, p.normal_rows, p.frictions, p.friction_rows, p.loads, p.sizes)
    for i in range(n * n):
        matrix[i] = p.matrix[i]
    for i in range(n):
        free[i] = p.free[i]
        forces[i] = 0.0
    for count in range(SOFTENINGS + 1):
        for i in range(n):
            matrix[i * n + i] = p.matrix[i * n + i] + softness * compliance[i]
        residual = newton(softened, forces, True)
        softness = SOFTNESS if count == SOFTENINGS - 1 else SOFTER * softness
    if residual > ACCURATE and not quick_forces(softened, forces):
        return False
    for _ in range(STIFFENINGS):
        size = rates_at_rest(p, forces, rates)
        if size <= ACCURATE * SOFTNESS or size > 0.5 * last:
            break
        for i in range(n):
            free[i] += rates[i]
            stiffer[i] = forces[i]
        if newton(softened, stiffer, True) > ACCURATE:
            break
        for i in range(n):
            forces[i] = stiffer[i]
        last = size
    return True


def rates_at_rest(p: ForceProblem, forces: Array, found: Array) -> float:
    """The rates (n,) of elastic supports that bear a force and do not slide, and the largest; others are zero."""
    rates, largest, size = zeros(p.n), 0.0, 0.0
    rates_of(p, forces, rates)
    for i in range(p.n):
        found[i] = 0.0
        largest = max(largest, abs(forces[i]))
    for i in range(p.normals):
        if forces[p.normal_rows[i]] > 0.0:
            found[p.normal_rows[i]] = rates[p.normal_rows[i]]
    for k in range(p.frictions):
        if length_of(p.friction_rows, k, rates) <= SLIPS * SOFTNESS * (1.0 + largest):
            for direction in range(2):
                row = p.friction_rows[2 * k + direction]
                if row >= 0:
                    found[row] = rates[row]
    for i in range(p.n):
        size = max(size, abs(found[i]))
    return size
