"""Motion in which friction turns slip fast, by extrapolation, in the subset of Python that is compiled.

Slip whose direction friction turns fast is a stiff problem. A motion is divided into 1, 2, 3, … parts; in each of them
friction keeps the direction that the slip has at the end of the part, which is stable however fast friction turns it,
and of first order. The states at the end are extrapolated to infinitely many parts, as in the extrapolated implicit
Euler method (E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, section IV.9).
"""

from __future__ import annotations

import math

from mbd_sim.compiler.ir.python_kinds import Array, zeros
from mbd_sim.simulation.contact.compiled.instant.contacts import (
    PART_STEP,
    Contacts,
    rate_at,
    read,
    readings_size,
    turning_at,
)
from mbd_sim.simulation.contact.compiled.instant.linear import solve
from mbd_sim.simulation.contact.compiled.sliding import Sliding, hypot, slip, speed_of, with_directions

MOST_SEQUENCES = 7
DIVERGING = 3  # sequences, from which on each must be better than the one before
ANGLE = 1e-5  # tangent of the angle for derivatives by directions
NEWTON_STEPS = 8
EXACT = 1e-14  # of the natural speed, slip across the direction of friction at the end of a part
MOST_REDUCED = 10.0  # what divides, at most, an error of slip across its direction, which friction will take away
CONVERGED = 1e-12  # of the natural speed: what round-off may leave of that


def extrapolated(
    c: Contacts, s: Sliding, y: Array, inputs: Array, t: float, length: float, most: int, enough: float, state: Array
) -> float:
    """Find the state after a length in s from up to `most` sequences, whose number is then in `s.sequences`.

    The result is the change by the last one, relative to natural units; infinite without a solution.

    :param enough: change by a sequence after which no other is needed; 0 takes all.
    """
    table, error, last, is_found = zeros(most * c.size), math.inf, math.inf, True
    start, work = zeros(2 * c.frictions), zeros(c.size)
    readings, before, places = zeros(readings_size(c)), zeros(readings_size(c)), zeros(c.first_speed)
    for i in range(2 * c.frictions):
        start[i] = s.directions[i]
    s.sequences[0] = 0
    for count in range(1, most + 1):
        for i in range(c.size):
            work[i] = y[i]
        is_found = in_parts(c, s, inputs, t, length, count, work)
        for i in range(2 * c.frictions):
            s.directions[i] = start[i]
        if not is_found:
            return math.inf
        for i in range(c.size):
            state[i] = refined(table, i * most, count, work[i])
        s.sequences[0] = count
        if enough > 0.0:
            read(c, t + length, state, inputs, readings)
            last = error
            if count > 1:
                error = max(change_of_speeds(c, s, length, before, readings), change_of_places(c, places, state))
            if error <= enough or (count > DIVERGING and not error < last):
                break
            for i in range(readings_size(c)):
                before[i] = readings[i]
            for i in range(c.first_speed):
                places[i] = state[i]
    return error if enough > 0.0 else 0.0


def refined(table: Array, first: int, count: int, value: float) -> float:
    """Extrapolate from the values of 1, …, count parts, of which the last one is given, by Aitken and Neville."""
    old = 0.0
    for k in range(count - 1):
        old = table[first + k]
        table[first + k] = value
        value += (value - old) * (count - 1 - k) / (k + 1.0)
    table[first + count - 1] = value
    return value


def change_of_speeds(c: Contacts, s: Sliding, length: float, before: Array, after: Array) -> float:
    """The largest difference of rates, relative to the natural ones.

    Slip across its direction counts for less where friction will soon have taken it away.
    """
    found, change = 0.0, zeros(c.rows)
    for row in range(c.rows):
        change[row] = (after[rate_at(c, row)] - before[rate_at(c, row)]) / c.row_speeds[row]
    for k in range(c.frictions):
        speed = speed_of(c, after, k) if s.turning[k] else 0.0
        if speed > c.slow:
            x, y = slip(c, after, k, 0) / speed, slip(c, after, k, 1) / speed
            first, second = c.friction_rows[2 * k], c.friction_rows[2 * k + 1]
            along, across = change[first] * x + change[second] * y, change[second] * x - change[first] * y
            change[first], change[second] = along, across / min(MOST_REDUCED, 1.0 + length * turning_at(c, after, k))
    for row in range(c.rows):
        found = max(found, abs(change[row]))
    return found


def change_of_places(c: Contacts, before: Array, state: Array) -> float:
    """The largest difference of coordinates, which may be lengths or angles, relative to the smaller natural unit."""
    found, unit = 0.0, min(1.0, c.unit_speed / c.unit_rate)
    for i in range(c.first_speed):
        found = max(found, abs(state[i] - before[i]) / unit)
    return found


def in_parts(c: Contacts, s: Sliding, inputs: Array, t: float, length: float, count: int, state: Array) -> bool:
    """Move on in equal parts with constant directions of friction; whether they were found."""
    jacobian, last = zeros(c.pairs * c.pairs), zeros(2 * c.frictions)
    for i in range(2 * c.frictions):
        last[i] = s.directions[i]
    for i in range(count):
        turn_on(c, s.directions, last)
        if not to_slip(c, s, inputs, t + i * (length / count), length / count, state, jacobian, i == 0):
            return False
    return True


def turn_on(c: Contacts, directions: Array, last: Array) -> None:
    """Turn directions by as much as they have turned since the last ones, which become the present ones."""
    for k in range(c.frictions):
        x, y, u, v = directions[2 * k], directions[2 * k + 1], last[2 * k], last[2 * k + 1]
        along, side = x * u + y * v, y * u - x * v
        last[2 * k], last[2 * k + 1] = x, y
        directions[2 * k], directions[2 * k + 1] = x * along - y * side, y * along + x * side


def to_slip(
    c: Contacts, s: Sliding, inputs: Array, t: float, length: float, state: Array, jacobian: Array, first: bool
) -> bool:
    """Move on with friction along the slip at the end; whether its directions were found."""
    found, last, largest_slip, count = zeros(c.pairs), math.inf, 0.0, 0
    start, step = zeros(c.size), zeros(c.pairs)
    for i in range(c.size):
        start[i] = state[i]
    for k in range(c.frictions):
        count += s.turning[k]
    slips_across(c, s, inputs, t, length, start, state, found)
    if first:
        differentiate(c, s, inputs, t, length, start, found, jacobian)
    for _ in range(NEWTON_STEPS):
        largest_slip = largest(count, found)
        if not EXACT * c.unit_speed < largest_slip < 0.5 * last:
            break
        last = largest_slip
        solve(count, jacobian, found, step)
        turn_by(c, s, step)
        slips_across(c, s, inputs, t, length, start, state, found)
        update(count, jacobian, found, step)
    return min(last, largest(count, found)) <= CONVERGED * c.unit_speed


def differentiate(
    c: Contacts, s: Sliding, inputs: Array, t: float, length: float, start: Array, found: Array, jacobian: Array
) -> None:
    """The derivatives of slips across the directions of friction by the angles of these."""
    moved, state, count, column = zeros(c.pairs), zeros(c.size), 0, 0
    for k in range(c.frictions):
        count += s.turning[k]
    for k in range(c.frictions):
        if s.turning[k]:
            x, y = s.directions[2 * k], s.directions[2 * k + 1]
            rotate(s.directions, k, ANGLE)
            slips_across(c, s, inputs, t, length, start, state, moved)
            s.directions[2 * k], s.directions[2 * k + 1] = x, y
            for row in range(count):
                jacobian[row * count + column] = (moved[row] - found[row]) / ANGLE
            column += 1


def update(n: int, jacobian: Array, found: Array, step: Array) -> None:
    """Improve the derivatives by what a step has left, by Broyden's method."""
    square = 0.0
    for i in range(n):
        square += step[i] * step[i]
    if square > 0.0 and largest(n, found) < math.inf:
        for i in range(n):
            for j in range(n):
                jacobian[i * n + j] -= found[i] * step[j] / square


def slips_across(
    c: Contacts, s: Sliding, inputs: Array, t: float, length: float, start: Array, state: Array, out: Array
) -> None:
    """The state after a part with constant directions of friction, and the slips across these."""
    readings, row = zeros(readings_size(c)), 0
    for i in range(c.size):
        state[i] = start[i]
    with_directions(c, s, inputs, s.directions)
    if PART_STEP(c.part_step, state, s.given, t, length) < 0:
        state[0] = math.inf
    read(c, t + length, state, s.given, readings)
    for k in range(c.frictions):
        if s.turning[k]:
            x, y = s.directions[2 * k], s.directions[2 * k + 1]
            out[row] = slip(c, readings, k, 1) * x - slip(c, readings, k, 0) * y
            row += 1


def turn_by(c: Contacts, s: Sliding, step: Array) -> None:
    """Turn the directions back by angles."""
    row = 0
    for k in range(c.frictions):
        if s.turning[k]:
            rotate(s.directions, k, -step[row])
            row += 1


def rotate(directions: Array, k: int, angle: float) -> None:
    """Turn a direction by an angle, of which the tangent is given."""
    x, y = directions[2 * k] - angle * directions[2 * k + 1], directions[2 * k + 1] + angle * directions[2 * k]
    size = hypot(x, y)
    directions[2 * k], directions[2 * k + 1] = x / size, y / size


def largest(n: int, values: Array) -> float:
    """The largest absolute value; infinite where one is not a number."""
    found = 0.0
    for i in range(n):
        found = max(found, abs(values[i])) if math.isfinite(values[i]) else math.inf
    return found
