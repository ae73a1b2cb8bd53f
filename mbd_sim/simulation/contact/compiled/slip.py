"""Parts of steps, in which slip along two directions does not turn much, in the subset of Python that is compiled.

The directions of sliding among the inputs follow the slip.
"""

from __future__ import annotations

import math

from mbd_sim.compiler.ir.python_kinds import Array, Integers, integers, zeros
from mbd_sim.compiler.steps.guarded import STIFF, TURNING
from mbd_sim.simulation.contact.compiled.instant.contacts import (
    Contacts,
    direction_at,
    guard_at,
    read,
    readings_size,
    slides,
    turning_at,
)
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
    try_length,
)
from mbd_sim.simulation.contact.compiled.sliding import (
    Sliding,
    change_of_slip,
    is_pair,
    slip,
    speed_of,
    with_directions,
)
from mbd_sim.simulation.contact.compiled.steady_slip import (
    SHORTENING,
    SHORTER,
    SHORTEST,
    STOPPED,
    along_steady,
    steady_length,
)

STOPPING = 4.0  # of such a slip velocity, by which it may change within a step
STRAIGHT = 1e-10  # part of a change of slip across it, up to which it keeps its direction
BENT = 1e-4  # part of such a change in the motion with slips that turn, from which on it does not
NOISE = 1e-15  # of the natural speed, in slip
UNHELD = (
    1e-8  # of the natural length, depth of a closed gap that no force could hold: a drive presses, and nothing yields
)
MOST_SHORTENED = 500  # times that a part of a step is shortened
MOST_FAILED = 20  # times that a part of a step is shortened because its end is not finite
ENDS, EVENT, FAILED, AGAIN = 0, 1, -1, 2  # of a part of a step


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
    if along_steady(c, m, s, steady_length(c, m, s, length)):
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


def keeps_straight(c: Contacts, m: TrialPart, s: Sliding) -> bool:
    """Take the motion with constant directions of friction, if the slips keep these directions.

    Then they keep them in the motion that was taken as well, but for round-off.
    """
    n, noise = readings_size(c), NOISE * c.unit_speed
    for k in range(c.frictions):
        if s.turning[k] and not is_straight(c, s, m, k, BENT, BENT * c.slow):
            return False
    with_directions(c, m, s, s.turning)
    fixed = TrialPart(
        m.y, s.given, m.t, zeros(1), zeros(n), zeros(c.size), zeros(n), zeros(1), m.state, m.out, m.places_before,
        zeros(c.places), m.places, m.offset, m.shrinking, integers(1),
    )  # fmt: skip
    begin(c, fixed, m.span[0])
    if has_failed(fixed):
        m.failed[0] = 1
    for k in range(c.frictions):
        if s.turning[k] and not is_straight(c, s, fixed, k, STRAIGHT, noise):
            return False
    take_motion(c, m, s, fixed)
    return True


def is_straight(c: Contacts, s: Sliding, m: TrialPart, k: int, part: float, noise: float) -> bool:
    """Whether a slip has its direction before and after it has changed, or has reversed it.

    :param part: of its change, that may be across the direction, besides the noise.
    """
    x, y = s.directions[2 * k], s.directions[2 * k + 1]
    across = abs(x * slip(c, m.before, k, 1) - y * slip(c, m.before, k, 0))
    across = max(across, abs(x * slip(c, m.after, k, 1) - y * slip(c, m.after, k, 0)))
    return across <= part * change_of_slip(c, m.before, m.after, k) + noise


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
