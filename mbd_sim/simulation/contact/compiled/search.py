"""The first event of a motion, in the subset of Python that is compiled: see `mbd_sim.simulation.contact.search`.

The root finder is that of `mbd_sim.base.roots`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from mbd_sim.compiler.ir.python_kinds import Array, Integers, integers, zeros
from mbd_sim.simulation.contact.compiled.contacts import (
    PART_STEP,
    Contacts,
    guard_at,
    rate_at,
    read,
    readings_size,
    slides,
)

ITERATIONS = 80
BACKTRACKS = 40  # halvings in search of a positive value after a start at zero
# Of the length times the larger rate at both ends: how far a gap may fall below its values there. A cubic with these
# values and rates falls by less than 8/27 of it.
FALLING = 10.0
GUARD, GAP, RATE = 0, 1, 2  # what is to become zero: a guard, a gap in its unit, or the rate at which a gap closes
NONE = -1.0  # in place of the length up to an event
DIVERGED = -2.0


@dataclass(frozen=True)
class TrialPart:
    """The motion from a state on, for up to a `length` in s.

    `before` are the readings at its start, `end` and `after` the state and the readings after the `length`, and `state`
    and `out` those after the `latest` other length that was tried. `failed` is 1 if one was not finite.
    """

    y: Array
    inputs: Array
    t: float
    length: float
    before: Array
    end: Array
    after: Array
    latest: Array
    state: Array
    out: Array
    failed: Integers


def begin(c: Contacts, m: TrialPart) -> None:
    """Find the readings at both ends."""
    read(c, m.t, m.y, m.inputs, m.before)
    m.latest[0] = NONE
    try_length(c, m, m.length, m.end, m.after)


def try_length(c: Contacts, m: TrialPart, length: float, state: Array, out: Array) -> None:
    """The state and the readings after a length in s."""
    for i in range(c.size):
        state[i] = m.y[i]
    if length != 0.0 and PART_STEP(c.part_step, state, m.inputs, m.t, length) < 0:
        m.failed[0] = 1
    read(c, m.t + length, state, m.inputs, out)


def has_failed(m: TrialPart) -> bool:
    """Whether a state was not finite."""
    return m.failed[0] != 0


def value_of(c: Contacts, m: TrialPart, length: float, what: int, index: int) -> float:
    """One of the values of which a zero is sought, after a length in s."""
    readings = m.out
    if length in (0.0, m.length):
        readings = m.before if length == 0.0 else m.after
    elif length != m.latest[0]:
        m.latest[0] = length
        try_length(c, m, length, m.state, m.out)
    if what == GUARD:
        return readings[guard_at(c, index)]
    if what == GAP:
        return readings[1 + index] / c.gap_units[index]
    return -readings[rate_at(c, index)]


def first_zero(c: Contacts, m: TrialPart, what: int, index: int, length: float, tolerance: float) -> float:
    """Where a value that is negative after a length leaves its positive values before that, to round-off.

    If it is zero, up to the `tolerance`, or negative at the start, a positive value is sought after it; without one the
    result is 0: it was not positive from the start.
    """
    low, f_low, high, f_high = 0.0, value_of(c, m, 0.0, what, index), length, value_of(c, m, length, what, index)
    if not f_low > tolerance:
        probe = length
        count = 0
        while count < BACKTRACKS:
            probe *= 0.5
            found = value_of(c, m, probe, what, index)
            if found > tolerance:
                low, f_low = probe, found
                break
            high, f_high = probe, found
            count += 1
        if count == BACKTRACKS:
            return 0.0
    best, least = high, abs(f_high)
    if abs(f_low) < abs(f_high):
        best, least = low, f_low
    side = 0
    for count in range(ITERATIONS):
        middle = (low * f_high - high * f_low) / (f_high - f_low)
        if count % 4 == 3 or not low < middle < high:
            middle = 0.5 * (low + high)
        if middle in (low, high):
            break
        found = value_of(c, m, middle, what, index)
        if not math.isfinite(found):
            break
        if abs(found) < least:
            best, least = middle, abs(found)
        if found == 0.0:
            return middle
        if found > 0.0:
            if side > 0:
                factor = 1.0 - found / f_low
                f_high *= factor if factor > 0.0 else 0.5
            low, f_low, side = middle, found, 1
        else:
            if side < 0:
                factor = 1.0 - found / f_high
                f_low *= factor if factor > 0.0 else 0.5
            high, f_high, side = middle, found, -1
    return best if least <= tolerance else high


def earlier(c: Contacts, m: TrialPart, what: int, index: int, first: float) -> float:
    """The zero of a value that is negative at the end, if it is earlier than the `first` until now."""
    end = m.length if first < 0.0 else first
    if end == 0.0 or value_of(c, m, end, what, index) >= -c.tolerance:
        return first
    return first_zero(c, m, what, index, end, c.tolerance)


def first_of(c: Contacts, m: TrialPart, first: float, left_out: Integers, cause: Integers) -> float:
    """The length up to the first event of a motion, if it is before the `first` until now: see `first_event`."""
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
    return DIVERGED if has_failed(m) else first


def may_graze(c: Contacts, m: TrialPart, gap: int) -> bool:
    """Whether a gap that turns back may have been negative in between."""
    down, up = m.before[rate_at(c, gap)], m.after[rate_at(c, gap)]
    limit = c.tolerance * c.gap_units[gap]
    if not (down < 0.0 and up > 0.0 and m.before[1 + gap] > limit and m.after[1 + gap] >= -limit):
        return False
    nearest = min(m.before[1 + gap], m.after[1 + gap])
    is_near = nearest <= limit + FALLING * m.length * max(-down, up)
    return is_near and m.inputs[c.first_mode + gap] == 0.0 and not c.clutches[gap] and not c.slots[gap]


def grazing(c: Contacts, m: TrialPart, gap: int, first: float) -> float:
    """Where a gap that turns within the step becomes zero before that, if that is the first event."""
    lowest = first_zero(c, m, RATE, gap, m.length, 0.0)
    if first >= 0.0 and first <= lowest:
        return first if first == 0.0 else earlier(c, m, GAP, gap, first)
    found = earlier(c, m, GAP, gap, lowest)
    return found if found != lowest else first


def first_event(
    c: Contacts, y: Array, inputs: Array, t: float, length: float, first: float, left_out: Integers, cause: Integers
) -> float:
    """The length up to the first event of a motion, if it is before the `first` until now.

    :param left_out: 1 for guards (guards,) that make no event.
    :param cause: becomes the guard of it, where it is one; -1 otherwise.
    """
    n, readings = c.size, readings_size(c)
    m = TrialPart(
        y, inputs, t, length, zeros(readings), zeros(n), zeros(readings), zeros(1), zeros(n), zeros(readings),
        integers(1),
    )  # fmt: skip
    begin(c, m)
    return first_of(c, m, first, left_out, cause)


def stage(c: Contacts, y: Array, inputs: Array, t: float, length: float, ignored: Integers, found: Array) -> int:
    """Take the next part of a step, while nothing slides along two directions: 1 where it ends with an event, or 0.

    Negative where the state would not stay finite. `found[0]` becomes its length.
    """
    n, readings, cause = c.size, readings_size(c), integers(1)
    m = TrialPart(
        y, inputs, t, length, zeros(readings), zeros(n), zeros(readings), zeros(1), zeros(n), zeros(readings),
        integers(1),
    )  # fmt: skip
    begin(c, m)
    if has_failed(m) or any(not math.isfinite(m.after[guard_at(c, k)]) for k in range(c.guards)):
        return -1
    first = first_of(c, m, NONE, ignored, cause)
    found[0] = length if first < 0.0 else first
    is_end = found[0] == length
    if not is_end and found[0] != m.latest[0]:
        try_length(c, m, found[0], m.state, m.out)
    if has_failed(m):
        return -1
    for i in range(n):
        y[i] = m.end[i] if is_end else m.state[i]
    return 1 if first >= 0.0 else 0


def slides_in_space(c: Contacts, inputs: Array) -> bool:
    """Whether something slides along two directions."""
    return any(c.friction_rows[2 * k + 1] >= 0 and slides(c, inputs, k) for k in range(c.frictions))
