"""Forces at one-sided contacts with Coulomb friction where they are unique, in the subset of Python that is compiled.

Lemke's method finds the modes, Newton's the forces: see `mbd_sim.simulation.contact.problem`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from mbd_sim.compiler.ir.python_kinds import Array, Integers, integers, zeros
from mbd_sim.simulation.contact.compiled.instant.linear import lemke, pivots, solve, solve_regular

SOFTNESS = 1e-6  # of elastic supports, relative to the largest diagonal entry
SLIPS = 20.0  # times the motion of elastic supports, beyond which friction at its limit slides
UNPRESSED = 1e-9  # of the largest force, that counts as none where a support is left out or added
ACCURATE = 1e-10  # residual, relative to the size of forces and rates, up to which a solution is accepted
NEWTON_STEPS = 40


@dataclass(frozen=True)
class ForceProblem:
    """A contact problem: `matrix` A (n, n) and rates r (n,) without forces, the normal rows among them, and friction.

    Friction element k has the rows 2 k and 2 k + 1 of `friction_rows`, of which the second is -1 along one direction;
    up to `sizes` k times the force of the row `loads` k, or up to that itself where there is no such row, -1.
    """

    n: int
    matrix: Array
    free: Array
    normals: int
    normal_rows: Integers
    frictions: int
    friction_rows: Integers
    loads: Integers
    sizes: Array


def unique_together(p: ForceProblem, forces: Array) -> bool:
    """λ (n,) that satisfies all conditions, if it is found quickly and the only one."""
    scale = zeros(p.n)
    matrix, free, sizes = zeros(p.n * p.n), zeros(p.n), zeros(p.frictions)
    if p.n == 0:
        return True
    scaled_problem(p, matrix, free, sizes, scale)
    scaled = ForceProblem(
        p.n, matrix, free, p.normals, p.normal_rows, p.frictions, p.friction_rows, p.loads, sizes
    )  # fmt: skip
    if not quick_forces(scaled, forces):
        return False
    if not ((p.normals < 2 and p.frictions < 2) or is_unique(scaled, forces)):
        return False
    for i in range(p.n):
        forces[i] = forces[i] * scale[i]
    return True


def quick_forces(p: ForceProblem, forces: Array) -> bool:
    """λ (n,) that satisfies all conditions of a scaled problem, if it is found quickly; perhaps one of several."""
    if by_lemke(p, forces) and newton(p, forces, False) <= ACCURATE:
        return True
    for i in range(p.n):
        forces[i] = 0.0
    return newton(p, forces, False) <= ACCURATE


def scaled_problem(p: ForceProblem, matrix: Array, free: Array, sizes: Array, scale: Array) -> None:
    """Scale a problem to rows of unit diagonal and rates of at most 1; λ = scale · λ of the scaled one.

    The rows of one friction element keep a common scale, so that its circle stays one, and so does its normal row.
    """
    n, weights, size = p.n, zeros(p.n), 0.0
    find_weights(p, weights)
    for i in range(n):
        free[i] = weights[i] * p.free[i]
        size = max(size, abs(free[i]))
    size = size if size > 0.0 else 1.0
    for i in range(n):
        free[i] = free[i] / size
        scale[i] = size * weights[i]
        for j in range(n):
            matrix[i * n + j] = p.matrix[i * n + j] * weights[i] * weights[j]
    for k in range(p.frictions):
        sizes[k] = p.sizes[k] / scale[p.friction_rows[2 * k]] if p.loads[k] < 0 else p.sizes[k]


def find_weights(p: ForceProblem, weights: Array) -> None:
    """The factors (n,) of the rows of a scaled problem."""
    n, diagonal = p.n, zeros(p.n)
    for i in range(n):
        diagonal[i] = p.matrix[i * n + i]
    changed = True
    while changed:  # rows that share a normal row
        changed = False
        for k in range(p.frictions):
            first, second, load = p.friction_rows[2 * k], p.friction_rows[2 * k + 1], p.loads[k]
            second = first if second < 0 else second
            load = first if load < 0 else load
            largest = max(max(diagonal[first], diagonal[second]), diagonal[load])
            if diagonal[first] != largest or diagonal[second] != largest or diagonal[load] != largest:
                diagonal[first], diagonal[second], diagonal[load] = largest, largest, largest
                changed = True
    for i in range(n):
        weights[i] = 1.0 / math.sqrt(diagonal[i] if diagonal[i] > 0.0 else 1.0)


def by_lemke(p: ForceProblem, forces: Array) -> bool:
    """The solution with friction along the directions of the rows, which is exact for one direction."""
    size, n = p.normals, p.n
    columns = p.normals + 4 * p.frictions
    rows, signs, elements = integers(columns), zeros(columns), integers(columns)
    total = columns + p.frictions
    matrix, right, z = zeros(total * total), zeros(total), zeros(total)
    for i in range(p.normals):
        rows[i] = p.normal_rows[i]
        signs[i] = 1.0
        elements[i] = -1
    for k in range(p.frictions):
        for direction in range(2):
            row = p.friction_rows[2 * k + direction]
            if row >= 0:
                for side in range(2):
                    rows[size] = row
                    signs[size] = 1.0 - 2.0 * side
                    elements[size] = k
                    size += 1
    total = size + p.frictions
    for i in range(size):
        for j in range(size):
            matrix[i * total + j] = signs[i] * p.matrix[rows[i] * n + rows[j]] * signs[j]
        right[i] = signs[i] * p.free[rows[i]]
        if elements[i] >= 0:
            matrix[i * total + size + elements[i]] = 1.0
            matrix[(size + elements[i]) * total + i] = -1.0
    for k in range(p.frictions):
        if p.loads[k] < 0:
            right[size + k] = p.sizes[k]
        else:
            for i in range(p.normals):
                if p.normal_rows[i] == p.loads[k]:
                    matrix[(size + k) * total + i] = p.sizes[k]
    for i in range(n):
        forces[i] = 0.0
    if not lemke(total, matrix, right, z):
        return False
    for i in range(size):
        forces[rows[i]] += signs[i] * z[i]
    return True


def rates_of(p: ForceProblem, forces: Array, rates: Array) -> None:
    """s (n,), summed in order."""
    n = p.n
    for i in range(n):
        rates[i] = p.free[i]
    for j in range(n):
        if forces[j] != 0.0:
            for i in range(n):
                rates[i] += p.matrix[i * n + j] * forces[j]


def length_of(rows: Integers, element: int, values: Array) -> float:
    """The length of the friction of an element."""
    first, second = values[rows[2 * element]], 0.0
    if rows[2 * element + 1] >= 0:
        second = values[rows[2 * element + 1]]
        return math.sqrt(first * first + second * second)
    return math.sqrt(first * first)


def residual_of(p: ForceProblem, forces: Array, trial: Array, natural: Array) -> float:
    """The trial λ - s (n,), the residual F = λ - P(λ - s) (n,), and its size relative to the forces.

    P gives the nearest admissible forces. F is zero where all conditions are satisfied.
    """
    n, largest, size = p.n, 0.0, 0.0
    rates_of(p, forces, natural)
    for i in range(n):
        trial[i] = forces[i] - natural[i]
        natural[i] = trial[i]
    for i in range(p.normals):
        natural[p.normal_rows[i]] = max(trial[p.normal_rows[i]], 0.0)
    for k in range(p.frictions):
        limit = p.sizes[k] * (1.0 if p.loads[k] < 0 else natural[p.loads[k]])
        length = length_of(p.friction_rows, k, natural)
        if length > limit:
            for direction in range(2):
                row = p.friction_rows[2 * k + direction]
                if row >= 0:
                    natural[row] = natural[row] * (limit / length)
    for i in range(n):
        natural[i] = forces[i] - natural[i]
        if not math.isfinite(natural[i]):
            return math.inf
        largest = max(largest, abs(natural[i]))
        size = max(size, abs(forces[i]))
    return largest / (1.0 + size)


def newton(p: ForceProblem, forces: Array, is_regular: bool) -> float:
    """Semismooth Newton on λ - P(λ - s) = 0 (Alart & Curnier 1991): the best iterate, and the size of its residual.

    :param is_regular: rows do not depend on each other.
    """
    n = p.n
    trial, natural, best, change = zeros(n), zeros(n), zeros(n), zeros(n)
    jacobian = zeros(n * n)
    least = residual_of(p, forces, trial, natural)
    if least == 0.0:
        return least
    for i in range(n):
        best[i] = forces[i]
    for _ in range(NEWTON_STEPS):
        if is_regular:
            jacobian_of(p, trial, jacobian)
        for i in range(n):
            natural[i] = -natural[i]
            change[i] = natural[i]
        if not is_regular or not solve_regular(n, jacobian, change):
            jacobian_of(p, trial, jacobian)
            solve(n, jacobian, natural, change)
        for i in range(n):
            forces[i] = forces[i] + change[i]
        found = residual_of(p, forces, trial, natural)
        if not found < least:
            if not math.isfinite(found) or least <= 1e-15:
                break
            if found > 1e3 * least:
                break
            continue
        for i in range(n):
            best[i] = forces[i]
        least = found
        if least <= 1e-16:
            break
    for i in range(n):
        forces[i] = best[i]
    return least


def sweep(p: ForceProblem, sweeps: int, forces: Array) -> None:
    """Projected Gauss–Seidel sweeps over the elements, from some forces λ (n,) on."""
    for _ in range(sweeps):
        for i in range(p.normals):
            row = p.normal_rows[i]
            diagonal = p.matrix[row * p.n + row]
            if diagonal > 0.0:
                forces[row] = max(forces[row] - rate_of(p, forces, row) / diagonal, 0.0)
        for k in range(p.frictions):
            first, second = p.friction_rows[2 * k], p.friction_rows[2 * k + 1]
            along, across, diagonal = rate_of(p, forces, first), 0.0, p.matrix[first * p.n + first]
            if second >= 0:
                across, diagonal = rate_of(p, forces, second), max(diagonal, p.matrix[second * p.n + second])
            if not diagonal > 0.0:
                continue
            forces[first] = forces[first] - along / diagonal
            if second >= 0:
                forces[second] = forces[second] - across / diagonal
            limit = p.sizes[k] * (1.0 if p.loads[k] < 0 else max(forces[p.loads[k]], 0.0))
            length = length_of(p.friction_rows, k, forces)
            if length > limit:
                forces[first] = forces[first] * (limit / length)
                if second >= 0:
                    forces[second] = forces[second] * (limit / length)


def rate_of(p: ForceProblem, forces: Array, row: int) -> float:
    """The rate of a row."""
    total = 0.0
    for j in range(p.n):
        total += p.matrix[row * p.n + j] * forces[j]
    return p.free[row] + total


def jacobian_of(p: ForceProblem, trial: Array, jacobian: Array) -> None:
    """The Jacobian (n, n) of F = λ - P(λ - s)."""
    n = p.n
    for i in range(n):
        for j in range(n):
            jacobian[i * n + j] = 1.0 if i == j else 0.0
    for i in range(p.normals):
        row = p.normal_rows[i]
        if trial[row] > 0.0:
            for j in range(n):
                jacobian[row * n + j] = p.matrix[row * n + j]
    for k in range(p.frictions):
        first, second, normal = p.friction_rows[2 * k], p.friction_rows[2 * k + 1], p.loads[k]
        load = 1.0 if normal < 0 else max(trial[normal], 0.0)
        limit, size = p.sizes[k] * load, length_of(p.friction_rows, k, trial)
        if size <= limit or size == 0.0:
            for j in range(n):
                jacobian[first * n + j] = p.matrix[first * n + j]
                if second >= 0:
                    jacobian[second * n + j] = p.matrix[second * n + j]
            continue
        along, across = trial[first] / size, 0.0
        if second >= 0:
            across = trial[second] / size
        for j in range(n):
            if second >= 0:
                by_first = (1.0 if first == j else 0.0) - p.matrix[first * n + j]
                by_second = (1.0 if second == j else 0.0) - p.matrix[second * n + j]
                turned = limit / size * (-across * by_first + along * by_second)
                jacobian[first * n + j] -= -across * turned
                jacobian[second * n + j] -= along * turned
            if normal >= 0 and trial[normal] > 0.0:
                by_normal = (1.0 if normal == j else 0.0) - p.matrix[normal * n + j]
                jacobian[first * n + j] -= p.sizes[k] * along * by_normal
                if second >= 0:
                    jacobian[second * n + j] -= p.sizes[k] * across * by_normal


def is_unique(p: ForceProblem, forces: Array) -> bool:
    """Whether closed contacts and friction at rest are independent, so that nothing is shared."""
    n, largest, count = p.n, 0.0, 0
    rates, unit, chosen, closed = zeros(n), zeros(n * n), integers(n), integers(n)
    matrix, order = zeros(n * n), integers(n)
    rates_of(p, forces, rates)
    for i in range(n):
        largest = max(largest, abs(forces[i]))
    for i in range(p.normals):
        row = p.normal_rows[i]
        unit[row * n + row] = 1.0
        if forces[row] > 0.0 or rates[row] <= UNPRESSED * largest:
            closed[row] = 1
            chosen[count] = row
            count += 1
    slow = SLIPS * SOFTNESS * (1.0 + largest)
    for k in range(p.frictions):
        normal = p.loads[k]
        if normal >= 0 and not closed[normal]:
            continue
        limit = p.sizes[k] * (1.0 if normal < 0 else forces[normal])
        slips = length_of(p.friction_rows, k, rates) > slow
        square = 0.0
        for direction in range(2):
            row = p.friction_rows[2 * k + direction]
            if row >= 0:
                square += (forces[row] - rates[row]) * (forces[row] - rates[row])
        length = math.sqrt(square)
        at_rest = length < limit * (1.0 - UNPRESSED) or not slips
        for direction in range(2):
            row = p.friction_rows[2 * k + direction]
            if row >= 0 and at_rest:
                unit[row * n + row] = 1.0
                chosen[count] = row
                count += 1
            elif row >= 0 and length > 0.0 and normal >= 0:
                unit[row * n + normal] = (forces[row] - rates[row]) * (p.sizes[k] / length)
    for i in range(count):
        for j in range(count):
            for k in range(n):
                matrix[i * count + j] += p.matrix[chosen[i] * n + k] * unit[k * n + chosen[j]]
    return pivots(count, matrix, order) == count
