"""What touches at the slots of two bodies: the area of contact of those that are closed, and features found anew."""

from __future__ import annotations

import math

from mbd_sim.compiler.ir.python_kinds import Array, Integers, integers, zeros
from mbd_sim.simulation.contact.compiled.features.vectors import cross, distance_of, dot, size_of, subtract
from mbd_sim.simulation.contact.compiled.instant.contacts import Contacts, read_poses
from mbd_sim.simulation.contact.compiled.pairs import (
    MARGIN,
    NO_GAP,
    POSE,
    RENEW,
    SPOT,
    SPOT_GAP,
    SPOT_NORMAL,
    TOUCH,
    TOUCHING,
    FeaturePair,
    hold,
    is_closed,
    numbers_at,
    pair_at,
    put,
    spheres_apart,
    take,
)

BORDER = 0.5  # of the tolerance, by which the point of a closed slot may be beside its face or edge after an event
# Of the radius of the smaller body: a length or a width of an area of contact, below which this counts as a point or a
# line. Its rows depend on each other so much that round-off turns the bodies.
NARROW = 1e-4
WIDER, WIDE = 1.5, 2.0  # times this, up to which an area is found narrow at an event, and beyond which it has widened
ALIKE = 1e-6  # sine of the angle up to which two normals are one
# Of an area of contact: its length, or the least distance of two slots, and its width, which are infinite without two,
# or three slots, and the margin of its slots.
LENGTH, NEAREST, WIDTH, ROOM = 0, 0, 1, 2
AREA = 3


def area_at(c: Contacts, pair: FeaturePair, inputs: Array, places: Array, area: Array) -> None:
    """How far the closed slots are from where others take their place, and how far from each other, and the width."""
    one, other, margin, count, size = zeros(POSE), zeros(POSE), 0.0, 0, 0
    spots, members, own = zeros(SPOT * pair.slots), integers(pair.slots), zeros(2)
    put(pair, places, one, other)
    area[NEAREST], area[WIDTH], area[ROOM] = math.inf, math.inf, math.inf
    for slot in range(pair.slots):
        if is_closed(c, pair, inputs, slot):
            at = numbers_at(pair, slot)
            margin = MARGIN(pair.margin, pair.data, one, other, inputs[at:], spots[SPOT * count :])
            area[ROOM] = min(area[ROOM], margin)
            count += 1
    for base in range(count if count > 1 else 0):
        size = measure(spots, count, base, members, own)
        if size > 2:
            area[WIDTH] = min(area[WIDTH], own[WIDTH])
        for k in range(base):
            if is_alike(spots[SPOT * base :], spots[SPOT * k :]):
                area[NEAREST] = min(area[NEAREST], distance_of(spots[SPOT * base :], spots[SPOT * k :]))


def narrow(pair: FeaturePair) -> float:
    """The length in m below which an area of contact counts as a point, or a width as that of a line."""
    return NARROW * min(pair.radii[0], pair.radii[1])


def has_widened(c: Contacts, pair: FeaturePair, inputs: Array, places: Array) -> bool:
    """Whether two bodies touch in a longer or wider area than that of the closed slots, which is narrow."""
    one, other, spots, count = zeros(POSE), zeros(POSE), zeros(SPOT * pair.slots), 0
    found = zeros(pair.slots * pair.size)
    put(pair, places, one, other)
    for slot in range(pair.slots):
        if is_closed(c, pair, inputs, slot):
            at = numbers_at(pair, slot)
            MARGIN(pair.margin, pair.data, one, other, inputs[at:], spots[SPOT * count :])
            count += 1
    own = dimension(pair, spots, count)
    count = TOUCHING(pair.touching, pair.data, one, other, c.accuracy, found)
    for k in range(count):
        MARGIN(pair.margin, pair.data, one, other, found[pair.size * k :], spots[SPOT * k :])
    return dimension(pair, spots, count) > own


def dimension(pair: FeaturePair, spots: Array, count: int) -> int:
    """0 if bodies touch in points, 1 if they do in a line, and 2 if they do in a wide area."""
    members, own, wide, found = integers(count), zeros(2), WIDE * narrow(pair), 0
    for base in range(count):
        measure(spots, count, base, members, own)
        found = max(found, 2 if own[WIDTH] > wide else 1 if own[LENGTH] > wide else 0)
    return found


def measure(spots: Array, count: int, base: int, members: Integers, own: Array) -> int:
    """Mark the spots with the normal of a base; the length and the width of their area are its `own`.

    :return: the number of these spots; 0 if one before the base has this normal.
    """
    size, one, other = 0, base, base
    own[LENGTH], own[WIDTH] = 0.0, 0.0
    for k in range(count):
        members[k] = is_alike(spots[SPOT * base :], spots[SPOT * k :])
        if members[k] and k < base:
            return 0
        size += members[k]
    one = farthest_from(spots, count, base, members)
    other = farthest_from(spots, count, one, members)
    own[LENGTH] = distance_of(spots[SPOT * one :], spots[SPOT * other :])
    own[WIDTH] = width_of(spots, count, one, other, members)
    return size


def is_alike(spot: Array, known: Array) -> bool:
    """Whether two slots have one normal."""
    normal, side = known[SPOT_NORMAL:], zeros(3)
    cross(spot[SPOT_NORMAL:], normal, side)
    return dot(spot[SPOT_NORMAL:], normal) > 0.0 and size_of(side) <= ALIKE


def farthest_from(spots: Array, count: int, base: int, members: Integers) -> int:
    """The spot that is farthest from a base."""
    found, most = base, 0.0
    for k in range(count):
        apart = distance_of(spots[SPOT * k :], spots[SPOT * base :]) if members[k] else 0.0
        if apart > most:
            found, most = k, apart
    return found


def width_of(spots: Array, count: int, one: int, other: int, members: Integers) -> float:
    """How far spots are from the line through two of them, at most."""
    line, arm, side, found = zeros(3), zeros(3), zeros(3), 0.0
    subtract(spots[SPOT * other :], spots[SPOT * one :], line)
    length = size_of(line)
    for k in range(count):
        if members[k] and length > 0.0:
            subtract(spots[SPOT * k :], spots[SPOT * one :], arm)
            cross(line, arm, side)
            found = max(found, size_of(side) / length)
    return found


def renew(c: Contacts, t: float, y: Array, inputs: Array) -> None:
    """Find the features of all slots at a state; closed slots keep theirs as long as these are where they meet."""
    places = zeros(c.places)
    read_poses(c, t, y, inputs, places)
    hold(c, inputs)
    for index in range(c.body_pairs):
        pair = pair_at(c, index)
        if spheres_apart(pair, places) <= TOUCH * c.accuracy:
            renew_pair(c, pair, places, inputs)
        else:
            for slot in range(pair.slots):
                empty(c, pair, slot, inputs)


def renew_pair(c: Contacts, pair: FeaturePair, places: Array, inputs: Array) -> None:
    """Find the features of the slots of a pair that is near."""
    one, other, found = zeros(POSE), zeros(POSE), zeros(pair.slots * pair.size)
    kept, chosen, used, margin = integers(pair.slots), integers(pair.slots), integers(pair.slots), 0.0
    spot = zeros(SPOT)
    put(pair, places, one, other)
    for slot in range(pair.slots):
        chosen[slot] = -1
        if is_closed(c, pair, inputs, slot):
            margin = MARGIN(pair.margin, pair.data, one, other, inputs[numbers_at(pair, slot) :], spot)
            kept[slot] = margin >= -BORDER * c.accuracy
    count = TOUCHING(pair.touching, pair.data, one, other, c.accuracy, found)
    count = without_narrow(c, pair, one, other, inputs, found, count, kept)
    free_kept(pair, found, count, inputs, kept)
    for k in range(count):
        place_found(pair, k, key_of(found, pair.size, k), inputs, kept, chosen, used)
    following = 0
    for slot in range(pair.slots):
        while following < count and used[following]:
            following += 1
        if chosen[slot] < 0 and not kept[slot] and following < count:
            chosen[slot] = following
            following += 1
    for slot in range(pair.slots):
        if chosen[slot] >= 0:
            if slot_key(pair, inputs, slot) != key_of(found, pair.size, chosen[slot]):
                empty(c, pair, slot, inputs)
            for i in range(pair.size if take(c, pair, slot, inputs) else 0):
                inputs[numbers_at(pair, slot) + i] = found[pair.size * chosen[slot] + i]
        elif not kept[slot]:
            empty(c, pair, slot, inputs)


def without_narrow(
    c: Contacts, pair: FeaturePair, one: Array, other: Array, inputs: Array, found: Array, count: int, kept: Integers
) -> int:  # fmt: skip
    """Leave only one of the features of an area that has shrunk to a point, and two of one that has to a line.

    They are the deepest one and the one that is farthest from it. `kept` slots with others are freed.

    :return: the number of features that remain, which are the first ones then.
    """
    spots, members, dropped = zeros(SPOT * pair.slots), integers(pair.slots), integers(pair.slots)
    own, limit, remaining, size, first, last = zeros(2), WIDER * narrow(pair), 0, 0, 0, 0
    for k in range(count):
        MARGIN(pair.margin, pair.data, one, other, found[pair.size * k :], spots[SPOT * k :])
    for base in range(count if count > 1 else 0):
        size = measure(spots, count, base, members, own)
        if size > 1 and (own[LENGTH] <= limit or (size > 2 and own[WIDTH] <= limit)):
            first = deepest(c, spots, count, members)
            last = farthest_from(spots, count, first, members) if own[LENGTH] > limit else first
            for k in range(count):
                remains = k in (first, last)
                dropped[k] = dropped[k] or (members[k] and not remains)
    for k in range(count):
        if not dropped[k]:
            for i in range(pair.size):
                found[pair.size * remaining + i] = found[pair.size * k + i]
            remaining += 1
    for slot in range(pair.slots if remaining < count else 0):
        kept[slot] = kept[slot] and has_key(pair, found, remaining, slot_key(pair, inputs, slot))
    return remaining


def deepest(c: Contacts, spots: Array, count: int, members: Integers) -> int:
    """The deepest spot of an area; the first one of those that are equally deep, up to round-off."""
    best, lowest = -1, math.inf
    for k in range(count):
        if members[k] and spots[SPOT * k + SPOT_GAP] < lowest - BORDER * c.accuracy:
            best, lowest = k, spots[SPOT * k + SPOT_GAP]
    return best


def has_key(pair: FeaturePair, found: Array, count: int, key: float) -> bool:
    """Whether features with a key have been found."""
    return any(key_of(found, pair.size, k) == key for k in range(count))


def free_kept(pair: FeaturePair, found: Array, count: int, inputs: Array, kept: Integers) -> None:
    """Free kept slots that touch no more, if new features lack slots: as of a corner on a corner, one for each side."""
    confirmed, holding = integers(pair.slots), 0
    lacking = count - pair.slots
    for slot in range(pair.slots):
        if kept[slot]:
            lacking += 1
            for k in range(count):
                if key_of(found, pair.size, k) == slot_key(pair, inputs, slot):
                    confirmed[slot] = 1
                    holding += 1
    if lacking > holding:
        for slot in range(pair.slots):
            kept[slot] = kept[slot] and confirmed[slot]


def place_found(
    pair: FeaturePair, k: int, key: float, inputs: Array, kept: Integers, chosen: Integers, used: Integers
) -> None:
    """Leave features to the slot that has them: it is kept, or they are chosen for it."""
    for slot in range(pair.slots):
        if slot_key(pair, inputs, slot) == key:
            if not kept[slot]:
                chosen[slot] = k
            used[k] = 1


def key_of(numbers: Array, size: int, slot: int) -> float:
    """The key of a slot, the last one of its numbers."""
    return numbers[size * (slot + 1) - 1]


def slot_key(pair: FeaturePair, inputs: Array, slot: int) -> float:
    """The present key of a slot."""
    return 0.0 if pair.gaps[slot] == NO_GAP else inputs[numbers_at(pair, slot) + pair.size - 1]


def empty(c: Contacts, pair: FeaturePair, slot: int, inputs: Array) -> None:
    """Leave a slot without features."""
    if pair.gaps[slot] == NO_GAP:
        return
    for i in range(pair.size):
        inputs[numbers_at(pair, slot) + i] = 0.0
    inputs[c.first_mode + pair.gaps[slot]] = 0.0
    if pair.shared > 0:
        inputs[pair.holders + pair.gaps[slot] - pair.first_gap] = 0.0
        c.held_slots[0] -= 1
        pair.gaps[slot] = NO_GAP


def end_step(c: Contacts, t: float, y: Array, inputs: Array) -> None:
    """After a step: empty the slots that are open, and renew what the rows of the others iterate from."""
    places, one, other, has_places = zeros(c.places), zeros(POSE), zeros(POSE), False
    hold(c, inputs)
    for index in range(c.body_pairs):
        pair = pair_at(c, index)
        for slot in range(pair.slots):
            if not is_closed(c, pair, inputs, slot):
                if slot_key(pair, inputs, slot) != 0.0:
                    empty(c, pair, slot, inputs)
            elif pair.iterates:
                if not has_places:
                    read_poses(c, t, y, inputs, places)
                    has_places = True
                put(pair, places, one, other)
                renew_start(c, pair, one, other, inputs, numbers_at(pair, slot))


def renew_start(c: Contacts, pair: FeaturePair, one: Array, other: Array, inputs: Array, numbers: int) -> None:
    """Renew what the row of a slot iterates from; the slopes of earlier steps are as good as before."""
    belongs = c.kept_inputs > 0
    for i in range(numbers, numbers + pair.size):
        belongs = belongs and inputs[c.kept_inputs + i] == inputs[i]
    RENEW(pair.renew, pair.data, one, other, inputs[numbers:])
    for i in range(numbers, numbers + pair.size if belongs else numbers):
        inputs[c.kept_inputs + i] = inputs[i]
