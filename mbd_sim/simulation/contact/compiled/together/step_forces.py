"""The forces of contacts that act together in a step of time stepping, in the subset of Python that is compiled.

Some sweeps over the contacts come near to forces that are the only ones, and Newton's method finds them. Where forces
depend on each other, they are those that elastic supports approach as these become rigid: see
`mbd_sim.simulation.contact.problem`. Their motion is followed from soft supports on.
"""

from __future__ import annotations

import math

from mbd_sim.compiler.ir.python_kinds import Array, Integers, integers, zeros
from mbd_sim.simulation.contact.compiled.instant.forces import (
    ACCURATE,
    SLIPS,
    SOFTNESS,
    UNPRESSED,
    ForceProblem,
    jacobian_of,
    length_of,
    quick_forces,
    rates_of,
    residual_of,
    scaled_problem,
    sweep,
)
from mbd_sim.simulation.contact.compiled.instant.islands import (
    FRICTIONS,
    NORMALS,
    ROWS,
    SIZES,
    find_islands,
    measure_island,
    take_island,
)
from mbd_sim.simulation.contact.compiled.instant.linear import SINGULAR
from mbd_sim.simulation.contact.compiled.instant.shared_forces import copy, scaled_compliance
from mbd_sim.simulation.contact.compiled.together.elimination import (
    Elimination,
    eliminate,
    find_order,
    number_contacts,
)

FEW_SWEEPS, NEWTON_STEPS = 10, 25
STIFFER, LEAST_RATIO = 100.0, 1.02  # ratios of the softnesses of supports that become rigid, from one to the next
STIFF, RIGID = 1e-10, 1e-13  # softness from which on forces only need be `ACCURATE`, and that of rigid supports
FOLLOWED, SETTLED = 1e-3, 1e-12  # residuals up to which softer supports are followed, per softness, and rigid ones end
POLISHED, POLISHING_STEPS = 1e-15, 6
FASTER = 10.0  # times the rates that are tried first, those that are tried next
HALVINGS, DECREASE = 8, 1e-4  # of a step of Newton's method, and by how much the squares of residuals decrease at least


def nearest_forces(p: ForceProblem, compliance: Array, forces: Array) -> bool:
    """The `step_forces` (n,) of all islands; False where some are not found.

    :param compliance: (n,) of the supports.
    """
    islands = integers(p.n)
    count = find_islands(p, islands)
    if count < 2:
        return step_forces(p, compliance, forces)
    return not any(not forces_on(p, compliance, islands, island, forces) for island in range(count))


def forces_on(p: ForceProblem, compliance: Array, islands: Integers, island: int, forces: Array) -> bool:
    """The `step_forces` of an island, among those of all."""
    sizes = integers(SIZES)
    measure_island(p, islands, island, sizes)
    n, normals, frictions = sizes[ROWS], sizes[NORMALS], sizes[FRICTIONS]
    rows, found, matrix, free, limits = integers(n), zeros(n), zeros(n * n), zeros(n), zeros(frictions)
    normal_rows, friction_rows, loads = integers(normals), integers(2 * frictions), integers(frictions)
    own, supports = (
        ForceProblem(n, matrix, free, normals, normal_rows, frictions, friction_rows, loads, limits),
        zeros(n),
    )
    take_island(p, islands, island, own, rows)
    for i in range(n):
        supports[i] = compliance[rows[i]]
    if not step_forces(own, supports, found):
        return False
    for i in range(n):
        forces[rows[i]] = found[i]
    return True


def step_forces(p: ForceProblem, compliance: Array, forces: Array) -> bool:
    """λ (n,) of an island that satisfies all conditions, of several that of elastic supports; False if none is found.

    :param compliance: (n,) of the supports.
    """
    n, scale = p.n, zeros(p.n)
    matrix, free, sizes, own = zeros(p.n * p.n), zeros(p.n), zeros(p.frictions), zeros(p.n)
    if n == 0:
        return True
    scaled_problem(p, matrix, free, sizes, scale)
    scaled_compliance(n, compliance, scale, own)
    scaled = ForceProblem(n, matrix, free, p.normals, p.normal_rows, p.frictions, p.friction_rows, p.loads, sizes)
    if p.normals < 2 and p.frictions < 2:
        if not quick_forces(scaled, forces):
            return False
    elif not (forces_together(scaled, own, forces) or quick_forces(scaled, forces)):
        return False
    for i in range(n):
        forces[i] = forces[i] * scale[i]
    return True


def forces_together(p: ForceProblem, compliance: Array, forces: Array) -> bool:
    """The forces of several contacts of a scaled problem; False if they are not found."""
    n, contacts = p.n, integers(p.n)
    count = number_contacts(p, contacts)
    e = Elimination(count, integers(count), integers(count + 1), integers(count * n))
    find_order(p, contacts, count, e)
    sweep(p, FEW_SWEEPS, forces)
    if polish(p, p, e, NEWTON_STEPS, forces) <= ACCURATE and is_only_solution(p, e, forces):
        return True
    return approach_rigid(p, compliance, e, forces)


def polish(p: ForceProblem, regular: ForceProblem, e: Elimination, steps: int, forces: Array) -> float:
    """Newton's method with the derivatives of a problem whose rows do not depend on each other: the best residual."""
    n, trial, natural, best, jacobian = p.n, zeros(p.n), zeros(p.n), zeros(p.n), zeros(p.n * p.n)
    least = math.inf
    for step in range(steps + 1):
        found = residual_of(p, forces, trial, natural)
        if found < least:
            least = found
            copy(n, forces, best)
        if not found <= 1e3 * least or least <= POLISHED or step == steps:
            break
        jacobian_of(regular, trial, jacobian)
        if eliminate(e, n, jacobian, natural) == 0.0:
            break
        for i in range(n):
            forces[i] -= natural[i]
    copy(n, best, forces)
    return least


def approach_rigid(p: ForceProblem, compliance: Array, e: Elimination, forces: Array) -> bool:
    """The forces of elastic supports that become stiffer and stiffer, until they are those of rigid ones."""
    n, softness, last, ratio, least = p.n, 1.0, math.inf, STIFFER, math.inf
    matrix, known, trial = zeros(p.n * p.n), zeros(p.n), zeros(p.n)
    softened = ForceProblem(n, matrix, p.free, p.normals, p.normal_rows, p.frictions, p.friction_rows, p.loads, p.sizes)
    copy(n * n, p.matrix, matrix)
    while softness > RIGID:
        for i in range(n):
            matrix[i * n + i] = p.matrix[i * n + i] + softness * compliance[i]
        if not follow(softened, softness, e, known, trial):
            ratio = math.sqrt(ratio)
            if ratio < LEAST_RATIO or softness == 1.0:
                break
            softness = last / ratio
            continue
        copy(n, trial, known)
        if softness <= SOFTNESS:
            found = polish(p, softened, e, POLISHING_STEPS, trial)
            if found < least:
                least = found
                copy(n, trial, forces)
            if least <= (ACCURATE if softness <= STIFF else SETTLED):
                break
        last, ratio = softness, min(STIFFER, ratio * ratio)
        softness = max(last / ratio, SOFTNESS) if last > SOFTNESS else last / ratio
    return least <= ACCURATE


def follow(p: ForceProblem, softness: float, e: Elimination, start: Array, forces: Array) -> bool:
    """Forces of supports of some softness from the `start`, those of softer ones; False if they are not found.

    Rates times a factor have the same solution. Beside forces of size 1, rates of the size of the motion of supports
    then tell what slides.
    """
    limit, root = max(FOLLOWED * min(softness, FOLLOWED), 1e-13), 1.0 / math.sqrt(softness)
    for trial in range(3):
        factor = root if trial == 0 else (FASTER * root if trial == 1 else root * root)
        copy(p.n, start, forces)
        if damped_newton(p, factor, limit, e, forces):
            return True
    return False


def damped_newton(p: ForceProblem, factor: float, limit: float, e: Elimination, forces: Array) -> bool:
    """Newton's method with rates times a factor; whether the residual is within a limit."""
    n, matrix, free, trial, natural = p.n, zeros(p.n * p.n), zeros(p.n), zeros(p.n), zeros(p.n)
    jacobian, new = zeros(p.n * p.n), zeros(p.n)
    faster = ForceProblem(n, matrix, free, p.normals, p.normal_rows, p.frictions, p.friction_rows, p.loads, p.sizes)
    for i in range(n * n):
        matrix[i] = factor * p.matrix[i]
    for i in range(n):
        free[i] = factor * p.free[i]
    for _ in range(NEWTON_STEPS):
        if residual_of(p, forces, trial, natural) <= limit:
            return True
        residual_of(faster, forces, trial, natural)
        squares, part = squares_of(n, natural), 1.0
        jacobian_of(faster, trial, jacobian)
        if eliminate(e, n, jacobian, natural) == 0.0:
            return False
        for _ in range(HALVINGS):
            for i in range(n):
                new[i] = forces[i] - part * natural[i]
            if squares_at(faster, new) <= (1.0 - DECREASE * part) * squares:
                break
            part = 0.5 * part
        copy(n, new, forces)
    return residual_of(p, forces, trial, natural) <= limit


def squares_of(n: int, values: Array) -> float:
    """The sum of n squares."""
    total = 0.0
    for i in range(n):
        total += values[i] * values[i]
    return total


def squares_at(p: ForceProblem, forces: Array) -> float:
    """The sum of the squares of the residual of some forces."""
    trial, natural = zeros(p.n), zeros(p.n)
    residual_of(p, forces, trial, natural)
    return squares_of(p.n, natural)


def is_only_solution(p: ForceProblem, e: Elimination, forces: Array) -> bool:
    """Whether closed contacts and friction at rest are independent, so that nothing is shared."""
    n, rates, right, matrix = p.n, zeros(p.n), zeros(p.n), zeros(p.n * p.n)
    bears, sliding, largest = integers(p.n), zeros(p.n), 0.0
    rates_of(p, forces, rates)
    for i in range(n):
        largest = max(largest, abs(forces[i]))
    for i in range(p.normals):
        row = p.normal_rows[i]
        bears[row] = forces[row] > 0.0 or rates[row] <= UNPRESSED * largest
    for k in range(p.frictions):
        if p.loads[k] < 0 or bears[p.loads[k]]:
            divide(p, k, forces, rates, SLIPS * SOFTNESS * (1.0 + largest), bears, sliding)
    for i in range(n):
        for j in range(n if bears[i] else 0):
            matrix[i * n + j] = p.matrix[i * n + j] if bears[j] else 0.0
        matrix[i * n + i] = matrix[i * n + i] if bears[i] else 1.0
    for k in range(p.frictions):
        for direction in range(2 if p.loads[k] >= 0 else 0):
            row = p.friction_rows[2 * k + direction]
            if row >= 0 and sliding[row] != 0.0:
                for i in range(n):
                    if bears[i]:
                        matrix[i * n + p.loads[k]] += p.matrix[i * n + row] * sliding[row]
    return eliminate(e, n, matrix, right) > SINGULAR


def divide(
    p: ForceProblem, element: int, forces: Array, rates: Array, slow: float, bears: Integers, sliding: Array
) -> None:  # fmt: skip
    """Say which rows of friction are at rest, or what they have of their normal force while they slide."""
    normal, square, slips = p.loads[element], 0.0, length_of(p.friction_rows, element, rates) > slow
    limit = p.sizes[element] * (1.0 if normal < 0 else forces[normal])
    for direction in range(2):
        row = p.friction_rows[2 * element + direction]
        if row >= 0:
            square += (forces[row] - rates[row]) * (forces[row] - rates[row])
    length = math.sqrt(square)
    at_rest = length < limit * (1.0 - UNPRESSED) or not slips
    for direction in range(2):
        row = p.friction_rows[2 * element + direction]
        if row >= 0 and at_rest:
            bears[row] = 1
        elif row >= 0 and length > 0.0 and normal >= 0:
            sliding[row] = (forces[row] - rates[row]) * (p.sizes[element] / length)
