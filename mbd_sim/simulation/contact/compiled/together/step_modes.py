"""The modes at the end of a step of time stepping, in the subset of Python that is compiled.

They say what is read of contacts between steps, and which rows are projected.
"""

from __future__ import annotations

from mbd_sim.compiler.ir.python_kinds import Array, Integers, integers, zeros
from mbd_sim.simulation.contact.compiled.instant.contacts import Contacts, active_at, direction_at
from mbd_sim.simulation.contact.compiled.instant.linear import best_conditioned, least_solution
from mbd_sim.simulation.contact.compiled.instant.modes import RESTING, set_sign
from mbd_sim.simulation.contact.compiled.together.step_impulses import StepContacts, size_of, slip_of


def write_resting(c: Contacts, s: StepContacts, inputs: Array) -> None:
    """Write modes without sliding: closed are gaps that have borne something and do not open."""
    count, rows = 0, integers(c.rows)
    for i in range(3 * c.rows + c.loaded):
        inputs[c.first_mode + i] = 0.0
    for gap in range(c.gaps):
        if s.impulses[gap] > 0.0 and s.rates[gap] <= RESTING * c.row_speeds[gap]:
            inputs[c.first_mode + gap] = 1.0
            rows[count] = gap
            count += 1
    for k in range(c.frictions):
        gap = c.friction_gaps[k]
        if gap >= 0 and inputs[c.first_mode + gap] == 0.0:
            continue
        if size_of(c, s, k, 1) > 0.0 and slip_of(c, s, k) == 0.0:
            for direction in range(2):
                row = c.friction_rows[2 * k + direction]
                if row >= 0:
                    rows[count] = row
                    count += 1
    activate(c, s, count, rows, inputs)


def activate(c: Contacts, s: StepContacts, count: int, rows: Integers, inputs: Array) -> None:
    """Write that `count` of some rows are active; where they depend on each other, with their weights."""
    matrix, order, basis = zeros(count * count), integers(count), integers(count)
    for i in range(count):
        order[i] = i
        inputs[active_at(c, rows[i])] = -c.stepping.compliance[rows[i]]
        for j in range(count):
            matrix[i * count + j] = s.matrix[s.places[rows[i]] + s.places[rows[j]] * s.count]
    rank = best_conditioned(count, matrix, count, order, basis)
    for i in range(rank):
        row = rows[basis[i]]
        inputs[active_at(c, row)] = c.stepping.compliance[row] if rank < count else 1.0


def add_sliding(c: Contacts, s: StepContacts, inputs: Array) -> None:
    """Write the directions of sliding, and the signs of loads."""
    forces = zeros(c.rows)
    for k in range(c.frictions):
        gap, speed = c.friction_gaps[k], slip_of(c, s, k)
        if speed == 0.0 or (gap >= 0 and inputs[c.first_mode + gap] == 0.0):
            continue
        for direction in range(2):
            row = c.friction_rows[2 * k + direction]
            if row >= 0:
                inputs[direction_at(c, row)] = s.rates[row] / speed
        if c.friction_loads[k] >= 0:
            inputs[active_at(c, c.friction_rows[2 * k])] = 1.0
    for row in range(c.rows):
        forces[row] = s.impulses[row] / s.length
    for load in range(c.loaded):
        if c.load_components[load] > 0:
            set_sign(c, s.joint_loads, load, forces, inputs)
    if not any(s.hits[gap] for gap in range(c.gaps)):
        add_shares(c, s, forces, inputs)


def add_shares(c: Contacts, s: StepContacts, forces: Array, inputs: Array) -> None:
    """Write what forces that depend on each other have in the step beyond the least ones, so that they are read so."""
    chosen, count, depends = integers(c.rows), 0, False
    for row in range(c.rows):
        if inputs[active_at(c, row)] != 0.0:
            chosen[count] = row
            count += 1
        depends = depends or inputs[active_at(c, row)] < 0.0
    if depends:
        share(c, s, forces, inputs, chosen, count)


def share(c: Contacts, s: StepContacts, forces: Array, inputs: Array, chosen: Integers, count: int) -> None:
    """See `add_shares`; the `chosen` rows are active."""
    n, given = c.rows, c.first_mode + 2 * c.rows + c.loaded
    matrix, right, weights, found = zeros(count * count), zeros(count), zeros(count), zeros(count)
    place = integers(n)
    for i in range(count):
        place[chosen[i]] = 1 + i
        weights[i] = abs(inputs[active_at(c, chosen[i])])
        for j in range(count):
            matrix[i * count + j] = s.matrix[s.places[chosen[i]] + s.places[chosen[j]] * s.count]
    for k in range(c.frictions):
        column = place[c.friction_gaps[k]] - 1 if c.friction_gaps[k] >= 0 else -1
        for direction in range(2 if column >= 0 else 0):
            row = c.friction_rows[2 * k + direction]
            if row >= 0 and inputs[direction_at(c, row)] != 0.0:
                size = size_of(c, s, k, 0) * inputs[direction_at(c, row)]
                for i in range(count):
                    slope = s.matrix[s.places[chosen[i]] + s.places[row] * s.count]
                    matrix[i * count + column] -= slope * size
    for i in range(count):
        for j in range(count):
            right[i] += matrix[i * count + j] * forces[chosen[j]]
    least_solution(count, matrix, right, weights, found)
    for i in range(count):
        inputs[given + chosen[i]] = forces[chosen[i]] - found[i]
