"""The modes of contacts where their forces are unique, in the subset of Python that is compiled.

See `mbd_sim.simulation.contact.candidates`, which also knows friction that others hold, loads of joints, and contacts
that share their forces.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from mbd_sim.compiler.ir.python_functions import Array, Integers, integers, zeros
from mbd_sim.dynamics.contact.one_sided_equations import RELEASED
from mbd_sim.simulation.contact.compiled.contacts import (
    READ,
    Contacts,
    active_at,
    direction_at,
    force_at,
    rate_at,
    read,
    readings_size,
    slides,
)
from mbd_sim.simulation.contact.compiled.forces import ForceProblem, unique_forces
from mbd_sim.simulation.contact.compiled.linear import best_conditioned, independent, pivots, unit_diagonal

RESTING = 1e-10  # of the natural speed, up to which a speed counts as zero
STOPPED = 1e-8  # of the natural speed, up to which slip along two directions counts as zero: it turns ever faster
UNMOVED = 1e-9  # acceleration, relative to those without contact forces, that counts as zero
AT_LIMIT = 1.0 - 1e-9  # use of its limit, from which on friction at rest has reached it
OVERLOAD = 1e-9  # of the largest force, that friction may exceed its limit by
ATTEMPTS = 20
ABSENT, STICKING, SLIDING_ON, FREE = 0, 1, 2, 3  # states of friction: FREE has neither slip nor capacity


@dataclass(frozen=True)
class Search:
    """What is known while modes are sought.

    `touching` (gaps,) rest on each other. The gaps in `open` open, `yielding` and `overloaded` friction slides: see
    `mbd_sim.simulation.contact.candidates.Forced`. `terms`: see `read_terms`. `states` (frictions,) are those of
    friction, with the `directions` (rows,) of what slides; that are the elements in `order` from 1 on, as many as
    `order` 0 says. `forces` and `rates` (rows,) are found, and `unmoved` (rows,) are the accelerations that count as
    zero. `coupled` (rows, rows) is A with the friction of what slides.
    """

    touching: Integers
    open: Integers
    yielding: Integers
    overloaded: Integers
    terms: Array
    states: Integers
    directions: Array
    order: Integers
    forces: Array
    rates: Array
    unmoved: Array
    coupled: Array


def read_terms(c: Contacts, t: float, y: Array, inputs: Array, terms: Array) -> None:
    """A (rows, rows) column by column, accelerations (rows,), sizes of sliding and then of static friction."""
    time = zeros(1)
    time[0] = t
    READ(c.terms, time, y, inputs, terms)


def terms_size(c: Contacts) -> int:
    """The numbers of `read_terms`."""
    return c.rows * (c.rows + 1) + 2 * c.frictions


def free_acceleration(c: Contacts, terms: Array, row: int) -> float:
    """The acceleration of a row without contact forces."""
    return terms[c.rows * c.rows + row]


def friction_size(c: Contacts, terms: Array, element: int, static: int) -> float:
    """The size of sliding friction, or of static friction."""
    return terms[c.rows * (c.rows + 1) + static * c.frictions + element]


def length_along(c: Contacts, element: int, values: Array) -> float:
    """The length of the part of a vector (rows,) along the rows of a friction element."""
    first, second = values[c.friction_rows[2 * element]], c.friction_rows[2 * element + 1]
    if second < 0:
        return math.sqrt(first * first)
    return math.sqrt(first * first + values[second] * values[second])


def is_touching(c: Contacts, readings: Array, gap: int) -> bool:
    """Whether a gap is zero; for a clutch, whether it does not slip."""
    limit = RESTING if c.clutches[gap] else c.tolerance
    return readings[1 + gap] <= limit * c.gap_units[gap]


def find_modes(
    c: Contacts, t: float, y: Array, inputs: Array, readings: Array, terms: Array,
    opening: Integers, yielding: Integers,
) -> bool:  # fmt: skip
    """Write the modes at a state without approaching contacts into the inputs; False where they are not simple to find.

    :param opening: 1 for gaps that are to open.
    :param yielding: 1 for friction that has reached its limit.
    """
    n, largest = c.rows, 0.0
    s = Search(
        integers(c.gaps), integers(c.gaps), yielding, integers(c.frictions), terms, integers(c.frictions), zeros(n),
        integers(c.frictions + 1), zeros(n), zeros(n), zeros(n), zeros(n * n),
    )  # fmt: skip
    for gap in range(c.gaps):
        is_resting = readings[rate_at(c, gap)] <= RESTING * c.row_speeds[gap]
        s.touching[gap] = is_touching(c, readings, gap) and is_resting
        s.open[gap] = opening[gap]
    for row in range(n):
        s.unmoved[row] = c.row_speeds[row] * c.unit_rate
        largest = max(largest, abs(free_acceleration(c, terms, row)) / s.unmoved[row])
    for row in range(n):
        s.unmoved[row] = UNMOVED * s.unmoved[row] * (1.0 + largest)
    for _ in range(ATTEMPTS):
        begin(c, s, readings)
        if not settle(c, s):
            return False
        release(c, s)
        if withdrawn(c, s):
            continue
        if not write_modes(c, s, inputs):
            return False
        if not overload(c, s, t, y, inputs):
            return True
    return False


def begin(c: Contacts, s: Search, readings: Array) -> None:
    """The states of friction before any force is known."""
    s.order[0] = 0
    for k in range(c.frictions):
        gap, first = c.friction_gaps[k], c.friction_rows[2 * k]
        s.states[k] = ABSENT
        if gap >= 0 and not s.touching[gap]:
            continue
        speed = length_along(c, k, readings[rate_at(c, 0) :])
        single = c.friction_rows[2 * k + 1] < 0
        if speed > (RESTING if single else STOPPED) * c.row_speeds[first]:
            slide(c, s, k, readings[rate_at(c, 0) :], speed)
        elif friction_size(c, s.terms, k, 1) > 0.0 and (gap < 0 or not s.open[gap]):
            s.states[k] = STICKING
        elif gap < 0:
            s.states[k] = FREE


def slide(c: Contacts, s: Search, element: int, along: Array, length: float) -> None:
    """Let friction slide along a vector (rows,) of this length, or against it if the length is negative."""
    s.states[element] = SLIDING_ON
    s.order[0] += 1
    s.order[s.order[0]] = element
    for direction in range(2):
        row = c.friction_rows[2 * element + direction]
        if row >= 0:
            s.directions[row] = along[row] / length


def settle(c: Contacts, s: Search) -> bool:
    """Let friction slide that cannot stick, until none is left; False where that is not simple."""
    for _ in range(ATTEMPTS):
        if not find_forces(c, s):
            return False
        slips = False
        for k in range(c.frictions):
            if s.states[k] == STICKING and begins_to_slide(c, s, k):
                slips = True
        if not slips and reaches_limits(c, s):
            if not is_independent(c, s):
                return False
            for k in range(c.frictions):
                if s.states[k] == STICKING and is_at_limit(c, s, k) and (s.yielding[k] or s.overloaded[k]):
                    s.states[k] = -SLIDING_ON
                    slips = True
        elif slips:
            if not is_determined(c, s):
                return False
            for k in range(c.frictions):
                if s.states[k] == STICKING and begins_to_slide(c, s, k):
                    s.states[k] = -SLIDING_ON
        if not slips:
            return True
        for k in range(c.frictions):
            if s.states[k] == -SLIDING_ON:
                size = length_along(c, k, s.forces)
                if size > 0.0:
                    slide(c, s, k, s.forces, -size)
                else:
                    slide(c, s, k, s.rates, length_along(c, k, s.rates))
    return True


def limit_of(c: Contacts, s: Search, element: int) -> float:
    """The limit of an element's friction at rest."""
    gap = c.friction_gaps[element]
    return friction_size(c, s.terms, element, 1) * (1.0 if gap < 0 else s.forces[gap])


def begins_to_slide(c: Contacts, s: Search, element: int) -> bool:
    """Whether friction that is to stick moves, at its limit."""
    if not length_along(c, element, s.forces) >= limit_of(c, s, element) * AT_LIMIT:
        return False
    return length_along(c, element, s.rates) > s.unmoved[c.friction_rows[2 * element]]


def is_at_limit(c: Contacts, s: Search, element: int) -> bool:
    """Whether friction at rest bears as much as it can."""
    limit = limit_of(c, s, element)
    use = length_along(c, element, s.forces) / limit if limit > 0.0 else 0.0
    return s.overloaded[element] != 0 or use >= AT_LIMIT


def reaches_limits(c: Contacts, s: Search) -> bool:
    """Whether some friction at rest is at its limit."""
    return any(s.states[k] == STICKING and is_at_limit(c, s, k) for k in range(c.frictions))


def unknown_rows(c: Contacts, s: Search, chosen: Integers, pressed: bool) -> int:
    """The gaps that can be closed, or only those with a force, then the rows of friction at rest; their number."""
    count = 0
    for gap in range(c.gaps):
        if s.touching[gap] and not s.open[gap] and (not pressed or s.forces[gap] > 0.0):
            chosen[count] = gap
            count += 1
    for k in range(c.frictions):
        if s.states[k] == STICKING:
            for direction in range(2):
                row = c.friction_rows[2 * k + direction]
                if row >= 0:
                    chosen[count] = row
                    count += 1
    return count


def is_determined(c: Contacts, s: Search) -> bool:
    """Whether forces are independent beside the friction that slides."""
    n, chosen, order = c.rows, integers(c.rows), integers(c.rows)
    count = unknown_rows(c, s, chosen, True)
    matrix = zeros(count * count)
    for i in range(count):
        for j in range(count):
            matrix[i * count + j] = s.coupled[chosen[i] * n + chosen[j]]
    return pivots(count, matrix, order) == count


def is_independent(c: Contacts, s: Search) -> bool:
    """Whether all that bears a force is independent, and friction at rest for itself: nothing is shared or held."""
    n, chosen, found, order = c.rows, integers(c.rows), integers(c.rows), integers(c.rows)
    matrix, own, factors = zeros(n * n), zeros(n * n), zeros(n)
    for i in range(n):
        for j in range(n):
            matrix[i * n + j] = s.terms[i + j * n]
    count = unknown_rows(c, s, chosen, True)
    if independent(n, matrix, count, chosen, found) < count:
        return False
    pressed = 0
    while pressed < count and chosen[pressed] < c.gaps:
        pressed += 1
    frictions = count - pressed
    for i in range(frictions):
        for j in range(frictions):
            own[i * frictions + j] = matrix[chosen[pressed + i] * n + chosen[pressed + j]]
    unit_diagonal(frictions, own, factors)
    return is_determined(c, s) and pivots(frictions, own, order) == frictions


def find_forces(c: Contacts, s: Search) -> bool:
    """λ (rows,) of all rows, and the accelerations (rows,) with them; False where they are not simple to find."""
    n = c.rows
    free, unit, constant = zeros(n), zeros(n * n), zeros(n)
    chosen, place = integers(n), integers(n)
    for i in range(n):
        free[i] = free_acceleration(c, s.terms, i)
        unit[i * n + i] = 1.0
        for j in range(n):
            s.coupled[i * n + j] = s.terms[i + j * n]
    add_sliding(c, s, free, unit, constant)
    count = unknown_rows(c, s, chosen, False)
    matrix, own, found = zeros(count * count), zeros(count), zeros(count)
    normal_rows, rows, loads, sizes = integers(n), integers(2 * c.frictions), integers(c.frictions), zeros(c.frictions)
    normals, frictions = 0, 0
    for i in range(count):
        place[chosen[i]] = i
        own[i] = free[chosen[i]]
        if chosen[i] < c.gaps:
            normal_rows[normals] = i
            normals += 1
        for j in range(count):
            matrix[i * count + j] = s.coupled[chosen[i] * n + chosen[j]]
    for k in range(c.frictions):
        if s.states[k] == STICKING:
            gap, second = c.friction_gaps[k], c.friction_rows[2 * k + 1]
            rows[2 * frictions] = place[c.friction_rows[2 * k]]
            rows[2 * frictions + 1] = -1 if second < 0 else place[second]
            loads[frictions] = -1 if gap < 0 else place[gap]
            sizes[frictions] = friction_size(c, s.terms, k, 1)
            frictions += 1
    if not unique_forces(ForceProblem(count, matrix, own, normals, normal_rows, frictions, rows, loads, sizes), found):
        return False
    for i in range(n):
        s.forces[i] = constant[i]
        s.rates[i] = free[i]
    for j in range(count):
        for i in range(n):
            s.forces[i] += unit[i * n + chosen[j]] * found[j]
            s.rates[i] += s.coupled[i * n + chosen[j]] * found[j]
    return True


def add_sliding(c: Contacts, s: Search, free: Array, unit: Array, constant: Array) -> None:
    """Add the friction of what slides, to accelerations and to what follows a normal force."""
    n = c.rows
    for position in range(s.order[0]):
        k = s.order[1 + position]
        gap, size = c.friction_gaps[k], friction_size(c, s.terms, k, 0)
        for direction in range(2):
            row = c.friction_rows[2 * k + direction]
            if row >= 0 and gap < 0:
                force = -size * s.directions[row]
                constant[row] += force
                for i in range(n):
                    free[i] += s.terms[i + row * n] * force
            elif row >= 0:
                force = size * s.directions[row]
                unit[row * n + gap] -= force
                for i in range(n):
                    s.coupled[i * n + gap] -= s.terms[i + row * n] * force


def release(c: Contacts, s: Search) -> None:
    """Let friction without capacity slide that is accelerated."""
    for k in range(c.frictions):
        if s.states[k] == FREE:
            change = length_along(c, k, s.rates)
            if change > s.unmoved[c.friction_rows[2 * k]]:
                slide(c, s, k, s.rates, change)


def withdrawn(c: Contacts, s: Search) -> bool:
    """Whether a gap that was to open would close; it is not to open any more then."""
    for gap in range(c.gaps):
        if s.open[gap] and s.touching[gap] and s.rates[gap] < -s.unmoved[gap]:
            s.open[gap] = 0
            return True
    return False


def write_modes(c: Contacts, s: Search, inputs: Array) -> bool:
    """Write the modes into the inputs; False where contacts share their forces."""
    n, count = c.rows, 0
    matrix, closed, found = zeros(n * n), integers(n), integers(n)
    for i in range(n):
        for j in range(n):
            matrix[i * n + j] = s.terms[i + j * n]
    for i in range(c.first_feature):
        inputs[c.first_mode + i] = 0.0
    for gap in range(c.gaps):
        if s.touching[gap] and not s.open[gap] and (s.forces[gap] > 0.0 or abs(s.rates[gap]) <= s.unmoved[gap]):
            closed[count] = gap
            count += 1
    rank, was_closed = independent(n, matrix, count, closed, found), count
    for gap in range(c.gaps):
        if s.open[gap] and s.touching[gap] and abs(s.rates[gap]) <= s.unmoved[gap]:
            closed[was_closed] = gap  # held by the closed ones?
            if independent(n, matrix, was_closed + 1, closed, found) == rank:
                return False
    for i in range(count):
        inputs[c.first_mode + closed[i]] = 1.0
    if not activate(c, s, matrix, count, closed, inputs):
        return False
    for k in range(c.frictions):
        gap, first = c.friction_gaps[k], c.friction_rows[2 * k]
        if s.states[k] == FREE:
            inputs[direction_at(c, first)] = RELEASED
        if s.states[k] == SLIDING_ON and (gap < 0 or inputs[c.first_mode + gap] != 0.0):
            for direction in range(2):
                row = c.friction_rows[2 * k + direction]
                if row >= 0:
                    inputs[direction_at(c, row)] = s.directions[row]
    return True


def activate(c: Contacts, s: Search, matrix: Array, count: int, rows: Integers, inputs: Array) -> bool:
    """Write which rows are solved for: all that bear a force, and independent ones without.

    :param rows: (rows,) of which the first `count` are the closed gaps.
    """
    n, shares, bearing, others = c.rows, 0, integers(c.rows), integers(c.rows)
    basis, found, rest = integers(c.rows), integers(c.rows), 0
    for i in range(count):
        if s.forces[rows[i]] != 0.0:
            bearing[shares] = rows[i]
            shares += 1
        else:
            others[rest] = rows[i]
            rest += 1
    for k in range(c.frictions):
        gap = c.friction_gaps[k]
        if s.states[k] != STICKING or (gap >= 0 and inputs[c.first_mode + gap] == 0.0):
            continue
        for direction in range(2):
            row = c.friction_rows[2 * k + direction]
            if row >= 0 and (s.forces[row] != 0.0 or limit_of(c, s, k) != 0.0):
                bearing[shares] = row
                shares += 1
            elif row >= 0:
                others[rest] = row
                rest += 1
    rank = best_conditioned(n, matrix, shares, bearing, basis)
    if rank < shares:
        return False
    if rest > 0:
        for i in range(rest):
            basis[rank + i] = others[i]
        rank = independent(n, matrix, rank + rest, basis, found)
        for i in range(rank):
            basis[i] = found[i]
        for i in range(shares):
            missing = True
            for j in range(rank):
                missing = missing and basis[j] != bearing[i]
            if missing:
                return False
    for i in range(rank):
        inputs[active_at(c, basis[i])] = 1.0
    return True


def overload(c: Contacts, s: Search, t: float, y: Array, inputs: Array) -> bool:
    """Whether sticking elements carry more than they can; they are remembered."""
    found, size, readings = False, 0.0, zeros(readings_size(c))
    read(c, t, y, inputs, readings)
    for row in range(c.rows):
        size = max(size, abs(readings[force_at(c, row)]) / c.row_loads[row])
    for k in range(c.frictions):
        first, second, gap = c.friction_rows[2 * k], c.friction_rows[2 * k + 1], c.friction_gaps[k]
        is_active = inputs[active_at(c, first)] != 0.0
        if second >= 0:
            is_active = is_active or inputs[active_at(c, second)] != 0.0
        if not is_active or slides(c, inputs, k):
            continue
        force = length_along(c, k, readings[force_at(c, 0) :])
        load = 1.0 if gap < 0 else readings[force_at(c, gap)]
        scale = c.row_loads[first] * (1.0 + size)
        if force > friction_size(c, s.terms, k, 1) * load + OVERLOAD * scale:
            s.overloaded[k] = 1
            found = True
    return found
