"""Motion in which friction turns slip, by collocation, in the subset of Python that is compiled.

Slip whose direction friction turns fast is a stiff problem. Its slopes are found at the nodes of the Radau IIA method
of five stages and order nine, which is stable however fast friction turns the slip (E. Hairer, G. Wanner, Solving
Ordinary Differential Equations II, section IV.8). The directions of friction at the nodes are unknowns of their own:
with given ones, the slopes are those of a smooth mechanism, and sweeps over the nodes converge; the directions follow
by Newton's method from the slips across them, which must be zero. These are read with the newest slopes, before the
first sweep and after each one, which costs little. Their derivatives need only those of the slopes by directions, since
slips depend on speeds linearly.
"""

from __future__ import annotations

import math

from mbd_sim.compiler.ir.python_kinds import Array, Integers, zeros
from mbd_sim.simulation.contact.compiled.instant.contacts import (
    READ,
    START,
    Contacts,
    read_rates,
    readings_size,
)
from mbd_sim.simulation.contact.compiled.instant.linear import solve
from mbd_sim.simulation.contact.compiled.instant.sliding import STAGES, Sliding, forward, hypot, slip, with_directions
from mbd_sim.simulation.contact.compiled.nodes import keep_guards, lagrange

ANGLE = 1e-5  # tangent of the angle for derivatives by directions
MOST_SWEEPS = 40
SLOW = 4  # sweeps that halve the change at least, or else a shorter length is tried
MOST_TOGETHER = 32  # elements whose directions are corrected together
EXACT = 1e-13  # of natural units, change that the next sweep should make, with which it is not needed
SHARE = 3e-2  # of the error of a motion that is enough, the same
CONVERGED = 1e-11  # of natural units, change by a sweep where sweeps change no less, because of round-off
DIVERGED = 1e3
MISSED = 5e-4  # of what the polynomial through the slopes misses at the start: the error of the motion, at most
EARLY = 3.0  # of what is missed, a change by a sweep after which a length that is too long is known to be so


def collocated(
    c: Contacts, s: Sliding, y: Array, inputs: Array, t: float, length: float, enough: float, state: Array
) -> float:
    """Find the state after a length in s; the error, relative to natural units, or infinity without a solution.

    :param enough: an error with which the motion is not used; then it may be found from fewer sweeps.
    """
    across, along, error, change, last = zeros(STAGES * c.pairs), zeros(STAGES * c.pairs), math.inf, 0.0, math.inf
    projected, time, rate, left, before = zeros(c.size), zeros(1), 1.0, math.inf, math.inf
    exact = max(EXACT, SHARE * enough) if enough < math.inf else EXACT
    guess(c, s, length)
    read_slips(c, s, y, inputs, t, length, across, along)
    correct(c, s, length, across, along)
    for count in range(MOST_SWEEPS):
        change = sweep(c, s, y, inputs, t, length, count == 0 and s.base[0] == 0.0)
        change = max(change, read_slips(c, s, y, inputs, t, length, across, along))
        if not change < DIVERGED or (count % SLOW == SLOW - 1 and change > 0.5 * before):
            return math.inf
        before = change if count % SLOW == SLOW - 1 else before
        error = MISSED * length * missed(c, s)
        left = change * min(1.0, max(rate, change / last))  # by the worse one of the last two rates of convergence
        rate = change / last
        if left <= exact or (change <= CONVERGED and change > 0.5 * last):
            break
        if error > enough and change < EARLY * error / MISSED:
            break
        last = change
        correct(c, s, length, across, along)
    if error > enough:
        return error
    if left > max(exact, CONVERGED):
        return math.inf
    correct(c, s, length, across, along)
    time[0] = t + length
    state_at(c, s, y, length, STAGES, state)
    READ(c.project, time, state, inputs, projected)
    for i in range(c.size):
        state[i] = projected[i]
    return error


def begin_slopes(c: Contacts, s: Sliding, y: Array, inputs: Array, t: float, readings: Array) -> bool:
    """Find the slopes and the readings at the start; False where the constraints are ill-conditioned."""
    readings[0] = t
    return START(c.start, readings, y, inputs, s.slopes, readings[1:]) > 0


def find_effects(
    c: Contacts, s: Sliding, y: Array, inputs: Array, t: float, length: float, readings: Array
) -> None:  # fmt: skip
    """Find how slopes and slips at the start change with the directions.

    :param length: a typical one in s.
    :param readings: at the start.
    """
    time, moved, state, column, row = zeros(1), zeros(c.size), zeros(c.size), 0, 0
    after, pairs = zeros(readings_size(c)), number_of(c, s.all)
    time[0], s.base[0] = t, 0.0
    keep_guards(c, s, 0, readings)
    for k in range(c.frictions):
        if s.turning[k]:
            s.kept[c.guards + k] = forward(c, s, readings, k)
            x, z = s.directions[2 * k], s.directions[2 * k + 1]
            rotate(s.directions, k, ANGLE)
            with_directions(c, s, inputs, s.directions)
            START(c.start, time, y, s.given, moved, after[1:])
            s.directions[2 * k], s.directions[2 * k + 1] = x, z
            for i in range(c.size):
                state[i] = y[i]
            for i in range(c.size):
                s.turned[column * c.size + i] = (moved[i] - s.slopes[i]) / ANGLE
            for i in range(c.first_speed, c.first_speed + c.speeds):
                state[i] += length * s.turned[column * c.size + i]
            read_rates(c, t, state, inputs, after)
            row = 0
            for other in range(c.frictions):
                if s.turning[other]:
                    change_x = slip(c, after, other, 0) - slip(c, readings, other, 0)
                    change_z = slip(c, after, other, 1) - slip(c, readings, other, 1)
                    x, z = s.directions[2 * other], s.directions[2 * other + 1]
                    s.effects[row * pairs + column] = (change_z * x - change_x * z) / length
                    row += 1
            column += 1


def number_of(c: Contacts, marks: Integers) -> int:
    """How many elements are marked."""
    found = 0
    for k in range(c.frictions):
        found += marks[k]
    return found


def guess(c: Contacts, s: Sliding, length: float) -> None:
    """Slopes and directions at the nodes from those of another length, or else those at the start."""
    share = length / s.base[0] if s.base[0] > 0.0 else 0.0
    weights, n, m = zeros(STAGES + 1), c.size, 2 * c.frictions
    for stage in range(1, STAGES + 1):
        lagrange(c, 0, share * c.radau[stage], weights)
        for i in range(n):
            s.slopes[stage * n + i] = 0.0
            for j in range(STAGES + 1):
                known = s.slopes[i] if share == 0.0 or j == 0 else s.known[j * n + i]
                s.slopes[stage * n + i] += weights[j] * known
        for i in range(m):
            s.turns[stage * m + i] = 0.0
            for j in range(STAGES + 1):
                known = s.directions[i] if share == 0.0 or j == 0 else s.known_turns[j * m + i]
                s.turns[stage * m + i] += weights[j] * known
        for k in range(c.frictions):
            if s.turning[k]:
                rotate(s.turns[stage * m :], k, 0.0)


def remember(c: Contacts, s: Sliding, length: float) -> None:
    """Keep slopes and directions for guesses of those of other lengths."""
    s.base[0] = length
    for i in range((STAGES + 1) * c.size):
        s.known[i] = s.slopes[i]
    for i in range((STAGES + 1) * 2 * c.frictions):
        s.known_turns[i] = s.turns[i]


def state_at(c: Contacts, s: Sliding, y: Array, length: float, stage: int, state: Array) -> None:
    """The state at a node, by the mean slopes up to it."""
    size, slopes, shares, change = c.size, s.slopes[c.size :], c.radau[STAGES + 1 + (stage - 1) * STAGES :], 0.0
    for i in range(size):
        change = 0.0
        for j in range(STAGES):
            change += shares[j] * slopes[j * size + i]
        state[i] = y[i] + length * change


def sweep(c: Contacts, s: Sliding, y: Array, inputs: Array, t: float, length: float, guessed: bool) -> float:
    """Evaluate the slopes at all nodes; the largest change of the state by new ones, in natural units.

    :param guessed: the slopes are those at the start; then they change linearly behind the last node.
    """
    time, state, slopes, readings, found = zeros(1), zeros(c.size), zeros(c.size), zeros(readings_size(c)), 0.0
    for stage in range(1, STAGES + 1):
        state_at(c, s, y, length, stage, state)
        old = s.slopes[stage * c.size :]
        with_directions(c, s, inputs, s.turns[stage * 2 * c.frictions :])
        time[0] = t + c.radau[stage] * length
        START(c.start, time, state, s.given, slopes, readings[1:])
        found = max(found, length * difference(c, slopes, old))
        for later in range(stage + 1, STAGES + 1 if guessed else 0):
            for i in range(c.size):
                s.slopes[later * c.size + i] += c.radau[later] / c.radau[stage] * (slopes[i] - old[i])
        for i in range(c.size):
            old[i] = slopes[i]
        keep_guards(c, s, stage, readings)
    return found


def read_slips(
    c: Contacts, s: Sliding, y: Array, inputs: Array, t: float, length: float, across: Array, along: Array
) -> float:
    """Find the slips across and along the directions of friction at the nodes; the largest across, in natural units."""
    state, readings, found, row = zeros(c.size), zeros(readings_size(c)), 0.0, 0
    for stage in range(1, STAGES + 1):
        state_at(c, s, y, length, stage, state)
        read_rates(c, t + c.radau[stage] * length, state, inputs, readings)
        directions, row = s.turns[stage * 2 * c.frictions :], (stage - 1) * c.pairs
        for k in range(c.frictions):
            if s.turning[k]:
                x, z = directions[2 * k], directions[2 * k + 1]
                across[row] = slip(c, readings, k, 1) * x - slip(c, readings, k, 0) * z
                along[row] = slip(c, readings, k, 0) * x + slip(c, readings, k, 1) * z
                found = max(found, abs(across[row]) / c.unit_speed)
                s.kept[stage * (c.guards + c.frictions) + c.guards + k] = along[row]
                row += 1
    return found


def missed(c: Contacts, s: Sliding) -> float:
    """By how much the polynomial through the slopes at the nodes misses those at the start, in natural units."""
    weights, value = zeros(STAGES + 1), zeros(c.size)
    lagrange(c, 1, 0.0, weights)
    for j in range(1, STAGES + 1):
        for i in range(c.size):
            value[i] += weights[j] * s.slopes[j * c.size + i]
    return difference(c, value, s.slopes)


def difference(c: Contacts, slopes: Array, others: Array) -> float:
    """The largest difference of slopes of coordinates and speeds, in natural units; infinite if it is not a number."""
    place, speed = 0.0, 0.0
    for i in range(c.first_speed):
        place = larger(place, abs(slopes[i] - others[i]))
    for i in range(c.first_speed, c.first_speed + c.speeds):
        speed = larger(speed, abs(slopes[i] - others[i]))
    return max(place / min(1.0, c.unit_speed / c.unit_rate), speed / min(1.0, c.unit_speed))


def larger(one: float, other: float) -> float:
    """The larger one of two numbers that are not negative; infinite if the other is not a number."""
    if other <= one:
        return one
    return other if math.isfinite(other) else math.inf


def correct(c: Contacts, s: Sliding, length: float, across: Array, along: Array) -> None:
    """Turn the directions so that slips across them vanish, and change the slopes with them."""
    count, first = number_of(c, s.turning), 0
    together = count if count <= MOST_TOGETHER else 1
    while first < count:
        correct_some(c, s, length, across, along, first, together)
        first += together


def correct_some(
    c: Contacts, s: Sliding, length: float, across: Array, along: Array, first: int, count: int
) -> None:  # fmt: skip
    """The same for elements that turn, from the `first` on."""
    n, m, number, pairs = STAGES * count, 2 * c.frictions, 0, number_of(c, s.all)
    matrix, right, angles = zeros(n * n), zeros(n), zeros(n)
    for stage in range(STAGES):
        for i in range(count):
            row = stage * count + i
            right[row] = -across[stage * c.pairs + first + i]
            for other in range(STAGES):
                a = length * c.radau[STAGES + 1 + stage * STAGES + other]
                for j in range(count):
                    matrix[row * n + other * count + j] = a * s.effects[(first + i) * pairs + first + j]
            matrix[row * n + row] -= along[stage * c.pairs + first + i]
    solve(n, matrix, right, angles)
    for stage in range(STAGES):
        number = 0
        for k in range(c.frictions):
            if s.turning[k] and first <= number and number < first + count:
                angle = min(1.0, max(-1.0, angles[stage * count + number - first]))
                rotate(s.turns[(stage + 1) * m :], k, angle)
                for i in range(c.size):
                    s.slopes[(stage + 1) * c.size + i] += angle * s.turned[number * c.size + i]
            number += s.turning[k]


def rotate(directions: Array, k: int, angle: float) -> None:
    """Turn a direction by an angle, of which the tangent is given, and make it a unit vector."""
    x, y = directions[2 * k] - angle * directions[2 * k + 1], directions[2 * k + 1] + angle * directions[2 * k]
    size = hypot(x, y)
    directions[2 * k], directions[2 * k + 1] = x / size, y / size
