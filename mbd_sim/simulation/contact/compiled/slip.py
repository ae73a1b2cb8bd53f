"""Parts of steps, in which slip along two directions does not turn much, in the subset of Python that is compiled.

The directions of sliding among the inputs follow the slip.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from mbd_sim.compiler.ir.python_kinds import Array, Integers, integers, zeros
from mbd_sim.compiler.steps.guarded import STIFF, TURNING
from mbd_sim.simulation.contact.compiled.instant.contacts import (
    Contacts,
    direction_at,
    guard_at,
    rate_at,
    read,
    readings_size,
    slides,
    turning_at,
)
from mbd_sim.simulation.contact.compiled.instant.linear import solve
from mbd_sim.simulation.contact.compiled.search import (
    FORWARD,
    NONE,
    TrialPart,
    begin,
    finish,
    first_change,
    first_event,
    first_zero,
    forward,
    has_failed,
    readings_at,
    try_length,
)

STOPPED = 1e-8  # of the natural speed, up to which slip along two directions counts as zero: it turns ever faster
STOPPING = 4.0  # of such a slip velocity, by which it may change within a step
STRAIGHT = 1e-10  # part of a change of slip across it, up to which it keeps its direction
NOISE = 1e-15  # of the natural speed, in slip
SHORTER = 0.8  # of the length after which a slip velocity has changed by `TURNING`
SHORTENING = 0.25  # of a length, at most; the motion beyond a stop says little
STEADY = 16.0  # stable steps, beyond which directions of sliding are sought that hold for longer ones
BRIEF = 1e-3  # of a stable step, in which the change of a slip is measured
UNHELD = (
    1e-8  # of the natural length, depth of a closed gap that no force could hold: a drive presses, and nothing yields
)
FIXED = 1.0 + 1e-12  # length of a direction of sliding that does not turn
ANGLE = 1e-5  # rad, for the derivatives by angles
NEWTON_STEPS = 8
SHORTEST = 1e-15  # of the natural time, and of the time
MOST_SHORTENED = 500  # times that a part of a step is shortened
MOST_FAILED = 20  # times that a part of a step is shortened because its end is not finite
ENDS, EVENT, FAILED, AGAIN = 0, 1, -1, 2  # of a part of a step


@dataclass(frozen=True)
class Sliding:
    """The friction elements that slide along two directions: 1 in `all`.

    Those whose slip turns are 1 in `turning`, and those whose friction is `steady` while their slip turns fast. Their
    `directions` (2 frictions,) can be constant in a motion with other inputs, `given`; `inputs` are those of the motion
    that is followed.
    """

    all: Integers
    turning: Integers
    steady: Integers
    directions: Array
    given: Array
    inputs: Array


def is_pair(c: Contacts, element: int) -> bool:
    """Whether friction has two directions."""
    return c.friction_rows[2 * element + 1] >= 0


def hypot(x: float, y: float) -> float:
    """The length of a vector, without overflow."""
    most = max(abs(x), abs(y))
    if most == 0.0:
        return 0.0
    a, b = x / most, y / most
    return most * math.sqrt(a * a + b * b)


def slip(c: Contacts, readings: Array, element: int, direction: int) -> float:
    """The slip along one of two directions."""
    return readings[rate_at(c, c.friction_rows[2 * element + direction])]


def speed_of(c: Contacts, readings: Array, element: int) -> float:
    """The size of a slip along two directions."""
    return hypot(slip(c, readings, element, 0), slip(c, readings, element, 1))


def change_of_slip(c: Contacts, before: Array, after: Array, element: int) -> float:
    """The size of the change of a slip."""
    x = slip(c, after, element, 0) - slip(c, before, element, 0)
    return hypot(x, slip(c, after, element, 1) - slip(c, before, element, 1))


def stage(
    c: Contacts, y: Array, inputs: Array, t: float, length: float, first_length: float, ignored: Integers, found: Array
) -> int:
    """Take the next part of a step: `EVENT` where it ends with an event, or `ENDS`; `FAILED` if it is not finite.

    :param first_length: what to try first, unless slips turn much faster than they change.
    :param ignored: 1 for guards that make no event.
    :param found: becomes its length, and 1 if a slip is so slow at the end that it counts as zero.
    """
    failed = 0
    for _ in range(MOST_SHORTENED):
        status = stage_within(c, y, inputs, t, length, first_length, ignored, found)
        if status != AGAIN and (status != FAILED or failed == MOST_FAILED):
            return status
        if status == FAILED:  # beyond an event, features may have no meaning
            failed += 1
        length *= SHORTENING
    return FAILED


def stage_within(
    c: Contacts, y: Array, inputs: Array, t: float, length: float, first_length: float, ignored: Integers, found: Array
) -> int:
    """As `stage`; `AGAIN` if only a shorter part can have constant directions of friction."""
    count = c.inputs if c.pairs else 0
    s = Sliding(
        integers(c.frictions), integers(c.frictions), integers(c.frictions), zeros(2 * c.frictions), zeros(count),
        zeros(count),
    )  # fmt: skip
    start, left_out, cause, first = zeros(readings_size(c)), integers(c.guards), integers(1), NONE
    for guard in range(c.guards):
        left_out[guard] = ignored[guard]
    own, is_sliding, is_steady = inputs, find_sliding(c, inputs, s, left_out), False
    if is_sliding:
        read(c, t, y, inputs, start)
        turn(c, start, inputs, s)
        for i in range(count):
            s.inputs[i] = inputs[i]
        own = s.inputs
    n = readings_size(c)
    m = TrialPart(
        y, own, t, zeros(1), zeros(n), zeros(c.size), zeros(n), zeros(1), zeros(c.size), zeros(n), zeros(c.places),
        zeros(c.places), zeros(c.places), zeros(1), integers(2), integers(1),
    )  # fmt: skip
    begin(c, m, length)
    for i in range(n):
        start[i] = m.before[i]
    if is_sliding:
        is_steady = follow(c, m, s, length, first_length)
        first = stop_of(c, m, s)
    if not_finite(c, m):
        return FAILED
    first = first_event(c, m, first, left_out, cause)
    if first == 0.0 and is_steady and was_positive(c, m, start, left_out, cause[0]):
        return AGAIN
    if first >= NONE:
        first = first_change(c, m, first, True)
    if first < NONE or has_failed(m):
        return FAILED
    return take(c, m, s, y, first, found)


def take(c: Contacts, m: TrialPart, s: Sliding, y: Array, first: float, found: Array) -> int:
    """Change y to the end of a part of a step, up to the `first` event if there is one."""
    found[0] = m.span[0] if first < 0.0 else first
    found[1] = 1.0 if first < 0.0 and creeps(c, m, s) else 0.0
    is_end = found[0] == m.span[0]
    if not is_end and found[0] != m.latest[0]:
        try_length(c, m, found[0], m.state, m.out, m.places)
    if has_failed(m):
        return FAILED
    for i in range(c.size):
        y[i] = m.end[i] if is_end else m.state[i]
    return EVENT if first >= 0.0 else ENDS


def find_sliding(c: Contacts, inputs: Array, s: Sliding, left_out: Integers) -> bool:
    """Find what slides along two directions; the guards of its friction are left out."""
    found = False
    for k in range(c.frictions):
        s.all[k] = is_pair(c, k) and slides(c, inputs, k)
        if s.all[k]:
            found = True
            left_out[c.gaps + k] = 1
    return found


def not_finite(c: Contacts, m: TrialPart) -> bool:
    """Whether a state or a guard was not finite, or bodies that touch have been pressed into each other."""
    if has_failed(m) or any(not math.isfinite(m.after[guard_at(c, k)]) for k in range(c.guards)):
        return True
    return any(is_closed_gap(c, m, gap) and m.after[1 + gap] < -UNHELD * c.gap_units[gap] for gap in range(c.gaps))


def is_closed_gap(c: Contacts, m: TrialPart, gap: int) -> bool:
    """Whether a gap, which is a position, is closed."""
    return m.inputs[c.first_mode + gap] != 0.0 and not c.clutches[gap]


def was_positive(c: Contacts, m: TrialPart, start: Array, left_out: Integers, cause: int) -> bool:
    """Whether a guard is negative only with directions of friction as they are at the end."""
    return any(
        m.after[guard_at(c, k)] < -c.tolerance
        and not left_out[k]
        and k >= cause
        and start[guard_at(c, k)] > c.tolerance
        for k in range(c.guards)
    )


def creeps(c: Contacts, m: TrialPart, s: Sliding) -> bool:
    """Whether a slip is so slow at the end that it counts as zero."""
    stopped = STOPPED * c.unit_speed
    return any(s.all[k] and c.slow < speed_of(c, m.after, k) <= stopped for k in range(c.frictions))


def turn(c: Contacts, readings: Array, inputs: Array, s: Sliding) -> None:
    """Store the present directions of sliding."""
    for k in range(c.frictions):
        if s.all[k]:
            speed = speed_of(c, readings, k)
            if speed > c.slow:
                for direction in range(2):
                    at = direction_at(c, c.friction_rows[2 * k + direction])
                    inputs[at] = slip(c, readings, k, direction) / speed


def follow(c: Contacts, m: TrialPart, s: Sliding, length: float, first_length: float) -> bool:
    """Take the motion in which slips do not turn much, or have constant directions; whether friction is steady."""
    if not find_turning(c, m, s, length) or keeps_straight(c, m, s):
        return False
    longest = steady_length(c, m, s, length)
    if any(s.steady[k] for k in range(c.frictions)):
        along_fixed(c, m, s, longest)
        return True
    resolve_turning(c, m, s, min(length, first_length))
    return False


def find_turning(c: Contacts, m: TrialPart, s: Sliding, length: float) -> bool:
    """Find the elements whose slip changes, or could turn, by much within a length; also those that begin to slide."""
    found = False
    for k in range(c.frictions):
        s.turning[k] = 0
        if s.all[k]:
            speed, rate = speed_of(c, m.before, k), max(turning_at(c, m.before, k), turning_at(c, m.after, k))
            change = change_of_slip(c, m.before, m.after, k)
            s.turning[k] = change > TURNING * speed or (speed > c.slow and length * rate > STIFF)
            found = found or s.turning[k] != 0
            for direction in range(2):
                s.directions[2 * k + direction] = m.inputs[direction_at(c, c.friction_rows[2 * k + direction])]
    return found


def with_directions(c: Contacts, m: TrialPart, s: Sliding, marks: Integers) -> None:
    """Let some elements keep their directions in the motion with other inputs."""
    for i in range(c.inputs):
        s.given[i] = m.inputs[i]
    for k in range(c.frictions):
        if marks[k]:
            for direction in range(2):
                at = direction_at(c, c.friction_rows[2 * k + direction])
                s.given[at] = FIXED * s.directions[2 * k + direction]


def keeps_straight(c: Contacts, m: TrialPart, s: Sliding) -> bool:
    """Take the motion with constant directions of friction, if the slips keep these directions."""
    n, noise = readings_size(c), NOISE * c.unit_speed
    with_directions(c, m, s, s.turning)
    fixed = TrialPart(
        m.y, s.given, m.t, zeros(1), zeros(n), zeros(c.size), zeros(n), zeros(1), m.state, m.out, m.places_before,
        zeros(c.places), m.places, m.offset, m.shrinking, integers(1),
    )  # fmt: skip
    begin(c, fixed, m.span[0])
    if has_failed(fixed):
        m.failed[0] = 1
    for k in range(c.frictions):
        if s.turning[k] and not is_straight(c, s, fixed, k, noise):
            return False
    take_motion(c, m, s, fixed)
    return True


def is_straight(c: Contacts, s: Sliding, fixed: TrialPart, k: int, noise: float) -> bool:
    """Whether a slip has the direction before and after it has changed, or has reversed it."""
    x, y = s.directions[2 * k], s.directions[2 * k + 1]
    across = abs(x * slip(c, fixed.before, k, 1) - y * slip(c, fixed.before, k, 0))
    across = max(across, abs(x * slip(c, fixed.after, k, 1) - y * slip(c, fixed.after, k, 0)))
    return across <= STRAIGHT * change_of_slip(c, fixed.before, fixed.after, k) + noise


def take_motion(c: Contacts, m: TrialPart, s: Sliding, fixed: TrialPart) -> None:
    """Let the motion be that with constant directions."""
    for i in range(c.inputs):
        m.inputs[i] = s.given[i]
    for i in range(readings_size(c)):
        m.before[i], m.after[i] = fixed.before[i], fixed.after[i]
    for i in range(c.size):
        m.end[i] = fixed.end[i]
    for i in range(c.places):
        m.places_after[i] = fixed.places_after[i]
    m.latest[0] = NONE


def steady_length(c: Contacts, m: TrialPart, s: Sliding, length: float) -> float:
    """Find the elements whose friction turns their slip much faster than it changes, and how long it does."""
    fastest, soon = 0.0, m.out
    for k in range(c.frictions):
        s.steady[k] = 0
        if s.turning[k] and speed_of(c, m.before, k) > c.slow:
            fastest = max(fastest, turning_at(c, m.before, k) / STIFF)
    if length * fastest <= STEADY:
        return length
    brief = BRIEF / fastest
    soon = readings_at(c, m, brief)
    for k in range(c.frictions):
        if s.turning[k] and speed_of(c, m.before, k) > c.slow:
            change = change_of_slip(c, m.before, soon, k) / brief
            if change > 0.0:
                length = min(length, SHORTER * TURNING * speed_of(c, m.before, k) / change)
    if length * fastest > STEADY:
        for k in range(c.frictions):
            is_moving = s.turning[k] and speed_of(c, m.before, k) > c.slow
            s.steady[k] = is_moving and length * turning_at(c, m.before, k) / STIFF > 1.0
    return length


def resolve_turning(c: Contacts, m: TrialPart, s: Sliding, length: float) -> None:
    """Let the motion end before a slip turns much."""
    shortest = SHORTEST * max(1.0 / c.unit_rate, abs(m.t))
    if length != m.span[0]:
        finish(c, m, length)
    while length > shortest:
        shorter = length_resolved(c, m, s, length)
        if shorter >= length:
            break
        length = max(shorter, shortest)
        finish(c, m, length)


def length_resolved(c: Contacts, m: TrialPart, s: Sliding, length: float) -> float:
    """A length within which no slip turns much."""
    share, stopped = 1.0, STOPPED * c.unit_speed
    for k in range(c.frictions):
        if s.all[k]:
            speed, change = speed_of(c, m.before, k), change_of_slip(c, m.before, m.after, k)
            if speed <= c.slow:  # sliding begins; no method is accurate in that, but for a short while
                if change > stopped:
                    share = min(share, SHORTER * stopped / change)
                continue
            rate = max(turning_at(c, m.before, k), turning_at(c, m.after, k)) if speed > stopped else 0.0
            excess = max(change / ((TURNING if speed > stopped else STOPPING) * speed), length * rate / STIFF)
            if excess > 1.0:
                share = min(share, max(SHORTER / excess, SHORTENING))
    return share * length


def along_fixed(c: Contacts, m: TrialPart, s: Sliding, length: float) -> None:
    """Take the motion with constant directions of friction, which are those that the slips have at the end.

    That is stable however fast friction turns the slips; these are then so slow that it is accurate as well.
    """
    n = c.pairs
    found, last, jacobian, step = zeros(n), math.inf, zeros(n * n), zeros(n)
    start, moved, count = zeros(2 * c.frictions), zeros(n), 0
    for k in range(c.frictions):
        count += s.steady[k]
    slip_across(c, m, s, length, found)
    for _ in range(NEWTON_STEPS):
        for i in range(2 * c.frictions):
            start[i] = s.directions[i]
        column = 0
        for k in range(c.frictions):
            if s.steady[k]:
                rotate(s.directions, k, ANGLE)
                slip_across(c, m, s, length, moved)
                for row in range(count):
                    jacobian[row * count + column] = (moved[row] - found[row]) / ANGLE
                for i in range(2 * c.frictions):
                    s.directions[i] = start[i]
                column += 1
        solve(count, jacobian, found, step)
        row = 0
        for k in range(c.frictions):
            if s.steady[k]:
                rotate(s.directions, k, -step[row])
                row += 1
        last = largest(count, found)
        slip_across(c, m, s, length, found)
        if not largest(count, found) < 0.5 * last:
            break
    for i in range(c.inputs):
        m.inputs[i] = s.given[i]
    m.latest[0] = NONE
    read(c, m.t, m.y, m.inputs, m.before)


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


def stop_of(c: Contacts, m: TrialPart, s: Sliding) -> float:
    """Where a slip along two directions stops, at which the motion then ends: that beyond a stop means nothing."""
    first = NONE
    for k in range(c.frictions):
        if s.all[k] and m.span[0] > 0.0 and speed_of(c, m.before, k) > c.slow:
            start, last = forward(c, m.before, m.before, k), forward(c, m.before, m.after, k)
            if last < 0.0:
                first = first_zero(c, m, FORWARD, k, m.span[0], start, last, 0.0)
                finish(c, m, first)
    return first
