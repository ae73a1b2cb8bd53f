"""The impulses of an impact where they are unique, in the subset of Python that is compiled.

See `mbd_sim.simulation.contact.impact` for the law.
"""

from __future__ import annotations

from mbd_sim.compiler.ir.python_kinds import Array, Integers, integers, zeros
from mbd_sim.simulation.contact.compiled.instant.candidate_forces import free_acceleration
from mbd_sim.simulation.contact.compiled.instant.contacts import (
    READ_INPUTS,
    READ_RESPONSE,
    Contacts,
    force_at,
    rate_at,
)
from mbd_sim.simulation.contact.compiled.instant.forces import ForceProblem
from mbd_sim.simulation.contact.compiled.instant.islands import unique_forces
from mbd_sim.simulation.contact.compiled.instant.linear import null_space, solve
from mbd_sim.simulation.contact.compiled.instant.modes import RESTING

GAIN = 1e-13  # of the kinetic energy that is exchanged, up to which a gain is round-off
JAMMED = 1e11  # of the natural mass times the approach speed, impulse from which on it divides by round-off
SMALL = 1e4  # times the energy of rows by themselves that may be lost where they come to rest
ELASTIC_REST = 1e-9  # of the natural speed, the approach speed below which even an elastic contact closes


def impact(
    c: Contacts, t: float, y: Array, inputs: Array, readings: Array, terms: Array, touching: Integers,
    returning: Integers, elastic: bool, rest: float, impulses: Array, u_change: Array, loss: Array,
) -> bool:  # fmt: skip
    """The `impulses` (rows,), the change of u, and the `loss` of energy; False where they are not simple to find.

    :param terms: see `read_terms`.
    :param touching: 1 for gaps (gaps,) that take part.
    :param returning: 1 for gaps that open so slowly that they close again before they differ from zero.
    :param elastic: False: nothing rebounds.
    :param rest: approach speed in m/s below which a contact does not rebound.
    """
    e, time = zeros(c.gaps), zeros(1)
    READ_INPUTS(c.restitution, inputs, e)
    slowly, is_resting = True, False
    for gap in range(c.gaps):
        if touching[gap]:
            rate = readings[rate_at(c, gap)]
            slowly = slowly and rate >= -slow_of(c, e, rest, gap)
            is_resting = is_resting or abs(rate) <= slow_of(c, e, rest, gap) or returning[gap] != 0
    if slowly and is_resting:
        found = resting_impulses(c, readings, terms, e, rest, touching, returning, impulses, loss)
    else:
        found = rebound(c, readings, terms, e, touching, elastic, rest, impulses, loss)
    if not found or is_jammed(c, readings, touching, impulses):
        return False
    time[0] = t
    READ_RESPONSE(c.response, time, y, inputs, impulses, u_change)
    loss[0] = max(loss[0], 0.0)
    return True


def return_at_once(
    c: Contacts, inputs: Array, readings: Array, terms: Array, touching: Integers, returning: Integers
) -> bool:  # fmt: skip
    """Whether gaps that an impact has opened are pressed back before they differ from zero; they are `returning` then.

    Only these and closed gaps remain `touching`.

    :param readings: after the impact, with the modes found.
    """
    found = False
    for gap in range(c.gaps):
        returning[gap] = 0
        if not touching[gap]:
            continue
        rate, acceleration = readings[rate_at(c, gap)], free_acceleration(c, terms, gap)
        for row in range(c.rows):
            acceleration += terms[gap + row * c.rows] * readings[force_at(c, row)]
        highest = -2.0 * acceleration * c.tolerance * c.gap_units[gap]
        is_open = inputs[c.first_mode + gap] == 0.0 and not c.clutches[gap]
        slowest = RESTING * c.row_speeds[gap]
        returning[gap] = touching[gap] and is_open and rate > slowest and rate * rate <= highest
        touching[gap] = touching[gap] and (not is_open or returning[gap])
        found = found or returning[gap] != 0
    return found


def is_jammed(c: Contacts, readings: Array, touching: Integers, impulses: Array) -> bool:
    """Whether an impulse is so large that it only divides by round-off: a drive presses where nothing can yield."""
    fastest, largest = 0.0, 0.0
    for gap in range(c.gaps):
        if touching[gap]:
            fastest = max(fastest, abs(readings[rate_at(c, gap)]) / c.row_speeds[gap])
    for row in range(c.rows):
        largest = max(largest, abs(impulses[row]) * c.unit_rate / c.row_loads[row])
    return largest > JAMMED * fastest


def slow_of(c: Contacts, e: Array, rest: float, gap: int) -> float:
    """The approach speed below which a gap closes without a rebound."""
    return ELASTIC_REST * c.row_speeds[gap] if e[gap] == 1.0 else rest * c.row_speeds[gap] / c.unit_speed


def sliding_size(c: Contacts, terms: Array, element: int) -> float:
    """The size of sliding friction of an element, see `read_terms`."""
    return terms[c.rows * (c.rows + 1) + element]


def resting_impulses(
    c: Contacts, readings: Array, terms: Array, e: Array, rest: float, touching: Integers, returning: Integers,
    impulses: Array, loss: Array,
) -> bool:  # fmt: skip
    """What brings the rates of all these rows to zero; so infinitely many impacts end.

    A block that rocks on its edges rebounds without restitution, from one edge to the other.
    """
    chosen, count = integers(c.rows), 0
    for gap in range(c.gaps):
        if touching[gap] and (abs(readings[rate_at(c, gap)]) <= slow_of(c, e, rest, gap) or returning[gap]):
            chosen[count] = gap
            count += 1
    resting = count
    for k in range(c.frictions):
        gap = c.friction_gaps[k]
        if gap < 0 or not touching[gap] or not sliding_size(c, terms, k) > 0.0:
            continue
        for position in range(resting):
            if chosen[position] == gap:
                for direction in range(2):
                    row = c.friction_rows[2 * k + direction]
                    if row >= 0 and abs(readings[rate_at(c, row)]) <= rest * c.row_speeds[row] / c.unit_speed:
                        chosen[count] = row
                        count += 1
    matrix, right, found, basis = zeros(count * count), zeros(count), zeros(count), zeros(count * count)
    for i in range(count):
        right[i] = -readings[rate_at(c, chosen[i])]
        for j in range(count):
            matrix[i * count + j] = terms[chosen[i] + chosen[j] * c.rows]
    if null_space(count, count, matrix, basis) > 0:
        return False
    solve(count, matrix, right, found)
    total = 0.0
    for i in range(count):
        impulses[chosen[i]] = found[i]
        total += found[i] * right[i]
    loss[0] = 0.5 * total
    return is_small(c, readings, terms, rest, count, chosen, loss[0]) and is_rest(
        c, readings, count, chosen, matrix, found
    )


def is_small(
    c: Contacts, readings: Array, terms: Array, rest: float, count: int, chosen: Integers, loss: float
) -> bool:  # fmt: skip
    """Whether rows can come to rest without stopping far faster motions; some may nearly depend on each other."""
    slow = 0.0
    for i in range(count):
        row = chosen[i]
        speed = max(abs(readings[rate_at(c, row)]), rest * c.row_speeds[row] / c.unit_speed)
        slow += 0.5 * speed * speed / terms[row + row * c.rows]
    return not loss > SMALL * slow


def is_rest(c: Contacts, readings: Array, count: int, chosen: Integers, matrix: Array, impulses: Array) -> bool:
    """Whether impulses (count,) bring the chosen rows to rest."""
    after = 0.0
    for i in range(count):
        after = readings[rate_at(c, chosen[i])]
        for j in range(count):
            after += matrix[i * count + j] * impulses[j]
        if abs(after) > RESTING * c.row_speeds[chosen[i]]:
            return False
    return True


def rebound(
    c: Contacts, readings: Array, terms: Array, e: Array, touching: Integers, elastic: bool,
    rest: float, impulses: Array, loss: Array,
) -> bool:  # fmt: skip
    """The impulses of gaps that approach, with their friction."""
    chosen, count, place = integers(c.rows), 0, integers(c.rows)
    normal_rows, friction_rows, gaps, sizes = (
        integers(c.gaps), integers(2 * c.frictions), integers(c.frictions), zeros(c.frictions)
    )  # fmt: skip
    for gap in range(c.gaps):
        if touching[gap]:
            chosen[count], normal_rows[count], place[gap] = gap, count, count
            count += 1
    normals, frictions = count, 0
    for k in range(c.frictions):
        gap = c.friction_gaps[k]
        if gap < 0 or not touching[gap] or not sliding_size(c, terms, k) > 0.0:
            continue
        friction_rows[2 * frictions + 1] = -1
        for direction in range(2):
            row = c.friction_rows[2 * k + direction]
            if row >= 0:
                chosen[count], friction_rows[2 * frictions + direction] = row, count
                count += 1
        gaps[frictions], sizes[frictions] = place[gap], sliding_size(c, terms, k)
        frictions += 1
    matrix, before, free, found = zeros(count * count), zeros(count), zeros(count), zeros(count)
    for i in range(count):
        before[i] = readings[rate_at(c, chosen[i])]
        free[i] = before[i]
        for j in range(count):
            matrix[i * count + j] = terms[chosen[i] + chosen[j] * c.rows]
    for i in range(normals):
        approach = min(before[i], 0.0)
        restitution = 0.0 if -approach < slow_of(c, e, rest, chosen[i]) else e[chosen[i]]
        free[i] += restitution * (1.0 if elastic else 0.0) * approach
    problem = ForceProblem(count, matrix, free, normals, normal_rows, frictions, friction_rows, gaps, sizes)
    if not unique_forces(problem, found):
        return False
    loss[0] = lost_energy(count, matrix, before, found)
    exchanged = 0.0
    for i in range(count):
        exchanged += abs(found[i] * before[i])
        impulses[chosen[i]] = found[i]
    return not loss[0] < -GAIN * (0.5 * exchanged)


def lost_energy(n: int, matrix: Array, before: Array, impulses: Array) -> float:
    """The energy that impulses dissipate."""
    after, total = zeros(n), 0.0
    for i in range(n):
        after[i] = before[i]
    for j in range(n):
        for i in range(n):
            after[i] += matrix[i * n + j] * impulses[j]
    for i in range(n):
        total += impulses[i] * (before[i] + after[i])
    return -0.5 * total
