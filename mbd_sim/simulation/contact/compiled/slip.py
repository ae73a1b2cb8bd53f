"""Parts of steps, in which slip along two directions does not turn much, in the subset of Python that is compiled.

The directions of sliding among the inputs follow the slip.
"""

from __future__ import annotations

import math

from mbd_sim.compiler.ir.python_kinds import Array, Integers, integers, zeros
from mbd_sim.compiler.steps.guarded import STIFF, TURNING
from mbd_sim.simulation.contact.compiled.collocation import begin_slopes, collocated, find_effects, remember
from mbd_sim.simulation.contact.compiled.instant.contacts import (
    Contacts,
    direction_at,
    guard_at,
    read,
    read_poses,
    read_rates,
    readings_size,
    slides,
    turning_at,
)
from mbd_sim.simulation.contact.compiled.instant.sliding import (
    STAGES,
    Sliding,
    change_of_slip,
    forward,
    is_pair,
    slip,
    speed_of,
    with_directions,
)
from mbd_sim.simulation.contact.compiled.lengths import (
    ACCURATE,
    LONGER,
    SHORTER,
    length_of_transient,
    length_to_close,
    length_to_stop,
    share_with,
    turns_little,
)
from mbd_sim.simulation.contact.compiled.nodes import first_crossing
from mbd_sim.simulation.contact.compiled.search import first_change, first_event, first_zero
from mbd_sim.simulation.contact.compiled.trial import FORWARD, NONE, TrialPart, begin, finish, has_failed, try_length

STOPPED = 1e-8  # of the natural speed, up to which slip along two directions counts as zero: it turns ever faster
STOPPING = 4.0  # of such a slip velocity, by which it may change within a step
CURVED = 1e-8  # part of a change of slip across it, with the slopes at the start, beyond which it is not straight
STRAIGHT = 1e-10  # part of a change of slip across it, up to which it keeps its direction
NOISE = 1e-15  # of the natural speed, in slip
SHORTENING = 0.25  # of a length, at most; the motion beyond a stop says little
NEARLY = 0.999  # of a length, from which on a guard that becomes negative needs no shorter one
MOST_CROSSINGS = 8  # attempts up to where a guard becomes negative, before far shorter ones: it may do so at any length
AFTER = 1.0 + 1e-6  # of the length up to where a guard becomes negative, that a motion has
GROWTH = 3.0  # of the length that would have been accurate: after a transient, the next one can be longer
AS_LONG = 1.2  # the same where turning has limited its length: shorter by `SHORTER` than it could be
UNHELD = (
    1e-8  # of the natural length, depth of a closed gap that no force could hold: a drive presses, and nothing yields
)
SHORTEST = 1e-15  # of the natural time, and of the time
MOST_SHORTENED = 20  # times that a part of a step is shortened because its end is not finite
ENDS, EVENT, FAILED = 0, 1, -1  # of a part of a step


def stage(
    c: Contacts, y: Array, inputs: Array, t: float, length: float, first_length: float, ignored: Integers, found: Array
) -> int:
    """Take the next part of a step: `EVENT` where it ends with an event, or `ENDS`; `FAILED` if it is not finite.

    :param first_length: what to try first.
    :param ignored: 1 for guards that make no event.
    :param found: becomes its length, 1 if a slip is so slow at the end that it counts as zero, and what to try next.
    """
    status = FAILED
    for _ in range(MOST_SHORTENED):
        status = stage_within(c, y, inputs, t, length, first_length, ignored, found)
        if status != FAILED:
            break
        length = SHORTENING * min(length, first_length)  # beyond an event, features may have no meaning
    return status


def stage_within(
    c: Contacts, y: Array, inputs: Array, t: float, length: float, first_length: float, ignored: Integers, found: Array
) -> int:
    """As `stage`, without another attempt where the state is not finite."""
    pairs = number_sliding(c, inputs)
    count, many = c.inputs if pairs else 0, STAGES + 1 if pairs else 0
    left_out, cause, first = integers(c.guards), integers(1), NONE
    for guard in range(c.guards):
        left_out[guard] = ignored[guard]
    s = Sliding(
        integers(c.frictions), left_out, integers(c.frictions), integers(1), zeros(2 * c.frictions),
        zeros(count), zeros(count), zeros(many * c.size), zeros(2 * many * c.frictions), zeros(pairs * c.size),
        zeros(pairs * pairs), zeros(many * c.size), zeros(2 * many * c.frictions), zeros(1),
        zeros(many * (c.guards + c.frictions)),
    )  # fmt: skip
    own, n, is_conditioned = inputs, readings_size(c), False
    before = zeros(n)
    if pairs:
        find_sliding(c, inputs, s, left_out)
        read_rates(c, t, y, inputs, before)
        turn(c, before, inputs, s)
        for i in range(count):
            s.inputs[i] = inputs[i]
        own = s.inputs
        is_conditioned = begin_slopes(c, s, y, inputs, t, before)
    else:
        read(c, t, y, inputs, before)
    m = TrialPart(
        y, own, t, zeros(1), before, zeros(c.size), zeros(n), zeros(1), zeros(c.size), zeros(n), zeros(c.places),
        zeros(c.places), zeros(c.places), zeros(1), integers(2), integers(1), zeros(2 * c.size + 1), s,
    )  # fmt: skip
    if has_jumped(c, inputs, before, left_out):  # by a jump of a force, from which it may recover soon
        found[0], found[1], found[2] = 0.0, 0.0, math.inf
        return EVENT
    m.span[0] = min(length, first_length)
    found[2] = LONGER * m.span[0] if first_length < length else math.inf
    if pairs:
        found[2] = follow(c, m, found[2], first_length == math.inf, is_conditioned)
        first = stop_of(c, m)
    else:
        read_poses(c, t, y, inputs, m.places_before)
        m.latest[0] = NONE
        finish(c, m, m.span[0])
    if not_finite(c, m):
        return FAILED
    first = first_event(c, m, first, left_out, cause)
    if first >= NONE:
        first = first_change(c, m, first, True)
    if first < NONE or has_failed(m):
        return FAILED
    return take(c, m, y, first, found)


def take(c: Contacts, m: TrialPart, y: Array, first: float, found: Array) -> int:
    """Change y to the end of a part of a step, up to the `first` event if there is one."""
    found[0] = m.span[0] if first < 0.0 else first
    found[1] = 1.0 if first < 0.0 and creeps(c, m) else 0.0
    is_end = found[0] == m.span[0]
    if not is_end and found[0] != m.latest[0]:
        try_length(c, m, found[0], m.state, m.out, m.places)
    if has_failed(m):
        return FAILED
    for i in range(c.size):
        y[i] = m.end[i] if is_end else m.state[i]
    return EVENT if first >= 0.0 else ENDS


def number_sliding(c: Contacts, inputs: Array) -> int:
    """How many elements slide along two directions."""
    found = 0
    for k in range(c.frictions):
        if is_pair(c, k) and slides(c, inputs, k):
            found += 1
    return found


def find_sliding(c: Contacts, inputs: Array, s: Sliding, left_out: Integers) -> None:
    """Find what slides along two directions; the guards of its friction are left out."""
    for k in range(c.frictions):
        s.all[k] = is_pair(c, k) and slides(c, inputs, k)
        if s.all[k]:
            left_out[c.gaps + k] = 1


def has_jumped(c: Contacts, inputs: Array, readings: Array, left_out: Integers) -> bool:
    """Whether the guard of a force is negative that is not left out; gaps that are open do not jump."""
    return any(
        readings[guard_at(c, k)] < -c.tolerance
        and not left_out[k]
        and not (k < c.gaps and inputs[c.first_mode + k] == 0.0)
        for k in range(c.guards)
    )


def not_finite(c: Contacts, m: TrialPart) -> bool:
    """Whether a state or a guard was not finite, or bodies that touch have been pressed into each other."""
    if has_failed(m) or any(not math.isfinite(m.after[guard_at(c, k)]) for k in range(c.guards)):
        return True
    return any(is_closed_gap(c, m, gap) and m.after[1 + gap] < -UNHELD * c.gap_units[gap] for gap in range(c.gaps))


def is_closed_gap(c: Contacts, m: TrialPart, gap: int) -> bool:
    """Whether a gap, which is a position, is closed."""
    return m.inputs[c.first_mode + gap] != 0.0 and not c.clutches[gap]


def creeps(c: Contacts, m: TrialPart) -> bool:
    """Whether a slip is so slow at the end that it counts as zero."""
    s, stopped = m.sliding, STOPPED * c.unit_speed
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


def follow(c: Contacts, m: TrialPart, following: float, is_first: bool, is_conditioned: bool) -> float:
    """Take the motion in which slips do not turn much, keep their directions, or are turned by friction.

    The result is the length to try next, which is `following` where turning does not limit that.
    """
    length, ahead, soon, spared = m.span[0], zeros(readings_size(c)), 0.0, m.span[0]
    read_poses(c, m.t, m.y, m.inputs, m.places_before)
    m.latest[0] = NONE
    begin_ahead(c, m, length, ahead)
    soon = length_to_close(c, m, length, ahead)
    if soon < length:
        length, m.span[0], following = soon, soon, LONGER * soon
        spared = math.inf  # collocation finds where it closes with fewer evaluations, whatever turns
        begin_ahead(c, m, length, ahead)
    if not find_fast(c, m, spared):
        finish(c, m, length)
        if not find_turning(c, m, length):
            return following
    if is_conditioned:
        if may_keep_straight(c, m, ahead) and keeps_straight(c, m):
            return following
        find_effects(c, m.sliding, m.y, m.inputs, m.t, length, m.before)
        length = length_to_stop(c, m, length, ahead)
        if is_first:
            length = length_of_transient(c, m, length, ahead)
        longer = along_turning(c, m, length)
        if longer > 0.0:
            return longer
    m.failed[0] = 0
    finish(c, m, m.span[0])
    resolve_turning(c, m)
    return AS_LONG * m.span[0]


def find_fast(c: Contacts, m: TrialPart, length: float) -> bool:
    """Find the elements that friction could turn by much within a length, and those that begin to slide."""
    s, found = m.sliding, False
    for k in range(c.frictions):
        s.turning[k] = 0
        if s.all[k]:
            s.turning[k] = speed_of(c, m.before, k) <= c.slow or length * turning_at(c, m.before, k) > STIFF
            found = found or s.turning[k] != 0
            for direction in range(2):
                s.directions[2 * k + direction] = m.inputs[direction_at(c, c.friction_rows[2 * k + direction])]
    return found


def find_turning(c: Contacts, m: TrialPart, length: float) -> bool:
    """Find also those whose slip changes by much within a length, or could turn at its end."""
    s, found = m.sliding, False
    for k in range(c.frictions):
        if s.all[k]:
            speed, change = speed_of(c, m.before, k), change_of_slip(c, m.before, m.after, k)
            s.turning[k] = change > TURNING * speed or length * turning_at(c, m.after, k) > STIFF
            found = found or s.turning[k] != 0
    return found


def begin_ahead(c: Contacts, m: TrialPart, length: float, ahead: Array) -> None:
    """The gaps and rates after a length with the slopes at the start."""
    state = zeros(c.size)
    for i in range(c.size):
        state[i] = m.y[i] + length * m.sliding.slopes[i]
    read_rates(c, m.t + length, state, m.inputs, ahead)


def may_keep_straight(c: Contacts, m: TrialPart, ahead: Array) -> bool:
    """Whether slips that turn could keep their directions, as the slopes at the start tell it."""
    noise = NOISE * c.unit_speed
    for k in range(c.frictions):
        if m.sliding.turning[k]:
            x, y = m.sliding.directions[2 * k], m.sliding.directions[2 * k + 1]
            most = abs(x * slip(c, ahead, k, 1) - y * slip(c, ahead, k, 0))
            if most > CURVED * change_of_slip(c, m.before, ahead, k) + noise:
                return False
    return True


def keeps_straight(c: Contacts, m: TrialPart) -> bool:
    """Take the motion with constant directions of friction, if the slips keep these directions."""
    s, n, noise = m.sliding, readings_size(c), NOISE * c.unit_speed
    with_directions(c, s, m.inputs, s.directions)
    fixed = TrialPart(
        m.y, s.given, m.t, zeros(1), zeros(n), zeros(c.size), zeros(n), zeros(1), m.state, m.out, m.places_before,
        zeros(c.places), m.places, m.offset, m.shrinking, integers(1), m.ends, s,
    )  # fmt: skip
    begin(c, fixed, m.span[0])
    if has_failed(fixed):
        m.failed[0] = 1
    for k in range(c.frictions):
        if s.turning[k] and not is_straight(c, s, fixed, k, noise):
            return False
    take_motion(c, m, fixed)
    return True


def is_straight(c: Contacts, s: Sliding, fixed: TrialPart, k: int, noise: float) -> bool:
    """Whether a slip has the direction before and after it has changed, or has reversed it."""
    x, y = s.directions[2 * k], s.directions[2 * k + 1]
    most = abs(x * slip(c, fixed.before, k, 1) - y * slip(c, fixed.before, k, 0))
    most = max(most, abs(x * slip(c, fixed.after, k, 1) - y * slip(c, fixed.after, k, 0)))
    return most <= STRAIGHT * change_of_slip(c, fixed.before, fixed.after, k) + noise


def take_motion(c: Contacts, m: TrialPart, fixed: TrialPart) -> None:
    """Let the motion be that with constant directions."""
    for i in range(c.inputs):
        m.inputs[i] = m.sliding.given[i]
    for i in range(readings_size(c)):
        m.before[i], m.after[i] = fixed.before[i], fixed.after[i]
    for i in range(c.size):
        m.end[i] = fixed.end[i]
    for i in range(c.places):
        m.places_after[i] = fixed.places_after[i]
    m.latest[0] = NONE


def along_turning(c: Contacts, m: TrialPart, length: float) -> float:
    """Take a motion in which friction turns slips, for a length in which it is accurate; what length to try next.

    The result is 0 where there is none.
    """
    s, shortest, crossings = m.sliding, SHORTEST * max(1.0 / c.unit_rate, abs(m.t)), 0
    while length > shortest:
        error, share = collocated(c, s, m.y, m.inputs, m.t, length, ACCURATE, m.end), SHORTENING
        if math.isfinite(error):
            share = share_with(error)
            remember(c, s, length)
        if error <= ACCURATE:
            read(c, m.t + length, m.end, m.inputs, m.after)
            crossing = first_crossing(c, s)
            if 0.0 < crossing < NEARLY:
                crossings += 1
                share = (AFTER if crossings <= MOST_CROSSINGS else SHORTENING) * crossing
            elif turns_little(c, m):
                read_poses(c, m.t + length, m.end, m.inputs, m.places_after)
                s.is_collocated[0], m.span[0] = 1, length
                return GROWTH * share * length
            else:
                share = SHORTENING
        length *= share
    s.is_collocated[0] = 0
    return 0.0


def resolve_turning(c: Contacts, m: TrialPart) -> None:
    """Let the motion end before a slip turns much."""
    length, shortest = m.span[0], SHORTEST * max(1.0 / c.unit_rate, abs(m.t))
    while length > shortest:
        shorter = length_resolved(c, m, length)
        if shorter >= length:
            break
        length = max(shorter, shortest)
        finish(c, m, length)


def length_resolved(c: Contacts, m: TrialPart, length: float) -> float:
    """A length within which no slip turns much."""
    share, stopped = 1.0, STOPPED * c.unit_speed
    for k in range(c.frictions):
        if m.sliding.all[k]:
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


def stop_of(c: Contacts, m: TrialPart) -> float:
    """Where a slip along two directions stops, at which the motion then ends: that beyond a stop means nothing."""
    first, found = NONE, 0.0
    for k in range(c.frictions):
        if m.sliding.all[k] and m.span[0] > 0.0:
            start, last = forward(c, m.sliding, m.before, k), forward(c, m.sliding, m.after, k)
            if last < 0.0:
                found = first_zero(c, m, FORWARD, k, m.span[0], start, last, 0.0)
            if last < 0.0 and found > 0.0:  # otherwise it has not begun
                first = found
                finish(c, m, first)
    return first
