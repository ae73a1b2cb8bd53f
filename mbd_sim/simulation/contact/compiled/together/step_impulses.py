"""The impulses of a step of time stepping, in the subset of Python that is compiled.

See `mbd_sim.simulation.contact.time_stepping.impulses` for the laws.
"""

from __future__ import annotations

from dataclasses import dataclass

from mbd_sim.compiler.ir.python_kinds import Array, Integers, integers, zeros
from mbd_sim.simulation.contact.compiled.instant.candidate_forces import length_along, load_of
from mbd_sim.simulation.contact.compiled.instant.contacts import Contacts
from mbd_sim.simulation.contact.compiled.instant.forces import ForceProblem
from mbd_sim.simulation.contact.compiled.instant.impact import GAIN, slow_of
from mbd_sim.simulation.contact.compiled.instant.modes import RESTING
from mbd_sim.simulation.contact.compiled.together.step_forces import nearest_forces

LOAD_ITERATIONS, SETTLED = 200, 1e-12  # until the loads of joints do not change any more, relative to the largest


@dataclass(frozen=True)
class StepContacts:
    """The contacts of a step of some `length` in s, and their impulses.

    The configuration in which these act has `terms`: accelerations (rows,), and sizes of sliding and then of static
    friction; the `matrix` (count, count), column by column, of those `rows` that can act, which have some `places`
    (all rows,) among these; and the `joint_loads`. `before` are the rates (rows,) at the start of the step, and `free`
    those at its end without impulses. The gaps that are `closing` are 1; `hits` approach faster than contacts at rest.
    The `impulses` (rows,), the `rates` (rows,) at the end with these and the `losses` (2,) in J at gaps and by friction
    are found.
    """

    length: float
    terms: Array
    matrix: Array
    count: int
    rows: Integers
    places: Integers
    joint_loads: Array
    before: Array
    free: Array
    closing: Integers
    hits: Integers
    impulses: Array
    rates: Array
    losses: Array


def find_impulses(c: Contacts, s: StepContacts, e: Array) -> bool:
    """The impulses and what follows from them; False where they are not simple to find.

    :param e: the coefficients of restitution (gaps,).
    """
    n, right, exchanged, rebounds = c.rows, zeros(c.rows), 0.0, False
    for row in range(n):
        right[row] = s.free[row]
    for gap in range(c.gaps):
        s.hits[gap] = s.closing[gap] and s.before[gap] < -slow_of(c, e, c.rest_speed, gap)
        if s.hits[gap]:
            right[gap] += e[gap] * s.before[gap]
            rebounds = rebounds or e[gap] != 0.0
    if not solve(c, s, right):
        return False
    for j in range(s.count):
        for i in range(s.count if s.impulses[s.rows[j]] != 0.0 else 0):
            s.rates[s.rows[i]] += s.matrix[i + j * s.count] * s.impulses[s.rows[j]]
    for row in range(n):
        s.rates[row] += s.free[row]
        s.losses[0 if row < c.gaps else 1] += -0.5 * s.impulses[row] * (s.before[row] + s.rates[row])
        exchanged += abs(s.impulses[row] * s.before[row])
    return not (rebounds and s.losses[0] + s.losses[1] < -GAIN * (0.5 * exchanged))


def mark_rows(c: Contacts, closing: Integers, marks: Array, rows: Integers, places: Integers) -> int:
    """Mark the rows that can act, and list them, with their places in the list; how many they are."""
    count = 0
    for gap in range(c.gaps):
        marks[gap] = 1.0 if closing[gap] else 0.0
    for k in range(c.frictions):
        gap = c.friction_gaps[k]
        for direction in range(2 if gap < 0 or closing[gap] else 0):
            if c.friction_rows[2 * k + direction] >= 0:
                marks[c.friction_rows[2 * k + direction]] = 1.0
    for row in range(c.rows):
        if marks[row] != 0.0:
            rows[count], places[row] = row, count
            count += 1
    return count


def size_of(c: Contacts, s: StepContacts, element: int, static: int) -> float:
    """The size of sliding friction, or of static friction."""
    return s.terms[c.rows + static * c.frictions + element]


def takes_part(c: Contacts, s: StepContacts, element: int) -> bool:
    """Whether friction can act in the step."""
    gap = c.friction_gaps[element]
    if gap >= 0 and not s.closing[gap]:
        return False
    return max(size_of(c, s, element, 0), size_of(c, s, element, 1)) > 0.0


def solve(c: Contacts, s: StepContacts, right: Array) -> bool:
    """The impulses for rates (rows,) without them that include restitution; False where they are not simple to find."""
    count, normals, frictions = 0, 0, 0
    chosen, place, normal_rows = integers(c.rows), integers(c.rows), integers(c.gaps)
    elements, friction_rows, gaps = integers(c.frictions), integers(2 * c.frictions), integers(c.frictions)
    for gap in range(c.gaps):
        if s.closing[gap]:
            chosen[count], normal_rows[count], place[gap] = gap, count, count
            count += 1
    normals = count
    for k in range(c.frictions):
        if not takes_part(c, s, k):
            continue
        friction_rows[2 * frictions + 1] = -1
        for direction in range(2):
            row = c.friction_rows[2 * k + direction]
            if row >= 0:
                chosen[count], friction_rows[2 * frictions + direction] = row, count
                count += 1
        elements[frictions], gaps[frictions] = k, -1
        if c.friction_gaps[k] >= 0:
            gaps[frictions] = place[c.friction_gaps[k]]
        frictions += 1
    matrix, own, compliance, sizes = zeros(count * count), zeros(count), zeros(count), zeros(frictions)
    for i in range(count):
        own[i], compliance[i] = right[chosen[i]], c.stepping.compliance[chosen[i]]
        for j in range(count):
            matrix[i * count + j] = s.matrix[s.places[chosen[i]] + s.places[chosen[j]] * s.count]
    problem = ForceProblem(count, matrix, own, normals, normal_rows, frictions, friction_rows, gaps, sizes)
    return solve_with_loads(c, s, problem, chosen, elements, compliance)


def solve_with_loads(
    c: Contacts, s: StepContacts, p: ForceProblem, chosen: Integers, elements: Integers, compliance: Array
) -> bool:
    """The impulses, and the loads of joints that follow from them; False where they are not simple to find."""
    known, found, is_zero = zeros(c.frictions), zeros(p.n), True
    for iteration in range(LOAD_ITERATIONS if c.loaded else 1):
        change, largest = 0.0, 0.0
        for k in range(c.frictions):
            if c.friction_loads[k] >= 0:
                load = load_in_step(c, s, k)
                change = max(change, abs(load - known[k]))
                largest = max(largest, load)
                known[k] = load
        if iteration > 0 and not is_zero and change <= SETTLED * largest:
            return True
        for position in range(p.frictions):
            p.sizes[position] = limit_of(c, s, elements[position], known)
        if not nearest_forces(p, compliance, found):
            return False
        is_zero = True
        for i in range(p.n):
            s.impulses[chosen[i]] = found[i]
            is_zero = is_zero and found[i] == 0.0
    return True


def load_in_step(c: Contacts, s: StepContacts, element: int) -> float:
    """What a joint transmits in the step, in N·s, but for what impacts do: no friction belongs to that."""
    steady = zeros(c.rows)
    for row in range(c.rows):
        is_hit = s.hits[row] if row < c.gaps else 0
        steady[row] = 0.0 if is_hit else s.impulses[row] / s.length
    return s.length * load_of(c, s.joint_loads, element, steady)


def limit_of(c: Contacts, s: StepContacts, element: int, loads: Array) -> float:
    """The limit of friction: that of friction at rest where it does not slip at the start of the step."""
    first = c.friction_rows[2 * element]
    at_rest = length_along(c, element, s.before) <= c.rest_speed * c.row_speeds[first] / c.unit_speed
    size = size_of(c, s, element, 1 if at_rest else 0)
    if c.friction_gaps[element] >= 0:
        return size
    return size * (loads[element] if c.friction_loads[element] >= 0 else s.length)


def slip_of(c: Contacts, s: StepContacts, element: int) -> float:
    """The speed with which friction slips at the end of a step; 0 where it sticks."""
    speed = length_along(c, element, s.rates)
    return speed if speed > RESTING * c.row_speeds[c.friction_rows[2 * element]] else 0.0
