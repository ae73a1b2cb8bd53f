"""The motion from a state on, and the values that tell of events in it, in the subset of Python that is compiled.

Each length at which a value is read costs a motion up to there, with dozens of evaluations. Where collocation or a
cubic between both ends says where bodies are, nearly, it costs about one. The root finder tries the places that are
foreseen so, and what it finds is a zero of the exact values.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from mbd_sim.compiler.ir.python_kinds import Array, Integers, zeros
from mbd_sim.simulation.contact.compiled.collocation import collocated, guess, state_at
from mbd_sim.simulation.contact.compiled.instant.contacts import (
    PART_STEP,
    START,
    Contacts,
    guard_at,
    rate_at,
    read,
    read_poses,
    read_rates,
    readings_size,
)
from mbd_sim.simulation.contact.compiled.instant.sliding import STAGES, Sliding, forward
from mbd_sim.simulation.contact.compiled.pairs import FeaturePair, beyond_gaps, distance_at, pair_at
from mbd_sim.simulation.contact.compiled.touching import AREA, NEAREST, ROOM, WIDTH, area_at, has_widened, narrow

# What is to become zero: a guard, a gap in its unit, the rate at which a gap closes, the distance of two bodies, what
# says that they meet beside their closed slots, or that the features of these change, the slip of friction along its
# first direction, or what is negative where an area of contact has widened.
GUARD, GAP, RATE, APART, BESIDE, FEATURES, FORWARD, WIDENING = 0, 1, 2, 3, 4, 5, 6, 7
NONE = -1.0  # in place of a length
FORESEEN = 4  # attempts of the root finder at places that are foreseen
PLACES = 40  # tried for each of them
CLOSE = 1e-3  # of the latest value, which the next one may have by that


@dataclass(frozen=True)
class TrialPart:
    """The motion from a state on, for up to a length in s, which is `span[0]`.

    `before` are the readings at its start, `end` and `after` the state and the readings after this length, and `state`
    and `out` those after the `latest` other length that was tried. The poses of the parts in mechanisms with slots are
    `places_before`, `places_after` and `places`. `offset[0]` is added to a distance of which a zero is sought. Slots
    can come near each other if `shrinking[0]` is 1, and their area can shrink to a line if `shrinking[1]` is. `failed`
    is 1 if a state was not finite. What slides along two directions is `sliding`. Where that is not collocated, `ends`
    (2 n + 1,) are the slopes at the start and at the end of a motion, and its length: see `near`.
    """

    y: Array
    inputs: Array
    t: float
    span: Array
    before: Array
    end: Array
    after: Array
    latest: Array
    state: Array
    out: Array
    places_before: Array
    places_after: Array
    places: Array
    offset: Array
    shrinking: Integers
    failed: Integers
    ends: Array
    sliding: Sliding


def begin(c: Contacts, m: TrialPart, length: float) -> None:
    """Find the state after a length, and the readings at both ends."""
    read(c, m.t, m.y, m.inputs, m.before)
    read_poses(c, m.t, m.y, m.inputs, m.places_before)
    m.latest[0] = NONE
    finish(c, m, length)


def finish(c: Contacts, m: TrialPart, length: float) -> None:
    """Let the motion end after another length."""
    m.span[0] = length
    if length != m.latest[0]:
        try_length(c, m, length, m.end, m.after, m.places_after)
        return
    for i in range(c.size):
        m.end[i] = m.state[i]
    for i in range(readings_size(c)):
        m.after[i] = m.out[i]
    for i in range(c.places):
        m.places_after[i] = m.places[i]


def try_length(c: Contacts, m: TrialPart, length: float, state: Array, out: Array, places: Array) -> None:
    """The state, the readings and the poses after a length in s."""
    for i in range(c.size):
        state[i] = m.y[i]
    if length != 0.0 and m.sliding.is_collocated[0]:
        if not math.isfinite(collocated(c, m.sliding, m.y, m.inputs, m.t, length, math.inf, state)):
            m.failed[0] = 1
    elif length != 0.0 and PART_STEP(c.part_step, state, m.inputs, m.t, length) < 0:
        m.failed[0] = 1
    read(c, m.t + length, state, m.inputs, out)
    read_poses(c, m.t + length, state, m.inputs, places)


def readings_at(c: Contacts, m: TrialPart, length: float) -> Array:
    """The readings after a length in s."""
    if length == 0.0:
        return m.before
    if length == m.span[0]:
        return m.after
    if length != m.latest[0]:
        m.latest[0] = length
        try_length(c, m, length, m.state, m.out, m.places)
    return m.out


def places_at(c: Contacts, m: TrialPart, length: float) -> Array:
    """The poses of all parts after a length in s."""
    readings_at(c, m, length)
    if length == 0.0:
        return m.places_before
    return m.places_after if length == m.span[0] else m.places


def has_failed(m: TrialPart) -> bool:
    """Whether a state was not finite."""
    return m.failed[0] != 0


def value_of(c: Contacts, m: TrialPart, length: float, what: int, index: int) -> float:
    """One of the values of which a zero is sought, after a length in s."""
    return value_in(c, m, readings_at(c, m, length), places_at(c, m, length), what, index)


def value_in(c: Contacts, m: TrialPart, readings: Array, places: Array, what: int, index: int) -> float:
    """The same from the readings and the poses of the parts."""
    if what == GUARD:
        return readings[guard_at(c, index)]
    if what == GAP:
        return readings[1 + index] / c.gap_units[index]
    if what == RATE:
        return -readings[rate_at(c, index)]
    if what == FORWARD:
        return forward(c, m.sliding, readings, index)
    pair = pair_at(c, index)
    if what == APART:
        return distance_at(pair, places)
    if what == WIDENING:
        return -1.0 if has_widened(c, pair, m.inputs, places) else 1.0
    if what == BESIDE:
        return beyond_gaps(c, pair, m.inputs, m.places_before, places, readings) + m.offset[0]
    return features_at(c, m, pair, places)


def features_at(c: Contacts, m: TrialPart, pair: FeaturePair, places: Array) -> float:
    """What becomes zero where the features of closed slots change, or the area in which two bodies touch shrinks."""
    area, least = zeros(AREA), narrow(pair)
    area_at(c, pair, m.inputs, places, area)
    found = area[ROOM] + c.accuracy
    if m.shrinking[0]:
        found = min(found, area[NEAREST] - least)
    if m.shrinking[1]:
        found = min(found, area[WIDTH] - least)
    return found


def may_foresee(c: Contacts, what: int) -> bool:
    """Whether a value follows from the poses of parts, which are read far sooner than a motion is found."""
    return what in (APART, BESIDE, FEATURES) and c.gaps_and_rates != 0


def foreseen(
    c: Contacts, m: TrialPart, what: int, index: int, place: float, value: float, other: float, there: float,
    enough: float,
) -> float:  # fmt: skip
    """Where a value becomes zero between its latest place and another one, nearly.

    What the approximate motion misses at both places is taken to change linearly in between.

    :param value: at the latest place, with the opposite sign of that `there`, at the other one.
    :param enough: how far from zero it may be.
    """
    missed = value - near_value(c, m, place, what, index)
    change = (there - near_value(c, m, other, what, index)) - missed
    new, f_new, old, f_old, low, f_low = place, value, other, there, other, there
    found, f_found, share, close = place, value, 0.5, max(enough, CLOSE * abs(value))
    for _ in range(PLACES):
        share = next_share(new, f_new, low, f_low, old, f_old) if old != low else f_new / (f_new - f_low)
        found = new + share * (low - new)
        if not min(new, low) < found < max(new, low):
            return found
        f_found = near_value(c, m, found, what, index) + missed + change * (found - place) / (other - place)
        if abs(f_found) <= close or not math.isfinite(f_found):
            return found
        if (f_found > 0.0) == (f_new > 0.0):
            old, f_old = new, f_new
        else:
            old, f_old, low, f_low = low, f_low, new, f_new
        new, f_new = found, f_found
    return found


def next_share(x: float, f: float, other: float, f_other: float, old: float, f_old: float) -> float:
    """Where between x and the other end of a bracket a zero is sought next, after an older place.

    Inverse quadratic interpolation where it is monotonic in the bracket, else the middle: T. R. Chandrupatla, A new
    hybrid quadratic/bisection algorithm for finding the zero of a nonlinear function without using derivatives,
    Advances in Engineering Software 28 (1997) 145-149.
    """
    position, height = (x - other) / (old - other), (f - f_other) / (f_old - f_other)
    if not (height * height < position and (1.0 - height) * (1.0 - height) < 1.0 - position):
        return 0.5
    slope = (old - x) / (other - x)
    return f / (f_other - f) * f_old / (f_other - f_old) + slope * f / (f_old - f) * f_other / (f_old - f_other)


def near_value(c: Contacts, m: TrialPart, length: float, what: int, index: int) -> float:
    """About the value after a length in s."""
    state, readings, places = zeros(c.size), zeros(readings_size(c)), zeros(c.places)
    near(c, m, length, state)
    if what == BESIDE:
        read_rates(c, m.t + length, state, m.inputs, readings)
    read_poses(c, m.t + length, state, m.inputs, places)
    return value_in(c, m, readings, places, what, index)


def near(c: Contacts, m: TrialPart, length: float, state: Array) -> None:
    """About the state after a length in s: by collocation, or else by the cubic with the slopes at both ends."""
    n, span, time, readings, x = c.size, m.span[0], zeros(1), zeros(readings_size(c)), 0.0
    if m.sliding.is_collocated[0]:
        guess(c, m.sliding, length)
        state_at(c, m.sliding, m.y, length, STAGES, state)
        return
    if m.ends[2 * n] != span:
        m.ends[2 * n], time[0] = span, m.t
        START(c.start, time, m.y, m.inputs, m.ends, readings)
        time[0] = m.t + span
        START(c.start, time, m.end, m.inputs, m.ends[n:], readings)
    x = length / span
    for i in range(n):
        change, first, last = m.end[i] - m.y[i], span * m.ends[i], span * m.ends[n + i]
        state[i] = m.y[i] + x * (first + x * (3.0 * change - 2.0 * first - last + x * (first + last - 2.0 * change)))
