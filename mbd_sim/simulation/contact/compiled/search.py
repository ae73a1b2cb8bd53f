"""The first event of a motion, in the subset of Python that is compiled.

The instant at which a value becomes zero within a part of a step is found by a bracketing root finder on the step from
the state at its start.
"""

from __future__ import annotations

import math

from mbd_sim.compiler.ir.python_kinds import Integers, zeros
from mbd_sim.simulation.contact.compiled.instant.contacts import Contacts, guard_at, rate_at
from mbd_sim.simulation.contact.compiled.instant.modes import RESTING
from mbd_sim.simulation.contact.compiled.pairs import PATH as ALONG
from mbd_sim.simulation.contact.compiled.pairs import any_closed, beyond_gaps, may_meet, note, pair_at, path_between
from mbd_sim.simulation.contact.compiled.touching import AREA, NEAREST, ROOM, WIDE, WIDTH, area_at, narrow
from mbd_sim.simulation.contact.compiled.trial import (
    APART,
    BESIDE,
    FEATURES,
    FORESEEN,
    FORWARD,
    GAP,
    GUARD,
    NONE,
    RATE,
    WIDENING,
    TrialPart,
    features_at,
    foreseen,
    has_failed,
    may_foresee,
    near_value,
    next_share,
    places_at,
    readings_at,
    value_of,
)

ITERATIONS = 100
ROUNDING = 2.0**-50  # of a bracket, next to which no place is tried, or of a length, if the place is rounded to this
NEAREST_START = 2.0**-40  # of a length, up to which a positive value is sought after a start at zero
BACKTRACK = 0.5  # of a length, in this search
LONG_BACKTRACK = 2.0**-4  # the same where friction has two directions: such motions cost more
WITHIN = 0.1  # of the tolerance of a guard, where collocation finds its zero: what a gap lacks there costs energy
RESOLUTION = 2.0**-52  # of the time, within which instants are not distinguished there
# Of the length times the larger rate at both ends: how far a gap may fall below its values there. A cubic with these
# values and rates falls by less than 8/27 of it.
FALLING = 10.0
BRIEF = 2.0**-8  # of a step, in which the rate of a distance is measured
NARROWING = 60  # thirds by which the lowest distance within a step is sought
ENOUGH = 1e-3  # of the tolerance, up to which a change of features is where it is sought
NOISE = 5e-3  # of the tolerance, below which round-off in the positions of bodies may prevent that
FINE = 4  # attempts on both sides of which values are below it
DEEPER = 0.02  # of the tolerance, by which bodies must be deeper at an impact than at the one before, beyond round-off
DIVERGED = -2.0


def first_zero(
    c: Contacts, m: TrialPart, what: int, index: int, length: float, start: float, end: float, tolerance: float
) -> float:
    """Where a value that is negative at the `end` leaves its positive values before that, to round-off.

    If it is zero, up to the `tolerance`, or negative at the `start`, a positive value is sought after it; without one
    the result is 0: it was not positive from the start.
    """
    low, f_low, high, f_high = 0.0, start, length, end
    if not f_low > tolerance:
        probe, share = length, LONG_BACKTRACK if c.pairs else BACKTRACK
        while probe > NEAREST_START * length:
            probe *= share
            found = value_of(c, m, probe, what, index)
            if found > tolerance:
                low, f_low = probe, found
                break
            high, f_high = probe, found
            if found >= -tolerance:  # nearer to the start nothing can be told from round-off
                break
        if low == 0.0:
            return 0.0
    best, least, accuracy = high, abs(f_high), c.accuracy if what in (BESIDE, FEATURES) else 0.0
    if abs(f_low) < abs(f_high):
        best, least = low, f_low
    above, below = enough_above(c, m, what, tolerance), enough_below(c, m, what, tolerance)
    shortest, share, fine = RESOLUTION * (m.t + length) if c.pairs else 0.0, f_low / (f_low - f_high), 0
    new, f_new, other, f_other, old, f_old = low, f_low, high, f_high, high, f_high  # the zero is between the first two
    foresees = may_foresee(c, what)
    for count in range(ITERATIONS):
        width = abs(other - new)
        if foresees and count < FORESEEN:
            place = foreseen(c, m, what, index, new, f_new + 0.5 * below, other, f_other + 0.5 * below, 0.1 * below)
            share = abs(place - new) / width if place != new else share
        least_share = max(shortest / width, ROUNDING)
        place = new + max(least_share, min(1.0 - least_share, share)) * (other - new)
        if place == new and least > tolerance:  # it was rounded to this
            place += ROUNDING * max(new, other) / width * (other - new)
        if not min(new, other) < place < max(new, other) or 2.0 * shortest > width:
            break
        found = value_of(c, m, place, what, index)
        if not math.isfinite(found):
            break
        if abs(found) < least:
            best, least = place, abs(found)
        if -below <= found <= above:
            return place
        if (found > 0.0) == (f_new > 0.0):
            old, f_old = new, f_new
        else:
            old, f_old, other, f_other = other, f_other, new, f_new
        new, f_new = place, found
        fine += 1 if max(abs(f_new), abs(f_other)) <= NOISE * accuracy else 0
        if fine > FINE:
            break
        share = next_share(new, f_new, other, f_other, old, f_old)
    high = new if f_new < 0.0 else other
    return best if least <= tolerance else high


def enough_below(c: Contacts, m: TrialPart, what: int, tolerance: float) -> float:
    """How negative a value may be where it counts as zero."""
    if what in (BESIDE, FEATURES):
        return ENOUGH * c.accuracy
    return enough_above(c, m, what, tolerance)


def enough_above(c: Contacts, m: TrialPart, what: int, tolerance: float) -> float:
    """How large a value may be where it counts as zero: a slip without a direction, or the error of collocation."""
    if what == FORWARD:
        return c.slow
    return WITHIN * tolerance if m.sliding.is_collocated[0] else 0.0


def earlier(c: Contacts, m: TrialPart, what: int, index: int, first: float) -> float:
    """The zero of a value that is negative at the end, if it is earlier than the `first` until now."""
    end = m.span[0] if first < 0.0 else first
    if end == 0.0:
        return first
    last = value_of(c, m, end, what, index)
    if last >= -c.tolerance:
        return first
    return first_zero(c, m, what, index, end, value_of(c, m, 0.0, what, index), last, c.tolerance)


def first_event(c: Contacts, m: TrialPart, first: float, left_out: Integers, cause: Integers) -> float:
    """The length up to the first event of a motion, if it is before the `first` until now.

    :param left_out: 1 for guards (guards,) that make no event.
    :param cause: becomes the guard of it, where it is one; -1 otherwise.
    """
    cause[0] = -1
    for guard in range(c.guards):
        if m.after[guard_at(c, guard)] < -c.tolerance and not left_out[guard]:
            found = earlier(c, m, GUARD, guard, first)
            if found != first:
                cause[0] = guard
            first = found
    for gap in range(c.gaps):
        if may_graze(c, m, gap):
            first = grazing(c, m, gap, first)
        if first < 0.0 and not left_out[gap] and closes_at_end(c, m, gap):
            first = m.span[0]
    return DIVERGED if has_failed(m) else first


def closes_at_end(c: Contacts, m: TrialPart, gap: int) -> bool:
    """Whether an open gap that is zero at the end, to round-off, approaches there."""
    if m.inputs[c.first_mode + gap] != 0.0 or c.clutches[gap] or c.slots[gap] or not m.span[0] > 0.0:
        return False
    is_zero = abs(m.after[1 + gap]) <= WITHIN * c.tolerance * c.gap_units[gap]
    return is_zero and m.after[rate_at(c, gap)] < -RESTING * c.row_speeds[gap]


def may_graze(c: Contacts, m: TrialPart, gap: int) -> bool:
    """Whether a gap that turns back may have been negative in between."""
    down, up = m.before[rate_at(c, gap)], m.after[rate_at(c, gap)]
    limit = c.tolerance * c.gap_units[gap]
    if not (down < 0.0 and up > 0.0 and m.before[1 + gap] > limit and m.after[1 + gap] >= -limit):
        return False
    nearest = min(m.before[1 + gap], m.after[1 + gap])
    is_near = nearest <= limit + FALLING * m.span[0] * max(-down, up)
    return is_near and m.inputs[c.first_mode + gap] == 0.0 and not c.clutches[gap] and not c.slots[gap]


def grazing(c: Contacts, m: TrialPart, gap: int, first: float) -> float:
    """Where a gap that turns within the step becomes zero before that, if that is the first event."""
    start, end = -m.before[rate_at(c, gap)], -m.after[rate_at(c, gap)]
    lowest = first_zero(c, m, RATE, gap, m.span[0], start, end, 0.0)
    if first >= 0.0 and first <= lowest:
        return first if first == 0.0 else earlier(c, m, GAP, gap, first)
    found = earlier(c, m, GAP, gap, lowest)
    return found if found != lowest else first


def first_change(c: Contacts, m: TrialPart, first: float, exact: bool) -> float:
    """Where two bodies meet or features change, if that is before the `first` event; if not `exact`, somewhat later."""
    end, latest, found = m.span[0] if first < 0.0 else first, -1, NONE
    for _ in range(c.body_pairs if exact else 1):  # at an earlier end, others may be within each other
        for index in range(c.body_pairs):
            if end == 0.0 or index == latest:  # nothing is earlier
                return DIVERGED if has_failed(m) else first
            if may_meet(c, pair_at(c, index), m.inputs, m.places_before, places_at(c, m, end)):
                found = change_of(c, m, index, end, exact)
                if found >= 0.0:
                    first, end, latest = found, found, index
        if latest < 0:
            break
    return DIVERGED if has_failed(m) else first


def change_of(c: Contacts, m: TrialPart, index: int, end: float, exact: bool) -> float:
    """Where two bodies meet or their features change, before an end; if not `exact`, the end will do."""
    pair, closed = pair_at(c, index), any_closed(c, pair_at(c, index), m.inputs)
    readings, places = readings_at(c, m, end), places_at(c, m, end)
    area, first = zeros(AREA), NONE
    last = beyond_gaps(c, pair, m.inputs, m.places_before, places, readings)
    note(pair, places, last)
    if not math.isfinite(last):
        m.failed[0] = 1
        return NONE
    m.shrinking[0], m.shrinking[1] = 1, 1
    if last >= 0.0 and features_at(c, m, pair, places) >= 0.0:
        path = ALONG * path_between(pair, m.places_before, places)
        return widened(c, m, index, path, end) if closed else passed(c, m, index, path, end, last)
    start = beyond_gaps(c, pair, m.inputs, m.places_before, m.places_before, m.before)
    m.offset[0] = 0.0
    if closed or start <= c.accuracy:
        m.offset[0] = (c.accuracy if closed else DEEPER * c.accuracy) + max(0.0, -start)
    area_at(c, pair, m.inputs, m.places_before, area)
    m.shrinking[0], m.shrinking[1] = area[NEAREST] > narrow(pair), area[WIDTH] > narrow(pair)
    for what in range(BESIDE, FEATURES + 1):  # not the least of both, which has a kink where it becomes zero
        last = value_of(c, m, end, what, index)
        if last < 0.0 and not exact:
            return end
        if last < 0.0:
            first = first_zero(c, m, what, index, end, value_of(c, m, 0.0, what, index), last, 0.0)
            end = first
    return first


def widened(c: Contacts, m: TrialPart, index: int, path: float, end: float) -> float:
    """Where bodies that touch in a point or a line begin to do so in a wider area: near the borders of features.

    :param path: how far in m they can move against each other in the step.
    """
    pair, area = pair_at(c, index), zeros(AREA)
    area_at(c, pair, m.inputs, m.places_before, area)
    if area[ROOM] > WIDE * narrow(pair) + path or not value_of(c, m, end, WIDENING, index) < 0.0:
        return NONE
    start = value_of(c, m, 0.0, WIDENING, index)
    return first_zero(c, m, WIDENING, index, end, start, -1.0, 0.0) if start > 0.0 else NONE


def passed(c: Contacts, m: TrialPart, index: int, path: float, end: float, last: float) -> float:
    """Where bodies meet that are apart at both ends of a step, but turn back or pass each other within it.

    :param path: how far in m they can move against each other in the step.
    """
    if last >= path:
        return NONE
    start, brief = value_of(c, m, 0.0, APART, index), BRIEF * end
    if start + last >= path or start <= c.accuracy:
        return NONE
    if rises(c, m, index, 0.0, brief) or not rises(c, m, index, end - brief, end):
        return NONE
    low, high, lowest = 0.0, end, 0.0
    for _ in range(NARROWING):
        one, other = low + (high - low) / 3.0, high - (high - low) / 3.0
        if rises(c, m, index, one, other):
            high = other
        else:
            low = one
    lowest = value_of(c, m, low, APART, index)
    return first_zero(c, m, APART, index, low, start, lowest, 0.0) if lowest < 0.0 else NONE


def rises(c: Contacts, m: TrialPart, index: int, one: float, other: float) -> bool:
    """Whether bodies are farther apart at a later place of a motion, as far as this is foreseen."""
    if may_foresee(c, APART):
        return near_value(c, m, other, APART, index) >= near_value(c, m, one, APART, index)
    return value_of(c, m, other, APART, index) >= value_of(c, m, one, APART, index)
