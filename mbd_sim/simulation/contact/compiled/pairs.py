"""The pairs of bodies that touch with changing features: how far they are apart, and what touches at their slots.

A distance changes by no more than points of both bodies move against each other. What was computed at some poses
therefore bounds it at any others, whatever was between them: nothing depends on what is remembered.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import cast

from mbd_sim.compiler.ir.python_kinds import Array, External, Integers, integers, zeros
from mbd_sim.simulation.contact.compiled.contacts import Contacts, read_poses
from mbd_sim.simulation.contact.compiled.features.vectors import dot, place, size_of, subtract

DISTANCE = External("float", ("int", "Array", "Array"))
MARGIN = External("float", ("int", "Array", "Array", "Array"))
TOUCHING = External("int", ("int", "Array", "Array", "float", "Array"))
RENEW = External("None", ("int", "Array", "Array", "Array"))

PATH = 1.05  # of the straight line, the path of a body in a step
AT_REST = 1e-6  # of the tolerance, by which the poses of bodies at rest may change in a step
TOUCH = 4.0  # tolerances, up to which spheres overlap
BORDER = 0.5  # of the tolerance, by which the point of a closed slot may be beside its face or edge after an event
POSE = 12
LINE, TURNS, KNOWN = 0, 3, 21  # of what is remembered: the line between the centers, both rotations, and the distance
MEMORY = 22


@dataclass(frozen=True)
class FeaturePair:
    """Two bodies with slots.

    `distance`, `margin`, `touching` and `renew` are the addresses of the functions of their narrow phase, which are
    given `data` first; `iterates`: see `NarrowPhase`. `first` and `second` are the rows of the poses of their parts;
    the spheres around them have `centers` (6,) and `radii` (2,). Nothing moves along axes of which `axes` (3,) is 0.
    Slot k is the gap `gaps` k; it has `size` numbers among the inputs, from `numbers` + k `size` on. The latest
    distance is remembered in `memory` (`MEMORY`,).
    """

    distance: int
    margin: int
    touching: int
    renew: int
    data: int
    iterates: bool
    first: int
    second: int
    centers: Array
    radii: Array
    axes: Array
    slots: int
    gaps: Integers
    numbers: int
    size: int
    memory: Array


PAIR = len(fields(FeaturePair))  # slots of a packed one


def pair_at(c: Contacts, index: int) -> FeaturePair:
    """A pair of bodies."""
    return cast("FeaturePair", c.bodies[PAIR * index :])


def put(pair: FeaturePair, places: Array, one: Array, other: Array) -> None:
    """The poses of both parts; of bodies in a plane, in this plane."""
    first, second = places[POSE * pair.first :], places[POSE * pair.second :]
    for i in range(3):
        one[i], other[i] = first[i] * pair.axes[i], second[i] * pair.axes[i]
    for i in range(3, POSE):
        one[i], other[i] = first[i], second[i]


def is_closed(c: Contacts, pair: FeaturePair, inputs: Array, slot: int) -> bool:
    """Whether a slot is closed."""
    return inputs[c.first_mode + pair.gaps[slot]] != 0.0


def any_closed(c: Contacts, pair: FeaturePair, inputs: Array) -> bool:
    """Whether one of the slots is closed."""
    return any(is_closed(c, pair, inputs, slot) for slot in range(pair.slots))


def distance_at(pair: FeaturePair, places: Array) -> float:
    """How far both bodies are apart."""
    one, other = zeros(POSE), zeros(POSE)
    put(pair, places, one, other)
    return DISTANCE(pair.distance, pair.data, one, other)


def beyond_gaps(c: Contacts, pair: FeaturePair, inputs: Array, places: Array, readings: Array) -> float:
    """The distance, less the lowest of the gaps of the closed slots if that is negative."""
    lowest = 0.0
    for slot in range(pair.slots):
        if is_closed(c, pair, inputs, slot):
            lowest = min(lowest, readings[1 + pair.gaps[slot]])
    return distance_at(pair, places) - lowest


def margin_at(c: Contacts, pair: FeaturePair, inputs: Array, places: Array) -> float:
    """How far the features of all closed slots are from where others take their place."""
    one, other, margin, found = zeros(POSE), zeros(POSE), math.inf, 0.0
    put(pair, places, one, other)
    for slot in range(pair.slots):
        if is_closed(c, pair, inputs, slot):
            found = MARGIN(pair.margin, pair.data, one, other, inputs[pair.numbers + pair.size * slot :])
            margin = min(margin, found)
    return margin


def center_line(pair: FeaturePair, places: Array, out: Array) -> None:
    """From the center of the second body to that of the first one."""
    one, other = zeros(3), zeros(3)
    place(places[POSE * pair.first :], pair.centers, one)
    place(places[POSE * pair.second :], pair.centers[3:], other)
    for i in range(3):
        out[i] = (one[i] - other[i]) * pair.axes[i]


def spheres_apart(pair: FeaturePair, places: Array) -> float:
    """The distance of the spheres around both bodies."""
    line = zeros(3)
    center_line(pair, places, line)
    return size_of(line) - (pair.radii[0] + pair.radii[1])


def turned_by(radius: float, rotation: Array, other: Array) -> float:
    """How far in m points of a body have moved at most because it has turned."""
    total = 0.0
    for i in range(9):
        change = other[i] - rotation[i]
        total += change * change
    return radius * math.sqrt(total) if total > 0.0 else 0.0  # a plane is infinite, but may not turn


def path_between(pair: FeaturePair, before: Array, after: Array) -> float:
    """How far in m points of one body have moved at most against the other, on straight lines."""
    line, other = zeros(3), zeros(3)
    center_line(pair, before, line)
    center_line(pair, after, other)
    subtract(other, line, line)
    first, second = POSE * pair.first + 3, POSE * pair.second + 3
    turning = turned_by(pair.radii[0], before[first:], after[first:])
    return math.sqrt(dot(line, line)) + turning + turned_by(pair.radii[1], before[second:], after[second:])


def at_least(pair: FeaturePair, places: Array) -> float:
    """A lower bound of the distance, from the latest one."""
    line, known = zeros(3), pair.memory
    center_line(pair, places, line)
    subtract(line, known, line)
    turning = turned_by(pair.radii[0], known[TURNS:], places[POSE * pair.first + 3 :])
    turning += turned_by(pair.radii[1], known[TURNS + 9 :], places[POSE * pair.second + 3 :])
    return known[KNOWN] - (math.sqrt(dot(line, line)) + turning)


def note(pair: FeaturePair, places: Array, distance: float) -> None:
    """Remember a distance."""
    center_line(pair, places, pair.memory)
    for i in range(9):
        pair.memory[TURNS + i] = places[POSE * pair.first + 3 + i]
        pair.memory[TURNS + 9 + i] = places[POSE * pair.second + 3 + i]
    pair.memory[KNOWN] = distance


def moves(c: Contacts, part: int, before: Array, after: Array) -> bool:
    """Whether a part has moved."""
    limit = AT_REST * c.accuracy
    return any(abs(after[POSE * part + i] - before[POSE * part + i]) > limit for i in range(POSE))


def may_meet(c: Contacts, pair: FeaturePair, inputs: Array, before: Array, after: Array) -> bool:
    """Whether bodies may have met, or features may have changed, on the way between two poses."""
    if not (moves(c, pair.first, before, after) or moves(c, pair.second, before, after)):
        return False
    path = PATH * path_between(pair, before, after) + TOUCH * c.accuracy
    if at_least(pair, before) + at_least(pair, after) > path and not any_closed(c, pair, inputs):
        return False
    return spheres_apart(pair, before) + spheres_apart(pair, after) <= path


def renew(c: Contacts, t: float, y: Array, inputs: Array) -> None:
    """Find the features of all slots at a state; closed slots keep theirs as long as these are where they meet."""
    places = zeros(c.places)
    read_poses(c, t, y, inputs, places)
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
    put(pair, places, one, other)
    for slot in range(pair.slots):
        chosen[slot] = -1
        if is_closed(c, pair, inputs, slot):
            margin = MARGIN(pair.margin, pair.data, one, other, inputs[pair.numbers + pair.size * slot :])
            kept[slot] = margin >= -BORDER * c.accuracy
    count = TOUCHING(pair.touching, pair.data, one, other, c.accuracy, found)
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
            for i in range(pair.size):
                inputs[pair.numbers + pair.size * slot + i] = found[pair.size * chosen[slot] + i]
        elif not kept[slot]:
            empty(c, pair, slot, inputs)


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
    return key_of(inputs[pair.numbers :], pair.size, slot)


def empty(c: Contacts, pair: FeaturePair, slot: int, inputs: Array) -> None:
    """Leave a slot without features."""
    for i in range(pair.size):
        inputs[pair.numbers + pair.size * slot + i] = 0.0
    inputs[c.first_mode + pair.gaps[slot]] = 0.0


def end_step(c: Contacts, t: float, y: Array, inputs: Array) -> None:
    """After a step: empty the slots that are open, and renew what the rows of the others iterate from."""
    places, one, other, has_places = zeros(c.places), zeros(POSE), zeros(POSE), False
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
                RENEW(pair.renew, pair.data, one, other, inputs[pair.numbers + pair.size * slot :])
