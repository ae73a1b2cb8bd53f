"""Forces at contacts that may be closed, with given states of friction, in the subset of Python that is compiled."""

from __future__ import annotations

import math
from dataclasses import dataclass

from mbd_sim.compiler.ir.python_kinds import Array, Integers, integers, zeros
from mbd_sim.simulation.contact.compiled.instant.contacts import READ, Contacts
from mbd_sim.simulation.contact.compiled.instant.forces import ForceProblem
from mbd_sim.simulation.contact.compiled.instant.islands import unique_forces
from mbd_sim.simulation.contact.compiled.instant.linear import independent, pivots, unit_diagonal

LOAD_ITERATIONS, LOAD_CHANGE = 200, 1e-14  # until loads of joints do not change any more, relative to the largest
ABSENT, STICKING, SLIDING_ON, FREE = 0, 1, 2, 3  # states of friction: FREE has neither slip nor capacity


@dataclass(frozen=True)
class Search:
    """What is known while modes are sought.

    `touching` (gaps,) rest on each other. The gaps in `open` open, `yielding` and `overloaded` friction slides: see
    `mbd_sim.simulation.contact.candidates.Forced`. `terms`: see `read_terms`. `states` (frictions,) are those of
    friction, with the `directions` (rows,) of what slides; that are the elements in `order` from 1 on, as many as
    `order` 0 says. `forces` and `rates` (rows,) are found, and `unmoved` (rows,) are the accelerations that count as
    zero. `coupled` (rows, rows) is A with the friction of what slides. `loads` (frictions,) are the sizes
    of the forces of joints on which friction depends, 1 for all other friction; for `joint_loads` see `Contacts`.
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
    joint_loads: Array
    loads: Array


def read_terms(c: Contacts, t: float, y: Array, inputs: Array, terms: Array) -> None:
    """A (rows, rows) column by column, accelerations (rows,), sizes of sliding and then of static friction."""
    time = zeros(1)
    time[0] = t
    READ(c.terms, time, y, inputs, terms)


def read_joint_loads(c: Contacts, t: float, y: Array, inputs: Array, loads: Array) -> None:
    """The forces of joints with loads: see `Contacts`."""
    time = zeros(1)
    time[0] = t
    if c.loaded:
        READ(c.joint_loads, time, y, inputs, loads)


def load_component(c: Contacts, joint_loads: Array, load: int, component: int, forces: Array) -> float:
    """A component of the force of a joint with a load, with contact forces (rows,)."""
    first, k = c.load_offsets[load], c.load_components[load]
    total = joint_loads[first + component]
    for row in range(c.rows):
        total += joint_loads[first + k * (1 + row) + component] * forces[row]
    return total


def load_of(c: Contacts, joint_loads: Array, element: int, forces: Array) -> float:
    """The size of the force of a joint on which the friction of an element depends; 1 without such."""
    load, square = c.friction_loads[element], 0.0
    if load < 0:
        return 1.0
    for component in range(c.load_components[load]):
        part = load_component(c, joint_loads, load, component, forces)
        square += part * part
    return math.sqrt(square)


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


def limit_of(c: Contacts, s: Search, element: int) -> float:
    """The limit of an element's friction at rest."""
    gap = c.friction_gaps[element]
    return static_size(c, s, element) * (1.0 if gap < 0 else s.forces[gap])


def static_size(c: Contacts, s: Search, element: int) -> float:
    """The limit of an element's friction at rest, for a unit force of its gap if it has one."""
    return friction_size(c, s.terms, element, 1) * s.loads[element]


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


def present_rows(c: Contacts, s: Search, present: Integers) -> int:
    """The rows that may bear a force: of gaps that touch, and of friction that is not absent; how many they are."""
    count = 0
    for gap in range(c.gaps):
        if s.touching[gap]:
            present[count] = gap
            count += 1
    for k in range(c.frictions):
        for direction in range(2 if s.states[k] != ABSENT else 0):
            row = c.friction_rows[2 * k + direction]
            if row >= 0:
                present[count] = row
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
    matrix, own, factors, present = zeros(n * n), zeros(n * n), zeros(n), integers(n)
    acting = present_rows(c, s, present)
    for i in range(acting):
        for j in range(acting):
            matrix[present[i] * n + present[j]] = s.terms[present[i] + present[j] * n]
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


def find_forces_and_loads(c: Contacts, s: Search) -> bool:
    """The forces and accelerations, and the loads of joints that follow from them; False where they are not simple."""
    for _ in range(LOAD_ITERATIONS):
        if not find_forces(c, s):
            return False
        change, largest = 0.0, 0.0
        for load in range(c.loaded):
            k = c.load_elements[load]
            new = load_of(c, s.joint_loads, k, s.forces)
            change = max(change, abs(new - s.loads[k]))
            largest = max(largest, new)
            s.loads[k] = new
        if change <= LOAD_CHANGE * largest:
            return True
    return False


def find_forces(c: Contacts, s: Search) -> bool:
    """λ (rows,) of all rows, and the accelerations (rows,) with them; False where they are not simple to find."""
    n = c.rows
    free, unit, constant = zeros(n), zeros(n * n), zeros(n)
    chosen, place, present = integers(n), integers(n), integers(n)
    acting = present_rows(c, s, present)
    for i in range(n):
        free[i] = free_acceleration(c, s.terms, i)
        unit[i * n + i] = 1.0
        for j in range(acting):
            s.coupled[i * n + present[j]] = s.terms[i + present[j] * n]
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
            sizes[frictions] = static_size(c, s, k)
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
        gap, size = c.friction_gaps[k], friction_size(c, s.terms, k, 0) * s.loads[k]
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
