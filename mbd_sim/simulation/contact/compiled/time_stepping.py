"""Steps of time stepping, in the subset of Python that is compiled: see `mbd_sim.simulation.contact.time_stepping`.

Steps that are not simple are left to the caller, with nothing changed.
"""

from __future__ import annotations

from dataclasses import dataclass

from mbd_sim.compiler.ir.python_kinds import Array, Integers, integers, zeros
from mbd_sim.simulation.contact.compiled.instant.candidate_forces import read_joint_loads
from mbd_sim.simulation.contact.compiled.instant.contacts import (
    ADVANCE,
    PART_STEP,
    PROJECT,
    READ,
    READ_INPUTS,
    READ_RESPONSE,
    READ_STATE,
    Contacts,
    read_poses,
)
from mbd_sim.simulation.contact.compiled.instant.modes import RESTING
from mbd_sim.simulation.contact.compiled.pairs import (
    DISTANCE,
    POSE,
    TOUCHING,
    FeaturePair,
    at_least,
    hold,
    note,
    numbers_at,
    pair_at,
    put,
    spheres_apart,
    take,
)
from mbd_sim.simulation.contact.compiled.step import (
    DONE,
    ENERGIES,
    HARD,
    IMPACT,
    NOT_FINITE,
    record,
    record_changes,
    total_energy,
)
from mbd_sim.simulation.contact.compiled.together.step_impulses import StepContacts, find_impulses, mark_rows
from mbd_sim.simulation.contact.compiled.together.step_modes import add_sliding, write_resting
from mbd_sim.simulation.contact.compiled.touching import end_step, key_of, slot_key

NEAR = 0.01  # of the way at the natural speed in a step, within which features that touch together are found
FARTHER = 2.0  # times the distance at which gaps can close, beyond which bodies have no features


@dataclass(frozen=True)
class FreeMotion:
    """A step without contacts from a `start` in s, of some `length`: the states before and after it."""

    start: float
    length: float
    before: Array
    after: Array


def advance_by_time_stepping(
    c: Contacts, y: Array, inputs: Array, first: int, h: float, steps: int, estimate: Array,
    events: Array, counts: Integers,
) -> int:  # fmt: skip
    """Take steps up to one that cannot be taken here; the number of steps that were taken.

    :param events: and `counts`, see `mbd_sim.simulation.contact.compiled.step.advance`.
    """
    done, before, old = 0, zeros(c.size), zeros(c.modes)
    counts[0] = 0
    while done < steps:
        for i in range(c.size):
            before[i] = y[i]
        for i in range(c.modes):
            old[i] = inputs[c.first_mode + i]
        counts[1] = step(c, y, inputs, first + done, h, estimate, old, events, counts)
        if counts[1] != DONE:
            for i in range(c.size):
                y[i] = before[i]
            for i in range(c.modes):
                inputs[c.first_mode + i] = old[i]
            return done
        done += 1
    return done


def step(
    c: Contacts, y: Array, inputs: Array, index: int, h: float, estimate: Array, old: Array,
    events: Array, counts: Integers,
) -> int:  # fmt: skip
    """Take a step: without contacts, then with the impulses of those that have closed.

    :param old: the modes before. They are not restored where the step cannot be taken, and neither is y.
    """
    start, end, result = index * h, index * h + h, DONE
    free = FreeMotion(start, h, zeros(c.size), zeros(c.size))
    rows, closing = zeros(c.gaps + c.rows), integers(c.gaps)
    if not c.simple:
        return HARD
    for i in range(c.modes):
        if i < 2 * c.rows or i >= 2 * c.rows + c.loaded:  # signs stay
            inputs[c.first_mode + i] = 0.0
    for i in range(c.size):
        free.before[i] = y[i]
    if ADVANCE(c.advance, y, inputs, index, h, 1, estimate) == 0:
        return NOT_FINITE
    for k in range(c.held_count):
        free.before[c.held[k]] = y[c.held[k]]
    for i in range(c.size):
        free.after[i] = y[i]
    if c.body_pairs > 0:
        find_all(c, free, inputs)
    if c.lacking[0] != 0:
        return HARD
    read_rows(c, end, y, inputs, rows)
    mark_closing(c, rows, h, closing)
    read_rows(c, start, free.before, inputs, rows)
    mark_closing(c, rows, h, closing)  # others may press them together
    if acts(c, closing):
        result = act(c, free, y, inputs, rows[c.gaps :], closing, events, counts)
        if result != DONE:
            return result
    end_step(c, end, y, inputs)
    record_changes(c, end, old, inputs, events, counts)
    return DONE


def read_rows(c: Contacts, t: float, y: Array, inputs: Array, rows: Array) -> None:
    """The gaps (gaps,) and the rates (rows,)."""
    time = zeros(1)
    time[0] = t
    READ(c.gaps_and_rates, time, y, inputs, rows)


def mark_closing(c: Contacts, gaps: Array, h: float, closing: Integers) -> None:
    """Mark gaps that are not positive; of clutches, those that do not slip."""
    near = max(c.tolerance, c.rest_speed / c.unit_speed * c.unit_rate * h)
    for gap in range(c.gaps):
        limit = RESTING if c.clutches[gap] else near
        closing[gap] = closing[gap] or gaps[gap] <= limit * c.gap_units[gap]


def acts(c: Contacts, closing: Integers) -> bool:
    """Whether something can act: gaps that close, or friction that belongs to none."""
    if any(closing[gap] for gap in range(c.gaps)):
        return True
    return any(c.friction_gaps[k] < 0 for k in range(c.frictions))


def act(
    c: Contacts, free: FreeMotion, y: Array, inputs: Array, before: Array, closing: Integers,
    events: Array, counts: Integers,
) -> int:  # fmt: skip
    """Give the impulses of the contacts that close in a step; why it cannot be taken, or `DONE`.

    :param before: the rates (rows,) at its start.
    """
    middle, after, change, e, time = zeros(c.size), zeros(c.rows), zeros(c.speeds), zeros(c.gaps), zeros(1)
    marks, rows, places, first = zeros(c.rows), integers(c.rows), integers(c.rows), c.rows + 2 * c.frictions
    count = mark_rows(c, closing, marks, rows, places)
    terms = zeros(first + count * count)
    s = StepContacts(
        free.length, terms, terms[first:], count, rows, places, zeros(c.loads_size), before, after, closing,
        integers(c.gaps), zeros(c.rows), zeros(c.rows), zeros(2),
    )  # fmt: skip
    time[0] = free.start + 0.5 * free.length
    if not rates_at_end(c, free, inputs, before, middle, after):
        return NOT_FINITE
    READ_RESPONSE(c.stepping.marked_terms, time, middle, inputs, marks, terms)
    read_joint_loads(c, time[0], middle, inputs, s.joint_loads)
    READ_INPUTS(c.restitution, inputs, e)
    if not find_impulses(c, s, e):
        return HARD
    if not any(s.impulses[row] != 0.0 for row in range(c.rows)):
        return DONE
    READ_RESPONSE(c.response, time, middle, inputs, s.impulses, change)
    move(c, free, y, change)
    account(c, free, time, middle, y, inputs)
    write_resting(c, s, inputs)
    if PROJECT(c.stepping.project, y, inputs, free.start + free.length) < 0:
        return NOT_FINITE
    add_sliding(c, s, inputs)
    add_losses(c, s, free, y, inputs, events, counts)
    return DONE


def rates_at_end(c: Contacts, free: FreeMotion, inputs: Array, before: Array, middle: Array, after: Array) -> bool:
    """The state in the middle of a step, with the speeds after it, and the rates (rows,) after it.

    These are extrapolated from the middle, where the impulses act: contacts that stay closed on curved paths then lose
    no energy. False where the state is not finite.
    """
    rows, t = zeros(c.gaps + c.rows), free.start + 0.5 * free.length
    for i in range(c.size):
        middle[i] = free.before[i]
    if PART_STEP(c.part_step, middle, inputs, free.start, 0.5 * free.length) < 0:
        return False
    for i in range(c.speeds):
        middle[c.first_speed + i] = free.before[c.first_speed + i]
    read_rows(c, t, middle, inputs, rows)
    for row in range(c.rows):
        after[row] = rows[c.gaps + row] - before[row]
    for i in range(c.speeds):
        middle[c.first_speed + i] = free.after[c.first_speed + i]
    read_rows(c, t, middle, inputs, rows)
    for row in range(c.rows):
        after[row] = rows[c.gaps + row] + after[row]
    return True


def move(c: Contacts, free: FreeMotion, y: Array, change: Array) -> None:
    """Change the speeds, and the positions of joints whose speeds change: their mean speed acts for the whole step."""
    displacement, moved, first = zeros(c.speeds), zeros(c.first_speed), c.first_speed
    for i in range(c.speeds):
        y[first + i] += change[i]
        displacement[i] = 0.5 * free.length * (free.before[first + i] + y[first + i])
    READ_STATE(c.stepping.displaced, free.before, displacement, moved)
    for joint in range(c.stepping.joints):
        places = c.stepping.joint_places[4 * joint :]
        changes = False
        for i in range(places[2], places[3]):
            changes = changes or change[i] != 0.0
        for i in range(places[0], places[1] if changes else places[0]):
            y[i] = moved[i]


def account(c: Contacts, free: FreeMotion, time: Array, middle: Array, y: Array, inputs: Array) -> None:
    """The energies of the account, with the powers of the mean speeds."""
    powers = zeros(c.size - c.first_loss)
    for i in range(c.first_speed, c.first_speed + c.speeds):
        middle[i] = 0.5 * (free.before[i] + y[i])
    READ(c.stepping.powers, time, middle, inputs, powers)
    for i in range(c.first_loss, c.size):
        y[i] = free.before[i] + free.length * powers[i - c.first_loss]


def add_losses(
    c: Contacts, s: StepContacts, free: FreeMotion, y: Array, inputs: Array, events: Array, counts: Integers
) -> None:  # fmt: skip
    """Add the losses of a step to the account, and record what struck."""
    t, normal, friction = free.start + free.length, max(s.losses[0], 0.0), max(s.losses[1], 0.0)
    loss = normal + friction
    y[c.first_loss] += normal
    y[c.first_loss + 1] += friction
    y[c.size - 1] += loss
    if c.energies:
        before, after = total_energy(c, t, free.after, inputs), total_energy(c, t, y, inputs)
        if c.driven:
            y[c.size - 2] += after - before + loss
        if any(s.hits[gap] for gap in range(c.gaps)):
            record(c, t, ENERGIES, 0, before, after, events, counts)
    for gap in range(c.gaps):
        if s.hits[gap] and s.impulses[gap] != 0.0:
            record(c, t, IMPACT, gap, s.impulses[gap], loss, events, counts)


def find_all(c: Contacts, free: FreeMotion, inputs: Array) -> None:
    """Find the features of all slots, which are empty, before and after a free step.

    Those before it come first.
    """
    places, places_after, end = zeros(c.places), zeros(c.places), free.start + free.length
    tolerance = max(c.tolerance, NEAR * c.unit_speed * free.length)
    apart = FARTHER * max(tolerance, c.rest_speed * free.length)
    read_poses(c, free.start, free.before, inputs, places)
    read_poses(c, end, free.after, inputs, places_after)
    hold(c, inputs)
    for index in range(c.body_pairs):
        pair = pair_at(c, index)
        count = add_found(c, pair, places, tolerance, apart, inputs, 0)
        add_found(c, pair, places_after, tolerance, apart, inputs, count)


def has_slot(pair: FeaturePair, inputs: Array, count: int, key: float) -> bool:
    """Whether one of the first slots has some features."""
    return any(slot_key(pair, inputs, slot) == key for slot in range(count))


def add_found(
    c: Contacts, pair: FeaturePair, places: Array, tolerance: float, apart: float, inputs: Array, count: int
) -> int:
    """Add features to the `count` first slots of a pair that are in use; the number of those that are in use then.

    Bodies that are farther `apart` need none. What is remembered of their distance only tells this sooner.
    """
    one, other, found = zeros(POSE), zeros(POSE), zeros(pair.slots * pair.size)
    if max(spheres_apart(pair, places), at_least(pair, places)) > apart:
        return count
    put(pair, places, one, other)
    distance = DISTANCE(pair.distance, pair.data, one, other)
    note(pair, places, distance)
    if distance > apart:
        return count
    touching = TOUCHING(pair.touching, pair.data, one, other, tolerance, found)
    for k in range(touching):
        if count < pair.slots and not has_slot(pair, inputs, count, key_of(found, pair.size, k)):
            if not take(c, pair, count, inputs):
                return count
            for i in range(pair.size):
                inputs[numbers_at(pair, count) + i] = found[pair.size * k + i]
            if pair.found_at >= 0:  # how deep bodies are is corrected after the step
                inputs[numbers_at(pair, count) + pair.found_at] = 0.0
            count += 1
    return count
