"""Parts of steps with constant directions of sliding, where friction turns slip much faster than it changes otherwise.

They have the same effect as the directions of the slip, to second order, and are stable however fast friction turns it.
This is in the subset of Python that is compiled.
"""

from __future__ import annotations

import math

from mbd_sim.compiler.ir.python_kinds import Array, zeros
from mbd_sim.compiler.steps.guarded import STIFF
from mbd_sim.simulation.contact.compiled.instant.contacts import Contacts, force_at, read, turning_at
from mbd_sim.simulation.contact.compiled.instant.linear import solve
from mbd_sim.simulation.contact.compiled.search import (
    NONE,
    TrialPart,
    finish,
    forward,
    has_failed,
    readings_at,
)
from mbd_sim.simulation.contact.compiled.sliding import Sliding, hypot, slip, speed_of, with_directions

STOPPED = 1e-8  # of the natural speed, up to which slip along two directions counts as zero: it turns ever faster
SHORTER = 0.8  # of the length after which a slip velocity has changed by `TURNING`
SHORTENING = 0.25  # of a length, at most; the motion beyond a stop says little
STEADY = 4.0  # stable steps, beyond which directions of sliding are sought that hold for longer ones
MOST_TURNED = 0.05  # rad, between such a direction and the slip at the end
MOST_LOADED = 0.05  # of a normal force, by which it may change meanwhile
NEAR = 0.9  # cosine of the angle between it and the slip at the start
HELD = 1e-11  # of the natural speed, slip across such a direction that does not matter
SLOWED = 0.5  # of its speed, down to which a slip may become slower while it has such a direction
MOST_TRIALS = 12  # of lengths for which such directions are sought
BRIEF = 1e-3  # of a stable step, in which the change of a slip is measured
SHORT_WAY = 1e-11  # of the natural length, way on which it does not matter how a slip turns until it stops
BEYOND = 0.3  # of `STOPPED`, speed by which such a motion ends beyond the stop
ANGLE = 1e-5  # rad, for the derivatives by angles
NEWTON_STEPS = 8
CONVERGED = 1e-11  # of the natural speed, slip across directions that are right
SHORTEST = 1e-15  # of the natural time, and of the time


def steady_length(c: Contacts, m: TrialPart, s: Sliding, length: float) -> float:
    """How long directions may be constant, as far as slips slow down: up to a stop that is near, or for a part of that.

    Then all slips that turn have constant directions, so none of them limits the length by how fast friction turns it.
    """
    fastest, soon, slows = 0.0, m.out, False
    for k in range(c.frictions):
        s.steady[k] = s.turning[k]
        speed = speed_of(c, m.before, k)
        if s.turning[k] and speed > c.slow:
            fastest = max(fastest, turning_at(c, m.before, k) / STIFF)
            slows = slows or not forward(c, m.before, m.after, k) > speed * speed
    if not slows or not fastest * length > STEADY:
        return length
    soon = readings_at(c, m, BRIEF / fastest)
    for k in range(c.frictions):
        speed = speed_of(c, m.before, k)
        if s.turning[k] and speed > c.slow:
            slowing = (speed * speed - forward(c, m.before, soon, k)) / speed * fastest / BRIEF
            if slowing > 0.0:
                is_short = is_short_way(c, speed, speed / slowing)
                length = min(length, (1.0 + ANGLE if is_short else 1.0 - SLOWED) * speed / slowing)
    return length


def is_short_way(c: Contacts, speed: float, length: float) -> bool:
    """Whether a slip that stops after this length cannot move so far that its direction matters."""
    return speed * length <= SHORT_WAY * c.unit_speed / c.unit_rate


def is_stiff(c: Contacts, m: TrialPart, k: int, length: float) -> bool:
    """Whether friction turns a slip within a small part of a length, as where sliding begins, or its way is short."""
    speed = speed_of(c, m.before, k)
    return speed <= c.slow or length * turning_at(c, m.before, k) > STEADY * STIFF or is_short_way(c, speed, length)


def along_steady(c: Contacts, m: TrialPart, s: Sliding, length: float) -> bool:
    """Take a motion with constant directions in which slips turn little; False where that is shorter than stable steps.

    Then the motion is not changed, but for its length.
    """
    start, share, shortest = zeros(2 * c.frictions), 0.0, SHORTEST * max(1.0 / c.unit_rate, abs(m.t))
    if any(s.steady[k] and c.slow < speed_of(c, m.before, k) <= STOPPED * c.unit_speed for k in range(c.frictions)):
        return False
    for i in range(2 * c.frictions):
        start[i] = s.directions[i]
    for _ in range(MOST_TRIALS):
        if length < shortest or not any(s.steady[k] and is_stiff(c, m, k, length) for k in range(c.frictions)):
            break
        share = steady_share(c, m, s, start) if along_fixed(c, m, s, length) else SHORTENING
        if share == 1.0:
            for i in range(c.inputs):
                m.inputs[i] = s.given[i]
            m.latest[0] = NONE
            read(c, m.t, m.y, m.inputs, m.before)
            return True
        for i in range(2 * c.frictions):
            s.directions[i] = start[i]
        length *= share
        m.span[0] = NONE
    return False


def steady_share(c: Contacts, m: TrialPart, s: Sliding, start: Array) -> float:
    """The share of a motion with constant directions in which slips turn and slow down little, or stop; 1 if they do.

    :param start: the directions at its start.
    """
    found, beyond = 1.0, BEYOND * STOPPED * c.unit_speed
    if has_failed(m):
        return SHORTENING
    for k in range(c.frictions):
        if s.steady[k]:
            x, y, speed = s.directions[2 * k], s.directions[2 * k + 1], speed_of(c, m.before, k)
            along = slip(c, m.after, k, 0) * x + slip(c, m.after, k, 1) * y
            across = abs(slip(c, m.after, k, 1) * x - slip(c, m.after, k, 0) * y)
            load, change = m.before[force_at(c, c.friction_gaps[k])], m.after[force_at(c, c.friction_gaps[k])]
            if abs(change - load) > MOST_LOADED * abs(load):
                found = min(found, max(SHORTER * MOST_LOADED * abs(load) / abs(change - load), SHORTENING))
            if not x * start[2 * k] + y * start[2 * k + 1] > NEAR:
                found = min(found, SHORTENING)
            elif speed > c.slow and is_short_way(c, speed, m.span[0]):
                if along < -2.0 * beyond:
                    found = min(found, (speed + beyond) / (speed - along))
            elif not along > SLOWED * speed:
                found = min(found, max(SHORTER * (1.0 - SLOWED) * speed / (speed - along), 0.1 * SHORTENING))
            elif across > max(HELD * c.unit_speed, MOST_TURNED * along):
                found = min(found, max(SHORTER * MOST_TURNED * along / across, SHORTENING))
    return found


def along_fixed(c: Contacts, m: TrialPart, s: Sliding, length: float) -> bool:
    """Find the motion with constant directions of friction which have the same effect as those of the slips, if it is.

    That is stable however fast friction turns the slips. The impulse of friction has the direction in the middle of the
    motion if the slip has this direction when the `share` of its length is over.
    """
    n = c.pairs
    found, last, jacobian, step = zeros(n), math.inf, zeros(n * n), zeros(n)
    moved, count, column, share = zeros(n), 0, 0, 1.0
    for k in range(c.frictions):
        count += s.steady[k]
    share = share_of(c, m, s, length)
    slip_across(c, m, s, share * length, found)
    for k in range(c.frictions):
        if s.steady[k]:
            x, y = s.directions[2 * k], s.directions[2 * k + 1]
            rotate(s.directions, k, ANGLE)
            slip_across(c, m, s, share * length, moved)
            s.directions[2 * k], s.directions[2 * k + 1] = x, y
            for row in range(count):
                jacobian[row * n + column] = (moved[row] - found[row]) / ANGLE
            column += 1
    for _ in range(NEWTON_STEPS):
        last = largest(count, found)
        take_newton_step(c, s, count, jacobian, found, step)
        slip_across(c, m, s, share * length, found)
        if not CONVERGED * c.unit_speed < largest(count, found) < 0.5 * last:
            break
    if not largest(count, found) <= CONVERGED * c.unit_speed:
        return False
    if share < 1.0:
        slip_across(c, m, s, length, found)
    return True


def take_newton_step(c: Contacts, s: Sliding, count: int, jacobian: Array, found: Array, step: Array) -> None:
    """Turn the directions to where slips have no part across them."""
    matrix, row, n = zeros(count * count), 0, c.pairs
    for i in range(count):
        for j in range(count):
            matrix[i * count + j] = jacobian[i * n + j]
    solve(count, matrix, found, step)
    for k in range(c.frictions):
        if s.steady[k]:
            rotate(s.directions, k, -step[row])
            row += 1


def share_of(c: Contacts, m: TrialPart, s: Sliding, length: float) -> float:
    """When, as a part of a length, slips have the direction in which friction acts on average.

    With a slip v across its present direction, friction at the rate k turns it as v' = b - k v. If b changes linearly
    and v follows it, a constant force has the same impulse if it has the direction of the slip at the share x of the
    length, where k L x (1 - x) = 2 x - 1: half of it where friction turns slowly, at the end where it turns fast.
    """
    least = math.inf
    for k in range(c.frictions):
        if s.steady[k] and speed_of(c, m.before, k) > c.slow:
            least = min(least, length * turning_at(c, m.before, k))
    return 1.0 if least > 1e8 else (least - 2.0 + math.sqrt(least * least + 4.0)) / (2.0 * least)


def largest(n: int, values: Array) -> float:
    """The largest absolute value."""
    found = 0.0
    for i in range(n):
        found = max(found, abs(values[i]))
    return found


def rotate(directions: Array, k: int, angle: float) -> None:
    """Turn a direction by an angle, of which the tangent is given."""
    x, y = directions[2 * k] - angle * directions[2 * k + 1], directions[2 * k + 1] + angle * directions[2 * k]
    size = hypot(x, y)
    directions[2 * k], directions[2 * k + 1] = x / size, y / size


def slip_across(c: Contacts, m: TrialPart, s: Sliding, length: float, out: Array) -> None:
    """The slips across the constant directions of steady friction after a length, to which the motion then belongs."""
    fixed = TrialPart(
        m.y, s.given, m.t, m.span, m.out, m.end, m.after, m.latest, m.state, m.out, m.places_before, m.places_after,
        m.places, m.offset, m.shrinking, m.failed,
    )  # fmt: skip
    with_directions(c, m, s, s.steady)
    finish(c, fixed, length)
    row = 0
    for k in range(c.frictions):
        if s.steady[k]:
            x, y = s.directions[2 * k], s.directions[2 * k + 1]
            out[row] = slip(c, m.after, k, 1) * x - slip(c, m.after, k, 0) * y
            row += 1
