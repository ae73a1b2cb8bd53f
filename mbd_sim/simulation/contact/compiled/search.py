"""The first event of a motion, in the subset of Python that is compiled: see `mbd_sim.simulation.contact.search`."""

from __future__ import annotations

import math

from mbd_sim.compiler.ir.python_functions import Array, Integers, integers, zeros
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


def try_length(c: Contacts, y: Array, inputs: Array, t: float, length: float, state: Array, out: Array) -> bool:
    """The state and the readings after a length in s; False where it does not stay finite."""
    for i in range(c.size):
        state[i] = y[i]
    if length != 0.0 and PART_STEP(c.part_step, state, inputs, t, length) < 0:
        return False
    read(c, t + length, state, inputs, out)
    return True


def value_of(c: Contacts, out: Array, what: int, index: int) -> float:
    """One of the values of which a zero is sought."""
    if what == GUARD:
        return out[guard_at(c, index)]
    if what == GAP:
        return out[1 + index] / c.gap_units[index]
    return -out[rate_at(c, index)]


def first_zero(
    c: Contacts, y: Array, inputs: Array, t: float, what: int, index: int,
    length: float, start: float, end: float, tolerance: float,
) -> float:  # fmt: skip
    """Where a value that ends negative leaves its positive values within (0, `length`], to round-off.

    :param start: its value at 0. If that is zero, up to the `tolerance`, or negative, a positive value is sought after
        it; without one the result is 0: it was not positive from the start.
    :param end: its value at `length`, negative.
    """
    state, out = zeros(c.size), zeros(readings_size(c))
    low, f_low, high, f_high = 0.0, start, length, end
    if not f_low > tolerance:
        probe = length
        count = 0
        while count < BACKTRACKS:
            probe *= 0.5
            if not try_length(c, y, inputs, t, probe, state, out):
                return DIVERGED
            found = value_of(c, out, what, index)
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
        if not try_length(c, y, inputs, t, middle, state, out):
            return DIVERGED
        found = value_of(c, out, what, index)
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


def earlier(
    c: Contacts, y: Array, inputs: Array, t: float, what: int, index: int, first: float, length: float,
    state: Array, out: Array,
) -> float:  # fmt: skip
    """The zero of a value that is negative at the end, if it is earlier than the `first` until now.

    :param state: and `out` are memory.
    """
    end = length if first < 0.0 else first
    if end == 0.0:
        return first
    if not try_length(c, y, inputs, t, end, state, out):
        return DIVERGED
    last = value_of(c, out, what, index)
    if last >= -c.tolerance:
        return first
    try_length(c, y, inputs, t, 0.0, state, out)
    return first_zero(c, y, inputs, t, what, index, end, value_of(c, out, what, index), last, c.tolerance)


def first_event(
    c: Contacts, y: Array, inputs: Array, t: float, length: float, first: float, left_out: Integers, cause: Integers
) -> float:
    """The length up to the first event of a motion, if it is before the `first` until now.

    :param left_out: 1 for guards (guards,) that make no event.
    :param cause: becomes the guard of it, where it is one; -1 otherwise.
    """
    state, out, before, after = zeros(c.size), zeros(readings_size(c)), zeros(readings_size(c)), zeros(readings_size(c))
    cause[0] = -1
    try_length(c, y, inputs, t, 0.0, state, before)
    if not try_length(c, y, inputs, t, length, state, after):
        return DIVERGED
    for guard in range(c.guards):
        if after[guard_at(c, guard)] < -c.tolerance and not left_out[guard]:
            found = earlier(c, y, inputs, t, GUARD, guard, first, length, state, out)
            if found == DIVERGED:
                return DIVERGED
            if found != first:
                cause[0] = guard
            first = found
    for gap in range(c.gaps):
        if may_graze(c, inputs, before, after, gap, length):
            first = grazing(c, y, inputs, t, gap, first, length, before, after)
            if first == DIVERGED:
                return DIVERGED
    return first


def may_graze(c: Contacts, inputs: Array, before: Array, after: Array, gap: int, length: float) -> bool:
    """Whether a gap that turns back may have been negative in between."""
    down, up = before[rate_at(c, gap)], after[rate_at(c, gap)]
    limit = c.tolerance * c.gap_units[gap]
    if not (down < 0.0 and up > 0.0 and before[1 + gap] > limit and after[1 + gap] >= -limit):
        return False
    nearest = min(before[1 + gap], after[1 + gap])
    is_near = nearest <= limit + FALLING * length * max(-down, up)
    return is_near and inputs[c.first_mode + gap] == 0.0 and not c.clutches[gap] and not c.slots[gap]


def grazing(
    c: Contacts, y: Array, inputs: Array, t: float, gap: int, first: float, length: float, before: Array, after: Array
) -> float:
    """Where a gap that turns within the step becomes zero before that, if that is the first event."""
    state, out = zeros(c.size), zeros(readings_size(c))
    start, end = value_of(c, before, RATE, gap), value_of(c, after, RATE, gap)
    lowest = first_zero(c, y, inputs, t, RATE, gap, length, start, end, 0.0)
    if lowest == DIVERGED:
        return DIVERGED
    if first >= 0.0 and first <= lowest:
        return first if first == 0.0 else earlier(c, y, inputs, t, GAP, gap, first, length, state, out)
    found = earlier(c, y, inputs, t, GAP, gap, lowest, length, state, out)
    return found if found != lowest else first


def stage(c: Contacts, y: Array, inputs: Array, t: float, length: float, ignored: Integers, found: Array) -> int:
    """Take the next part of a step, while nothing slides along two directions: 1 where it ends with an event, or 0.

    Negative where the state would not stay finite. `found[0]` becomes its length.
    """
    out, cause = zeros(readings_size(c)), integers(1)
    state = zeros(c.size)
    if not try_length(c, y, inputs, t, length, state, out):
        return -1
    for guard in range(c.guards):
        if not math.isfinite(out[guard_at(c, guard)]):
            return -1
    first = first_event(c, y, inputs, t, length, NONE, ignored, cause)
    if first == DIVERGED:
        return -1
    found[0] = length if first < 0.0 else first
    if not try_length(c, y, inputs, t, found[0], state, out):
        return -1
    for i in range(c.size):
        y[i] = state[i]
    return 1 if first >= 0.0 else 0


def slides_in_space(c: Contacts, inputs: Array) -> bool:
    """Whether something slides along two directions."""
    return any(c.friction_rows[2 * k + 1] >= 0 and slides(c, inputs, k) for k in range(c.frictions))
