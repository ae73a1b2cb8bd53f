"""Of several forces at contacts those that elastic supports share, in the subset of Python that is compiled.

See `mbd_sim.simulation.contact.problem`.
"""

from __future__ import annotations

from mbd_sim.compiler.ir.python_kinds import Array, Integers, integers, zeros
from mbd_sim.simulation.contact.compiled.instant.forces import (
    SLIPS,
    SOFTNESS,
    UNPRESSED,
    ForceProblem,
    length_of,
    rates_of,
)
from mbd_sim.simulation.contact.compiled.instant.linear import least_solution, product, solve, take_block

SHARING_STEPS, SETTLED = 60, 1e-15  # until forces that are shared do not change any more, relative to their size


def largest_of(n: int, values: Array) -> float:
    """The largest size of n numbers."""
    found = 0.0
    for i in range(n):
        found = max(found, abs(values[i]))
    return found


def share(p: ForceProblem, compliance: Array, forces: Array) -> None:
    """The forces of least Σ C λ² near some that satisfy all conditions: with the same contacts closed, and sticking.

    Friction that slides follows its normal force in the direction that it has.
    """
    size, rates, pressed, closed = largest_of(p.n, forces), zeros(p.n), integers(p.n), integers(p.n)
    rates_of(p, forces, rates)
    for i in range(p.normals):
        row = p.normal_rows[i]
        pressed[row] = forces[row] > 0.0
        closed[row] = pressed[row] or rates[row] <= UNPRESSED * size
    for _ in range(SHARING_STEPS):
        if share_once(p, compliance, size, pressed, closed, forces):
            break


def share_once(
    p: ForceProblem, compliance: Array, size: float, pressed: Integers, closed: Integers, forces: Array
) -> bool:  # fmt: skip
    """Share the forces of the contacts that are `pressed`, which may be others then; whether nothing has changed.

    :param size: of the forces.
    """
    n, unit, constant, matrix, free = p.n, zeros(p.n * p.n), zeros(p.n), zeros(p.n * p.n), zeros(p.n)
    chosen, found, new, count, largest, new_force = integers(p.n), zeros(p.n), zeros(p.n), 0, 0.0, 0.0
    for i in range(p.normals):
        if pressed[p.normal_rows[i]]:
            chosen[count] = p.normal_rows[i]
            count += 1
    number = count
    count += find_followers(p, forces, closed, unit, constant, chosen[count:])
    product(n, n, n, p.matrix, unit, matrix)
    rates_of(p, constant, free)
    is_same = press(p, compliance, matrix, free, count, chosen, number, size, pressed, closed, found)
    for i in range(count):
        if found[i] != 0.0:
            for k in range(n):
                new[k] += unit[k * n + chosen[i]] * found[i]
    for k in range(n):
        new_force = constant[k] + new[k]
        largest = max(largest, abs(new_force - forces[k]))
        forces[k] = new_force
    return is_same and largest <= SETTLED * size


def find_followers(
    p: ForceProblem, forces: Array, closed: Integers, unit: Array, constant: Array, held: Integers
) -> int:  # fmt: skip
    """Let all forces be `unit` (n, n) times those of the normal rows and of the `held` ones, and `constant` (n,).

    There is no friction at normal rows that are not `closed`.

    :return: the number of the rows that are held.
    """
    n, rates, count, trial, loaded, limit = p.n, zeros(p.n), 0, zeros(p.n), False, 0.0
    slow, rows, row, length = SLIPS * SOFTNESS * (1.0 + largest_of(p.n, forces)), p.friction_rows, 0, 0.0
    rates_of(p, forces, rates)
    for i in range(n):
        trial[i] = forces[i] - rates[i]
    for i in range(p.normals):
        unit[p.normal_rows[i] * n + p.normal_rows[i]] = 1.0
    for k in range(p.frictions):
        loaded = p.loads[k] >= 0
        if loaded and not closed[p.loads[k]]:
            continue
        limit = p.sizes[k] * (forces[p.loads[k]] if loaded else 1.0)
        length = length_of(rows, k, trial)
        at_rest = length < limit * (1.0 - UNPRESSED) or not (length_of(rows, k, rates) > slow or not loaded)
        for direction in range(2):
            row = rows[2 * k + direction]
            if row >= 0 and at_rest:
                held[count] = row
                count += 1
                unit[row * n + row] = 1.0
            elif row >= 0 and length > 0.0 and not loaded:
                constant[row] = trial[row] * (limit / length)
            elif row >= 0 and length > 0.0:
                unit[row * n + p.loads[k]] = trial[row] * (p.sizes[k] / length)
    return count


def press(
    p: ForceProblem, compliance: Array, matrix: Array, free: Array, count: int, chosen: Integers, number: int,
    size: float, pressed: Integers, closed: Integers, found: Array,
) -> bool:  # fmt: skip
    """The least forces of the chosen rows, and which contacts are to be pressed then; whether these are the same.

    :param number: of the chosen rows, that are normal ones.
    """
    n, own, turned, side, weights = p.n, zeros(count * count), zeros(count * count), zeros(count), zeros(count)
    loads, duals, pulls, is_same, gain, open_before = zeros(count), zeros(count), False, True, 0.0, integers(p.n)
    take_block(n, matrix, count, chosen, own)
    for i in range(count):
        side[i], weights[i] = -free[chosen[i]], compliance[chosen[i]]
        for j in range(count):
            turned[j * count + i] = own[i * count + j]
    least_solution(count, own, side, weights, found)
    for i in range(count):
        loads[i] = weights[i] * found[i]
    solve(count, turned, loads, duals)
    for i in range(p.normals):
        open_before[p.normal_rows[i]] = not pressed[p.normal_rows[i]]
    for i in range(number):
        if found[i] < -UNPRESSED * size:
            pressed[chosen[i]] = 0
            pulls, is_same = True, False
    for i in range(0 if pulls else p.normals):
        row = p.normal_rows[i]
        if closed[row] and open_before[row]:
            gain = 0.0
            for k in range(count):
                if duals[k] != 0.0:
                    gain += matrix[chosen[k] * n + row] * duals[k]
            if gain > UNPRESSED * size:
                pressed[row] = 1
                is_same = False
    return is_same
