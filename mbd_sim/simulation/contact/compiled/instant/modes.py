"""The modes of contacts where their forces are unique, in the subset of Python that is compiled.

See `mbd_sim.simulation.contact.candidates`, which also knows friction that others hold, and contacts that share
their forces.
"""

from __future__ import annotations

from mbd_sim.compiler.ir.python_kinds import Array, Integers, integers, zeros
from mbd_sim.dynamics.contact.one_sided_equations import RELEASED
from mbd_sim.simulation.contact.compiled.instant.candidate_forces import (
    ABSENT,
    FREE,
    SLIDING_ON,
    STICKING,
    Search,
    find_forces_and_loads,
    free_acceleration,
    friction_size,
    is_determined,
    is_independent,
    length_along,
    limit_of,
    load_component,
    load_of,
    present_rows,
    read_joint_loads,
)
from mbd_sim.simulation.contact.compiled.instant.contacts import (
    Contacts,
    active_at,
    direction_at,
    force_at,
    rate_at,
    read,
    slides,
)
from mbd_sim.simulation.contact.compiled.instant.linear import best_conditioned, independent

RESTING = 1e-10  # of the natural speed, up to which a speed counts as zero
STOPPED = 1e-8  # of the natural speed, up to which slip along two directions counts as zero: it turns ever faster
ALONG = 1e-6  # of such a slip, its part across the direction of sliding up to which it is along that
UNMOVED = 1e-9  # acceleration, relative to those without contact forces, that counts as zero
AT_LIMIT = 1.0 - 1e-9  # use of its limit, from which on friction at rest has reached it
OVERLOAD = 1e-9  # of the largest force, that friction may exceed its limit by
ATTEMPTS = 20
LOAD_ROUND_OFF = 1e-10  # of a load, relative to its parts


def is_touching(c: Contacts, readings: Array, gap: int) -> bool:
    """Whether a gap is zero; for a clutch, whether it does not slip."""
    limit = RESTING if c.clutches[gap] else c.tolerance
    return readings[1 + gap] <= limit * c.gap_units[gap]


def find_modes(
    c: Contacts, t: float, y: Array, inputs: Array, readings: Array, terms: Array,
    opening: Integers, yielding: Integers, sliding: Integers,
) -> bool:  # fmt: skip
    """Write the modes at a state without approaching contacts into the inputs; False where they are not simple to find.

    :param opening: 1 for gaps that are to open.
    :param yielding: 1 for friction that has reached its limit.
    :param sliding: 1 for friction that does not stop, however slow it is.
    """
    n, largest = c.rows, 0.0
    s = Search(
        integers(c.gaps), integers(c.gaps), yielding, integers(c.frictions), terms, integers(c.frictions), zeros(n),
        integers(c.frictions + 1), zeros(n), zeros(n), zeros(n), zeros(n * n), zeros(c.loads_size), zeros(c.frictions),
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
    read_joint_loads(c, t, y, inputs, s.joint_loads)
    for _ in range(ATTEMPTS):
        begin(c, s, readings, sliding)
        if not settle(c, s):
            return False
        release(c, s)
        if withdrawn(c, s):
            continue
        if not write_modes(c, s, inputs):
            return False
        read(c, t, y, inputs, readings)
        if not overload(c, s, readings, inputs):
            return not turns_at_once(c, readings, inputs)
    return False


def begin(c: Contacts, s: Search, readings: Array, sliding: Integers) -> None:
    """The states of friction before any force is known."""
    s.order[0] = 0
    for k in range(c.frictions):
        s.loads[k] = load_of(c, s.joint_loads, k, readings[force_at(c, 0) :])
        gap, first = c.friction_gaps[k], c.friction_rows[2 * k]
        s.states[k] = ABSENT
        if gap >= 0 and not s.touching[gap]:
            continue
        speed = length_along(c, k, readings[rate_at(c, 0) :])
        is_exact = c.friction_rows[2 * k + 1] < 0 or sliding[k] or s.yielding[k]
        if speed > (RESTING if is_exact else STOPPED) * c.row_speeds[first]:
            slide(c, s, k, readings[rate_at(c, 0) :], speed)
        elif friction_size(c, s.terms, k, 1) > 0.0 and (gap < 0 or not s.open[gap]):
            s.states[k] = STICKING
        elif gap < 0 and c.friction_loads[k] < 0:
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
        if not find_forces_and_loads(c, s):
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


def begins_to_slide(c: Contacts, s: Search, element: int) -> bool:
    """Whether friction that is to stick moves, at its limit; that of a gap which opens needs no direction.

    Its gap could be found closed with the direction in which it moves while it is free, against which it then slides.
    """
    gap = c.friction_gaps[element]
    if gap >= 0 and not s.forces[gap] > 0.0 and s.rates[gap] > s.unmoved[gap]:
        return False
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
    matrix, closed, found, present = zeros(n * n), integers(n), integers(n), integers(n)
    acting = present_rows(c, s, present)
    for i in range(acting):
        for j in range(acting):
            matrix[present[i] * n + present[j]] = s.terms[present[i] + present[j] * n]
    for i in range(c.first_feature):
        if i < 2 * n or i >= 2 * n + c.loaded:  # signs stay
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
        if s.states[k] == SLIDING_ON and c.friction_loads[k] >= 0:
            inputs[active_at(c, first)] = 1.0
        if s.states[k] == SLIDING_ON and (gap < 0 or inputs[c.first_mode + gap] != 0.0):
            for direction in range(2):
                row = c.friction_rows[2 * k + direction]
                if row >= 0:
                    inputs[direction_at(c, row)] = s.directions[row]
    for load in range(c.loaded):
        if c.load_components[load] > 0:
            set_sign(c, s.joint_loads, load, s.forces, inputs)
    return True


def turns_at_once(c: Contacts, readings: Array, inputs: Array) -> bool:
    """Whether friction slides in another direction than that of its slip, which counts as zero but has to end first."""
    for k in range(c.frictions):
        first, second = c.friction_rows[2 * k], c.friction_rows[2 * k + 1]
        if second < 0 or not slides(c, inputs, k):
            continue
        speed, one = length_along(c, k, readings[rate_at(c, 0) :]), inputs[direction_at(c, first)]
        across = one * readings[rate_at(c, second)] - inputs[direction_at(c, second)] * readings[rate_at(c, first)]
        if speed > c.slow and speed <= STOPPED * c.row_speeds[first] and abs(across) > ALONG * speed:
            return True
    return False


def set_sign(c: Contacts, joint_loads: Array, load: int, forces: Array, inputs: Array) -> None:
    """Write the sign of the first component of a load; one that is zero keeps its own."""
    first, k, position = c.load_offsets[load], c.load_components[load], c.first_mode + 2 * c.rows + load
    size = abs(joint_loads[first])
    for row in range(c.rows):
        size += abs(joint_loads[first + k * (1 + row)] * forces[row])
    value = load_component(c, joint_loads, load, 0, forces)
    if abs(value) > LOAD_ROUND_OFF * (c.unit_force + size):
        inputs[position] = -1.0 if value < 0.0 else 1.0
    elif inputs[position] == 0.0:
        inputs[position] = 1.0


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


def overload(c: Contacts, s: Search, readings: Array, inputs: Array) -> bool:
    """Whether sticking elements carry more than they can; they are remembered."""
    found, size = False, 0.0
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
        load = load_of(c, s.joint_loads, k, readings[force_at(c, 0) :]) if gap < 0 else readings[force_at(c, gap)]
        scale = c.row_loads[first] * (1.0 + size)
        if force > friction_size(c, s.terms, k, 1) * load + OVERLOAD * scale:
            s.overloaded[k] = 1
            found = True
    return found
