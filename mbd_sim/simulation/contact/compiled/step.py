"""Steps with events, in the subset of Python that is compiled: see `mbd_sim.simulation.contact.stepper`.

Whatever is not simple, such as contacts that share their forces, is left to the caller, with nothing changed.
"""

from __future__ import annotations

import math

from mbd_sim.compiler.ir.python_kinds import Array, Integers, integers, zeros
from mbd_sim.simulation.contact.compiled.instant.candidate_forces import length_along, read_terms, terms_size
from mbd_sim.simulation.contact.compiled.instant.contacts import (
    ADVANCE,
    DECIDE,
    NOTE,
    PART_STEP,
    READ,
    READ_STATE,
    Contacts,
    guard_at,
    is_sliding,
    rate_at,
    read,
    read_poses,
    readings_size,
    slides,
)
from mbd_sim.simulation.contact.compiled.instant.impact import impact, return_at_once
from mbd_sim.simulation.contact.compiled.instant.modes import RESTING, STOPPED, find_modes, is_touching
from mbd_sim.simulation.contact.compiled.instant.sliding import Sliding
from mbd_sim.simulation.contact.compiled.lengths import LONGER
from mbd_sim.simulation.contact.compiled.pairs import hold, is_far, may_meet, pair_at, see, travel
from mbd_sim.simulation.contact.compiled.search import first_change
from mbd_sim.simulation.contact.compiled.slip import EVENT, stage
from mbd_sim.simulation.contact.compiled.touching import end_step, renew
from mbd_sim.simulation.contact.compiled.trial import NONE, TrialPart

MOST_EVENTS = 500  # in one step, beyond which nothing rebounds; beyond twice as many the step goes on without events
MOST_STAGES = 5000  # of a step
MOST_AT_ONCE = 20  # events at one instant, beyond which their guards wait until time has passed
FEW_AT_ONCE, AT_ONCE = 4, 1e-9  # the same in a step with many events, and how long an instant is there, of the step
BRIEF = 1e-6  # of a step, after which guards that could change nothing are examined again
DENSE = 100  # events in one step, beyond which the next one is sought near first, and contacts come to rest sooner
SOONER = 1.2  # times the speed at which they do, with each further event
NEAR = 8.0  # times the latest time between events, within which it is sought
KEPT = 0.5  # of that time, which counts after one event more, however soon that came
CREEPING = 20  # parts of a step that end with a slip which counts as zero, until it stops if it can
CLOSED, OPENED, STICKS, SLIDES, IMPACT, ENERGIES, BOUND = 0, 1, 2, 3, 4, 5, 6  # changes
# Of an event: its time, the change, the gap or friction element, and of an impact the impulse and the loss. Energies
# have those before and after an impact instead.
FIELDS = 5
OF_PAIR = 1_000_000  # by which the number of a pair, from 1 on, is multiplied in the index of an event
CAPACITY = 500  # events
DONE, HARD, NOT_FINITE, UNSOLVED = 0, 1, -1, -2  # why steps have ended
MANY_PAIRS = (
    100  # of bodies, from which on what the parts have travelled is added up: below, that takes longer than it saves
)
SAME, CHANGED, NOT_SIMPLE, NO_SOLUTION = 0, 1, -1, -2  # what an event has done


def advance(
    c: Contacts, y: Array, inputs: Array, first: int, h: float, steps: int, estimate: Array,
    events: Array, counts: Integers,
) -> int:  # fmt: skip
    """Take steps up to one that cannot be taken here; the number of steps that were taken.

    :param events: (`CAPACITY`, `FIELDS`) receives the events.
    :param counts: becomes their number, and why the steps have ended.
    """
    done, taken, kept, saved = 0, 0, zeros(c.size), zeros(c.modes)
    counts[0] = 0
    while done < steps:
        taken = steps_without_event(c, y, inputs, first + done, h, steps - done, estimate)
        if taken < 0:
            counts[1] = NOT_FINITE
            return done
        done += taken
        if done == steps:
            break
        for i in range(c.size):
            kept[i] = y[i]
        for i in range(c.modes):
            saved[i] = inputs[c.first_mode + i]
        hold(c, inputs)
        counts[1] = step(c, y, inputs, (first + done) * h, (first + done + 1) * h, events, counts)
        if c.lacking[0] != 0:
            counts[1] = HARD
        if counts[1] != DONE:
            for i in range(c.size):
                y[i] = kept[i]
            for i in range(c.modes):
                inputs[c.first_mode + i] = saved[i]
            return done
        done += 1
        end_step(c, (first + done) * h, y, inputs)
    counts[1] = DONE
    return done


def steps_without_event(c: Contacts, y: Array, inputs: Array, first: int, h: float, steps: int, estimate: Array) -> int:
    """Take steps up to one with an event, or which may only be taken in parts; their number.

    Negative if the state would not stay finite, of mechanisms without slots.
    """
    taken, found, before = 0, 0, zeros(c.size)
    places, places_after = zeros(c.places), zeros(c.places)
    if c.body_pairs == 0:
        return ADVANCE(c.advance, y, inputs, first, h, steps, estimate)
    read_poses(c, first * h, y, inputs, places)
    while taken < steps:
        for i in range(c.size):
            before[i] = y[i]
        found = ADVANCE(c.advance, y, inputs, first + taken, h, 1, estimate)
        if found == 0:
            return taken
        read_poses(c, (first + taken + 1) * h, y, inputs, places_after)
        for k in range(c.held_count):
            before[c.held[k]] = y[c.held[k]]
        if found < 0 or (
            may_change(c, inputs, places, places_after) and changes(c, before, y, inputs, (first + taken) * h, h)
        ):
            for i in range(c.size):
                y[i] = before[i]
            for i in range(c.history):
                inputs[c.inputs + i] = 0.0
            return taken
        taken += 1
        end_step(c, (first + taken) * h, y, inputs)
        for i in range(c.places):
            places[i] = places_after[i]
    return taken


def may_change(c: Contacts, inputs: Array, before: Array, after: Array) -> bool:
    """Whether two bodies may have met, or their features may have changed."""
    hold(c, inputs)
    if c.body_pairs < MANY_PAIRS:
        return any(may_meet(c, pair_at(c, index), inputs, before, after) for index in range(c.body_pairs))
    travel(c, before, after)
    for index in range(c.body_pairs):
        pair = pair_at(c, index)
        if not is_far(c, pair):
            see(c, pair, after)
            if may_meet(c, pair, inputs, before, after):
                return True
    return False


def changes(c: Contacts, before: Array, y: Array, inputs: Array, t: float, h: float) -> bool:
    """Whether two bodies meet or features change in a step from a state to another, or this is not known."""
    n, s = readings_size(c), Sliding(
        integers(0), integers(0), integers(0), integers(1), zeros(0), zeros(0), zeros(0), zeros(0), zeros(0), zeros(0),
        zeros(0), zeros(0), zeros(0), zeros(1), zeros(0),
    )  # fmt: skip
    m = TrialPart(
        before, inputs, t, zeros(1), zeros(n), y, zeros(n), zeros(1), zeros(c.size), zeros(n),
        zeros(c.places), zeros(c.places), zeros(c.places), zeros(1), integers(2), integers(1), zeros(2 * c.size + 1), s,
    )  # fmt: skip
    m.span[0], m.latest[0] = h, NONE
    read(c, t, before, inputs, m.before)
    read(c, t + h, y, inputs, m.after)
    read_poses(c, t, before, inputs, m.places_before)
    read_poses(c, t + h, y, inputs, m.places_after)
    return first_change(c, m, NONE, False) != NONE


def step(c: Contacts, y: Array, inputs: Array, start: float, end: float, events: Array, counts: Integers) -> int:
    """Take a step with events; y and modes are not restored where it cannot be taken."""
    t, instants, creeping, longest, is_ignored = start, 0, 0, math.inf, False
    brief, count, status, length, result, creeps = BRIEF * (end - start), 0, 0, 0.0, 0, False
    ignored, opening, yielding, found = integers(c.guards), integers(c.gaps), integers(c.frictions), zeros(3)
    near, between, passed, rest = math.inf, 0.0, 0.0, c.rest_speed
    fastest = max(rest, c.unit_speed * c.unit_rate * (end - start))
    for _ in range(MOST_STAGES):
        length = min(min(end - t, near), brief) if is_ignored else min(end - t, near)
        status = stage(c, y, inputs, t, length, longest, ignored, found)
        if status < 0:
            return NOT_FINITE
        length = found[0]
        longest = math.inf if status == EVENT else found[2]
        is_last = length >= end - t
        passes = length > (AT_ONCE * (end - start) if instants > DENSE else 0.0)
        t = end if is_last else t + length
        passed += length
        near *= LONGER
        creeping += 1 if found[1] > 0.0 else 0
        if passes and (status == EVENT or creeping > CREEPING or is_ignored):
            count = 0
            clear(c.gaps, opening)
            clear(c.frictions, yielding)
        if status == EVENT or creeping > CREEPING:
            creeps = status != EVENT
            creeping = 0
            instants += 1
            between, passed = max(passed, KEPT * between), 0.0
            if instants > DENSE:
                near = NEAR * between if between > 0.0 else math.inf
                rest = min(SOONER * rest, fastest)
            if instants > 2 * MOST_EVENTS:
                break
            count += 1
            result = change(c, t, y, inputs, opening, yielding, instants <= MOST_EVENTS, rest, ignored, events, counts)
            if result < 0:
                return HARD if result == NOT_SIMPLE else UNSOLVED
            if creeps and result == SAME:
                creeping = -MOST_STAGES  # a slip that counts as zero goes on
            is_ignored = (count > 1 and result == SAME) or count > (FEW_AT_ONCE if instants > DENSE else MOST_AT_ONCE)
            if not is_ignored:
                clear(c.guards, ignored)
        elif passes:
            if is_ignored:
                brief = LONGER * brief
            is_ignored = False
            clear(c.guards, ignored)
        if is_last:
            return DONE
    if c.decide == 0:
        return HARD
    record(c, t, BOUND, 0, 0.0, 0.0, events, counts)
    if t < end and PART_STEP(c.part_step, y, inputs, t, end - t) < 0:
        return NOT_FINITE
    return DONE


def change(
    c: Contacts, t: float, y: Array, inputs: Array, opening: Integers, yielding: Integers, elastic: bool,
    rest: float, reached: Integers, events: Array, counts: Integers,
) -> int:  # fmt: skip
    """Make the changes of an event, see `switch`; those that are not simple are left to others."""
    old, kept, saved, before = zeros(c.modes), zeros(c.size), zeros(c.modes), counts[0]
    for i in range(c.modes):
        old[i] = inputs[c.first_mode + i]
    renew(c, t, y, inputs)
    for i in range(c.modes):
        saved[i] = inputs[c.first_mode + i]
    for i in range(c.size):
        kept[i] = y[i]
    result = switch(c, t, y, inputs, old, opening, yielding, elastic, rest, reached, events, counts)
    if result != NOT_SIMPLE or c.decide == 0:
        return result
    for i in range(c.modes):
        inputs[c.first_mode + i] = saved[i]
    for i in range(c.size):
        y[i] = kept[i]
    counts[0] = before
    return DECIDE(c.decide, t, reached, old, opening, yielding, 1 if elastic else 0, rest)


def clear(n: int, marks: Integers) -> None:
    """Remove all marks."""
    for i in range(n):
        marks[i] = 0


def switch(
    c: Contacts, t: float, y: Array, inputs: Array, old: Array, opening: Integers, yielding: Integers, elastic: bool,
    rest: float, reached: Integers, events: Array, counts: Integers,
) -> int:  # fmt: skip
    """Make the changes whose guards are zero or negative, which become those that are `reached`.

    Where that is not simple, y and modes are not restored.

    :param old: the modes before.
    :param opening: and `yielding` are what earlier events at this instant have decided, with what this one adds.
    """
    readings, speeds, touched = zeros(readings_size(c)), zeros(c.speeds), integers(c.gaps)
    sliding, is_stop = integers(c.frictions), True
    read(c, t, y, inputs, readings)
    if goes_on(c, readings, old, inputs, opening, yielding):
        return SAME
    if not c.simple:
        return NOT_SIMPLE
    for guard in range(c.guards):
        reached[guard] = readings[guard_at(c, guard)] <= c.tolerance
        is_stop = is_stop and not reached[guard]
    for k in range(c.singles):
        if reached[c.gaps + c.frictions + k]:
            inputs[c.first_mode + 2 * c.rows + c.single_loads[k]] *= -1.0
    for gap in range(c.gaps):
        is_closed = inputs[c.first_mode + gap] != 0.0
        touched[gap] = reached[gap] and not is_closed
        if reached[gap] and is_closed:
            opening[gap] = 1
    for k in range(c.frictions):
        if reached[c.gaps + k] and not slides(c, inputs, k):
            yielding[k] = 1
        sliding[k] = slides(c, inputs, k) and not is_stop
    for i in range(c.speeds):
        speeds[i] = y[c.first_speed + i]
    if not resolve(c, t, y, inputs, readings, opening, yielding, sliding, touched, elastic, rest, events, counts):
        return NOT_SIMPLE
    record_changes(c, t, old, inputs, events, counts)
    for i in range(c.modes):
        if old[i] != inputs[c.first_mode + i]:
            return CHANGED
    for i in range(c.speeds):
        if speeds[i] != y[c.first_speed + i]:
            return CHANGED
    return SAME


def goes_on(
    c: Contacts, readings: Array, old: Array, inputs: Array, opening: Integers, yielding: Integers
) -> bool:  # fmt: skip
    """Whether only what closed slots iterate from has changed: the motion goes on with the same contacts.

    Forces of friction can have several solutions, and must not jump to another one there.
    """
    rates = readings[rate_at(c, 0) :]
    for i in range(c.first_feature if c.body_pairs > 0 else 0):
        if old[i] != inputs[c.first_mode + i]:
            return False
    for gap in range(c.gaps):
        if opening[gap] or (inputs[c.first_mode + gap] == 0.0 and is_touching(c, readings, gap)):
            return False
        if c.slots[gap] and inputs[c.first_mode + gap] != 0.0 and abs(rates[gap]) > RESTING * c.row_speeds[gap]:
            return False  # its point is another one
    for k in range(c.frictions):
        limit = STOPPED * c.row_speeds[c.friction_rows[2 * k]]
        if yielding[k] or (slides(c, inputs, k) and length_along(c, k, rates) <= limit):
            return False
    return c.body_pairs > 0 and not any(readings[guard_at(c, guard)] <= c.tolerance for guard in range(c.guards))


def resolve(
    c: Contacts, t: float, y: Array, inputs: Array, readings: Array, opening: Integers, yielding: Integers,
    sliding: Integers, touched: Integers, elastic: bool, rest: float, events: Array, counts: Integers,
) -> bool:  # fmt: skip
    """Impacts of touching contacts that approach, then the new modes; False where these are not simple.

    :param sliding: 1 for friction that does not stop, however slow it is, unless there are impacts.
    """
    touching, returning, terms = integers(c.gaps), integers(c.gaps), zeros(terms_size(c))
    strikes = False
    for gap in range(c.gaps):
        rate = readings[rate_at(c, gap)] / c.row_speeds[gap]
        returning[gap] = touched[gap] and rate > RESTING
        touching[gap] = is_touching(c, readings, gap) or touched[gap]
        strikes = strikes or (touching[gap] and rate < -RESTING) or returning[gap] != 0
    read_terms(c, t, y, inputs, terms)
    if not strikes:
        return find_modes(c, t, y, inputs, readings, terms, opening, yielding, sliding)
    for gap in range(c.gaps):
        touching[gap] = touching[gap] or c.clutches[gap]  # an impact elsewhere may engage them
    if not strike(c, t, y, inputs, readings, terms, touching, returning, elastic, rest, events, counts):
        return False
    if return_at_once(c, inputs, readings, terms, touching, returning):
        return strike(c, t, y, inputs, readings, terms, touching, returning, elastic, rest, events, counts)
    return True


def strike(
    c: Contacts, t: float, y: Array, inputs: Array, readings: Array, terms: Array, touching: Integers,
    returning: Integers, elastic: bool, rest: float, events: Array, counts: Integers,
) -> bool:  # fmt: skip
    """The impact of gaps that touch, and the modes after it; False where these are not simple."""
    impulses, u_change, loss = zeros(c.rows), zeros(c.speeds), zeros(1)
    none_opening, none = integers(c.gaps), integers(c.frictions)
    if not impact(c, t, y, inputs, readings, terms, touching, returning, elastic, rest, impulses, u_change, loss):
        return False
    apply(c, t, y, inputs, impulses, u_change, loss[0], events, counts)
    read(c, t, y, inputs, readings)
    read_terms(c, t, y, inputs, terms)
    return find_modes(c, t, y, inputs, readings, terms, none_opening, none, none)


def apply(
    c: Contacts, t: float, y: Array, inputs: Array, impulses: Array, u_change: Array, loss: float,
    events: Array, counts: Integers,
) -> None:  # fmt: skip
    """Change the speeds and the audit by an impact, and record it."""
    before = total_energy(c, t, y, inputs)
    for i in range(c.speeds):
        y[c.first_speed + i] += u_change[i]
    y[c.first_loss] += loss
    y[c.size - 1] += loss
    if c.energies:
        after = total_energy(c, t, y, inputs)
        if c.driven:
            y[c.size - 2] += after - before + loss
        record(c, t, ENERGIES, 0, before, after, events, counts)
    for gap in range(c.gaps):
        if impulses[gap] != 0.0:
            record(c, t, IMPACT, named(c, inputs[c.first_mode :], gap, gap), impulses[gap], loss, events, counts)


def total_energy(c: Contacts, t: float, y: Array, inputs: Array) -> float:
    """The total energy, if it must be known."""
    time, energies = zeros(1), zeros(2)
    time[0] = t
    if c.energies and c.energies_take_inputs:
        READ(c.energies, time, y, inputs, energies)
    elif c.energies:
        READ_STATE(c.energies, time, y, energies)
    return energies[0] + energies[1]


def record(
    c: Contacts, t: float, change: int, index: int, impulse: float, loss: float, events: Array, counts: Integers
) -> None:  # fmt: skip
    """Record an event."""
    if counts[0] == CAPACITY:
        if c.note:
            NOTE(c.note)
        counts[0] = 0
    first = counts[0] * FIELDS
    events[first], events[first + 1], events[first + 2] = t, change, index
    events[first + 3], events[first + 4] = impulse, loss
    counts[0] += 1


def record_changes(c: Contacts, t: float, old: Array, inputs: Array, events: Array, counts: Integers) -> None:
    """Record which gaps have closed or opened, and what has begun to slide or to stick."""
    new = inputs[c.first_mode :]
    for gap in range(c.gaps):
        if new[gap] != 0.0 and old[gap] == 0.0:
            record(c, t, CLOSED, named(c, new, gap, gap), 0.0, 0.0, events, counts)
        elif old[gap] != new[gap]:
            record(c, t, OPENED, named(c, old, gap, gap), 0.0, 0.0, events, counts)
    for k in range(c.frictions):
        load = c.friction_gaps[k]
        if load >= 0 and new[load] == 0.0:
            continue
        slid, now_slides = is_sliding(c, old, k), slides(c, inputs, k)
        along = 0.0
        for direction in range(2):
            row = c.friction_rows[2 * k + direction]
            if row >= 0:
                along += old[c.rows + row] * new[c.rows + row]
        stuck = not slid and (load < 0 or old[load] != 0.0)
        if now_slides and (not slid or along < 0.0):
            record(c, t, SLIDES, named(c, new, load, k), 0.0, 0.0, events, counts)
        elif not now_slides and (slid or not stuck):
            record(c, t, STICKS, named(c, new, load, k), 0.0, 0.0, events, counts)


def named(c: Contacts, modes: Array, gap: int, index: int) -> int:
    """The index of a gap or a friction element, with the pair that its gap has in some modes if it is one of a pool."""
    if gap < c.first_pooled:
        return index
    return index + OF_PAIR * (1 + int(modes[c.first_holder + gap - c.first_pooled]))
