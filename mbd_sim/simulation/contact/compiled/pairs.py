"""The pairs of bodies that touch with changing features: how far they are apart, and whether they may meet.

A distance changes by no more than points of both bodies move against each other. What was computed at some poses
therefore bounds it at any others, whatever was between them: nothing depends on what is remembered.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import cast

from mbd_sim.compiler.ir.python_kinds import Array, External, Integers, zeros
from mbd_sim.simulation.contact.compiled.features.polytopes import WITHIN
from mbd_sim.simulation.contact.compiled.features.vectors import distance_of, dot, place, size_of, subtract
from mbd_sim.simulation.contact.compiled.instant.contacts import Contacts

NO_GAP = -1
LACKING = External("None", ())
DISTANCE = External("float", ("int", "Array", "Array"))
BEYOND = External("float", ("int", "Array", "Array", "Array", "Array", "float", "Array"))
MARGIN = External("float", ("int", "Array", "Array", "Array", "Array"))
TOUCHING = External("int", ("int", "Array", "Array", "float", "Array"))
RENEW = External("None", ("int", "Array", "Array", "Array"))

PATH = 1.05  # of the straight line, the path of a body in a step
AT_REST = 1e-6  # of the tolerance, by which the poses of bodies at rest may change in a step
TOUCH = 4.0  # tolerances, up to which spheres overlap
POSE = 12
# Of the place of a slot, which `margin` writes: the point, in axes that are the same for all slots of a pair, the
# normal, which is zero where areas of contact cannot shrink, and the gap in m.
SPOT, SPOT_NORMAL, SPOT_GAP = 7, 3, 6
LINE, TURNS, KNOWN = 0, 3, 21  # of what is remembered: the line between the centers, both rotations, and the distance
SEEN, SEEN_AT = 22, 23  # and how far the spheres around both were apart, when their parts had travelled so far together
MEMORY = 24


@dataclass(frozen=True)
class FeaturePair:
    """Two bodies with slots.

    `distance`, `beyond`, `margin`, `touching` and `renew` are the addresses of the functions of their narrow phase,
    which are given `data` first; for the second one, which only some have, see `beyond_gaps`, and for `iterates` and
    `found_at` see `NarrowPhase`. `first` and `second` are the rows of the poses of their parts; the spheres around them
    have `centers` (6,) and `radii` (2,). Nothing moves along axes of which `axes` (3,) is 0. Slot k is the gap `gaps`
    k; it has `size` numbers among the inputs. Those of the gap `first_gap` are from `numbers` on, and those of the gaps
    that follow it after them. The latest distance is remembered in `memory` (`MEMORY`,).

    Pair `number` of those that share a pool of `shared` gaps has a gap where one of its slots is in use, and otherwise
    `NO_GAP`: see `hold`. The numbers of the pairs that have the gaps are the inputs from `holders` on. Without a pool
    `shared` is 0. `lacking` is the address of a function that is called where all of them are in use.
    """

    distance: int
    beyond: int
    margin: int
    touching: int
    renew: int
    data: int
    iterates: bool
    found_at: int
    first: int
    second: int
    centers: Array
    radii: Array
    axes: Array
    slots: int
    gaps: Integers
    first_gap: int
    numbers: int
    size: int
    number: int
    shared: int
    holders: int
    lacking: int
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


def hold(c: Contacts, inputs: Array) -> None:
    """Give the pairs that share slots the gaps that they have among some inputs."""
    if c.first_pooled == c.gaps or is_held(c, inputs):
        return
    c.held_slots[0] = 0
    for index in range(c.body_pairs):
        pair = pair_at(c, index)
        for slot in range(pair.slots if pair.shared > 0 else 0):
            pair.gaps[slot] = NO_GAP
    for index in range(c.body_pairs):
        pair = pair_at(c, index)
        for position in range(pair.shared if pair.number == 0 else 0):
            if is_in_use(pair, inputs, position):
                give(pair_at(c, index + int(inputs[pair.holders + position])), pair.first_gap + position)
                c.held_slots[0] += 1


def is_held(c: Contacts, inputs: Array) -> bool:
    """Whether all pairs have the gaps that they have among some inputs, and no others."""
    used = 0
    for index in range(c.body_pairs):
        pair = pair_at(c, index)
        for position in range(pair.shared if pair.number == 0 else 0):
            if is_in_use(pair, inputs, position):
                used += 1
                if not has_gap(pair_at(c, index + int(inputs[pair.holders + position])), pair.first_gap + position):
                    return False
    return used == c.held_slots[0]


def has_gap(pair: FeaturePair, gap: int) -> bool:
    """Whether one of the slots of a pair has a gap."""
    return any(pair.gaps[slot] == gap for slot in range(pair.slots))


def is_in_use(pair: FeaturePair, inputs: Array, position: int) -> bool:
    """Whether a slot of the pool of a pair is in use."""
    return inputs[pair.numbers + pair.size * (position + 1) - 1] != 0.0


def give(pair: FeaturePair, gap: int) -> None:
    """Let a slot of a pair that is not in use have a gap."""
    for slot in range(pair.slots):
        if pair.gaps[slot] == NO_GAP:
            pair.gaps[slot] = gap
            return


def take(c: Contacts, pair: FeaturePair, slot: int, inputs: Array) -> bool:
    """Whether a slot has a gap, the first one of its pool that is not in use if it had none."""
    for position in range(pair.shared if pair.gaps[slot] == NO_GAP else 0):
        if not is_in_use(pair, inputs, position):
            pair.gaps[slot] = pair.first_gap + position
            inputs[pair.holders + position] = pair.number
            c.held_slots[0] += 1
            return True
    if pair.gaps[slot] == NO_GAP:
        LACKING(pair.lacking)
        return False
    return True


def numbers_at(pair: FeaturePair, slot: int) -> int:
    """Where the numbers of a slot with a gap are among the inputs."""
    return pair.numbers + pair.size * (pair.gaps[slot] - pair.first_gap)


def is_closed(c: Contacts, pair: FeaturePair, inputs: Array, slot: int) -> bool:
    """Whether a slot is closed."""
    return pair.gaps[slot] != NO_GAP and inputs[c.first_mode + pair.gaps[slot]] != 0.0


def any_closed(c: Contacts, pair: FeaturePair, inputs: Array) -> bool:
    """Whether one of the slots is closed."""
    return any(is_closed(c, pair, inputs, slot) for slot in range(pair.slots))


def distance_at(pair: FeaturePair, places: Array) -> float:
    """How far both bodies are apart."""
    one, other = zeros(POSE), zeros(POSE)
    put(pair, places, one, other)
    return DISTANCE(pair.distance, pair.data, one, other)


def beyond_gaps(c: Contacts, pair: FeaturePair, inputs: Array, before: Array, places: Array, readings: Array) -> float:
    """The distance, less the lowest of the gaps of the closed slots if that is negative.

    Features that were within each other `before`, by more than round-off, count from how deep they were there. Slots
    that were found so and are closed say themselves how their features move.
    """
    one, other, one_before, other_before = zeros(POSE), zeros(POSE), zeros(POSE), zeros(POSE)
    lowest, distance, limit, held, at = 0.0, distance_at(pair, places), -WITHIN * c.accuracy, zeros(pair.slots), 0
    for slot in range(pair.slots):
        if is_closed(c, pair, inputs, slot):
            lowest = min(lowest, readings[1 + pair.gaps[slot]])
            at = numbers_at(pair, slot)
            if pair.found_at >= 0 and inputs[at + pair.found_at] < 0.0:
                held[slot] = inputs[at + pair.size - 1]
    if distance < limit and pair.beyond != 0 and distance_at(pair, before) < limit:
        put(pair, places, one, other)
        put(pair, before, one_before, other_before)
        distance = BEYOND(pair.beyond, pair.data, one_before, other_before, one, other, limit, held)
    return distance - lowest


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


def travel(c: Contacts, before: Array, after: Array) -> None:
    """Add to what the parts have travelled: to the poses before a step, wherever they were last, and to those after it.

    No point near the center of a body moves farther than this, see `Contacts`.
    """
    for part in range(c.places // POSE):
        first = POSE * part
        c.stepped[part] = way(c, part, before[first:], after[first:])
        c.travelled[part] += way(c, part, c.latest[first:], before[first:]) + c.stepped[part]
    for i in range(c.places):
        c.latest[i] = after[i]


def way(c: Contacts, part: int, one: Array, other: Array) -> float:
    """How far in m centers of bodies have moved at most with a part, on straight lines."""
    return distance_of(one, other) + turned_by(c.reaches[part], one[3:], other[3:])


def is_far(c: Contacts, pair: FeaturePair) -> bool:
    """Whether the spheres around both bodies are apart by far more than a step, so that `may_meet` does not hold."""
    step = c.stepped[pair.first] + c.stepped[pair.second]
    apart = pair.memory[SEEN] - (c.travelled[pair.first] + c.travelled[pair.second] - pair.memory[SEEN_AT])
    return apart > 2.0 * step + TOUCH * c.accuracy


def see(c: Contacts, pair: FeaturePair, places: Array) -> None:
    """Remember how far the spheres are apart after a step."""
    pair.memory[SEEN] = spheres_apart(pair, places)
    pair.memory[SEEN_AT] = c.travelled[pair.first] + c.travelled[pair.second]


def may_meet(c: Contacts, pair: FeaturePair, inputs: Array, before: Array, after: Array) -> bool:
    """Whether bodies may have met, or features may have changed, on the way between two poses."""
    if not (moves(c, pair.first, before, after) or moves(c, pair.second, before, after)):
        return False
    path = PATH * path_between(pair, before, after) + TOUCH * c.accuracy
    if at_least(pair, before) + at_least(pair, after) > path and not any_closed(c, pair, inputs):
        return False
    return spheres_apart(pair, before) + spheres_apart(pair, after) <= path
