"""How far two convex bodies are apart of which at least one is round.

They are apart by the largest of the s(n) of `normals`: of the normals of faces, of pairs of sides, and of those that
are iterated.
"""

from __future__ import annotations

import math

from mbd_sim.compiler.ir.python_kinds import Array, Integers, integers, zeros
from mbd_sim.simulation.contact.compiled.features.round.bodies import PlacedRound, put_round
from mbd_sim.simulation.contact.compiled.features.round.crossings import (
    GAP,
    MARGIN,
    MEETING,
    crossings_gap,
    face_of,
    meet_crossing,
)
from mbd_sim.simulation.contact.compiled.features.round.flat_rims import Before, with_flat_rims
from mbd_sim.simulation.contact.compiled.features.round.meetings import meet
from mbd_sim.simulation.contact.compiled.features.round.normals import (
    CORNER_FACE,
    CORNER_SIDE,
    EDGE_RIM,
    FACE_CORNER,
    FIRST,
    KEY,
    KIND,
    RIM_EDGE,
    SECOND,
    SIDE_CORNER,
    SIGN,
    STARTS,
    RoundBodies,
    iterated_normal,
    key_at,
    simple_count,
    simple_normal,
    start_direction,
    support,
)
from mbd_sim.simulation.contact.compiled.features.round.rims import is_rim_contact, nearest_of_rim
from mbd_sim.simulation.contact.compiled.features.round.rounded_edges import is_at_rim, nearest_at_rim
from mbd_sim.simulation.contact.compiled.features.vectors import copy, turn

ROUND_OFF = 1e-6  # of `near`: a distance that is not less is at least the one found first


def smooth_distance(p: RoundBodies, one: Array, other: Array) -> float:
    """See `NarrowPhase`."""
    a = PlacedRound(p.first, zeros(12), zeros(3 * p.first.count), zeros(3 * p.first.sides), zeros(3 * p.first.faces))
    b = PlacedRound(
        p.second, zeros(12), zeros(3 * p.second.count), zeros(3 * p.second.sides), zeros(3 * p.second.faces)
    )
    put_round(a, one, other)
    put_round(b, other, other)
    return with_flat_rims(p, a, b, Before(a, b, False, 0.0, zeros(0)), apart_without(p, a, b))


def smooth_beyond(
    p: RoundBodies, one_before: Array, other_before: Array, one: Array, other: Array, limit: float, held: Array
) -> float:  # fmt: skip
    """See `BEYOND` in `pairs`."""
    a = PlacedRound(p.first, zeros(12), zeros(3 * p.first.count), zeros(3 * p.first.sides), zeros(3 * p.first.faces))
    b = PlacedRound(
        p.second, zeros(12), zeros(3 * p.second.count), zeros(3 * p.second.sides), zeros(3 * p.second.faces)
    )
    c = PlacedRound(p.first, zeros(12), zeros(3 * p.first.count), zeros(3 * p.first.sides), zeros(3 * p.first.faces))
    d = PlacedRound(
        p.second, zeros(12), zeros(3 * p.second.count), zeros(3 * p.second.sides), zeros(3 * p.second.faces)
    )
    put_round(a, one, other)
    put_round(b, other, other)
    put_round(c, one_before, other_before)
    put_round(d, other_before, other_before)
    before = Before(c, d, True, limit, held)
    return with_flat_rims(p, a, b, before, apart_without(p, a, b) - min(apart_without(p, c, d), 0.0))


def apart_without(p: RoundBodies, a: PlacedRound, b: PlacedRound) -> float:
    """The distance of both bodies, but for rims that lie nearly flat."""
    key, normal, toward, simple = integers(KEY), zeros(3), zeros(3), simple_count(p)
    apart = crossings_gap(p, a, b, max(simple_gap(p, a, b), starts_gap(p, a, b)))
    if not (apart > ROUND_OFF * p.near or is_on_face(p, a, b, apart)):
        for index in range(simple, simple + p.count):
            key_at(p, index, key)
            iterate(p, a, b, key, normal, toward)
            apart = max(apart, support(p, a, b, normal))
    return apart


def simple_gap(p: RoundBodies, a: PlacedRound, b: PlacedRound) -> float:
    """The largest s(n) of faces and of pairs of sides."""
    key, normal, found = integers(KEY), zeros(3), -math.inf
    for index in range(simple_count(p)):
        key_at(p, index, key)
        if simple_normal(a, b, key, normal):
            found = max(found, support(p, a, b, normal))
    return found


def starts_gap(p: RoundBodies, a: PlacedRound, b: PlacedRound) -> float:
    """The largest s(n) of some directions that are fixed in the second part."""
    direction, normal, found = zeros(3), zeros(3), -math.inf
    for number in range(STARTS):
        start_direction(number, direction)
        turn(b.pose, direction, normal)
        found = max(found, support(p, a, b, normal))
    return found


def is_on_face(p: RoundBodies, a: PlacedRound, b: PlacedRound, apart: float) -> bool:
    """Whether a corner is within the border of a face that it touches, up to round-off."""
    key, normal, meeting = integers(KEY), zeros(3), zeros(MEETING)
    if abs(apart) > ROUND_OFF * p.near:
        return False
    for index in range(a.hull.faces + b.hull.faces):
        key_at(p, index, key)
        simple_normal(a, b, key, normal)
        count = a.hull.count if key[KIND] == CORNER_FACE else b.hull.count
        for corner in range(count):
            key[SECOND if key[KIND] == FACE_CORNER else FIRST] = corner
            meet(p, a, b, key, normal, normal, meeting)
            if meeting[MARGIN] >= 0.0 and abs(meeting[GAP] - apart) <= ROUND_OFF * p.near:
                return True
    return False


def iterate(p: RoundBodies, a: PlacedRound, b: PlacedRound, key: Integers, normal: Array, toward: Array) -> None:
    """The normal of a pair of features that is iterated, and the direction from which a row does that."""
    if is_at_rim(p, a, b, key):
        nearest_at_rim(a, b, key, toward, normal)
    elif is_rim_contact(a, b, key):
        nearest_of_rim(a, b, key, toward, normal)
    else:
        iterated_normal(a, b, key, normal, False, normal)
        better_crossing(p, a, b, key, normal)
        copy(normal, toward)


def better_crossing(p: RoundBodies, a: PlacedRound, b: PlacedRound, key: Integers, normal: Array) -> None:
    """Let the normal of a crossing take the place of an iterated one, which may get stuck near the axis of the rim."""
    meeting, corner = zeros(MEETING), integers(KEY)
    if p.radius > 0.0:
        return
    corner[FIRST], corner[SECOND] = key[FIRST], key[SECOND]
    if key[KIND] == SIDE_CORNER and not a.hull.ruled[key[FIRST]]:
        corner[KIND], corner[SECOND] = EDGE_RIM, face_of(b.hull, key[SECOND])
    if key[KIND] == CORNER_SIDE and not b.hull.ruled[key[SECOND]]:
        corner[KIND], corner[FIRST] = RIM_EDGE, face_of(a.hull, key[FIRST])
    if corner[KIND] == 0 or min(corner[FIRST], corner[SECOND]) < 0:
        return
    for number in range(2):
        corner[SIGN] = 2 * number - 1
        if meet_crossing(a, b, corner, meeting) and support(p, a, b, meeting) > support(p, a, b, normal):
            copy(meeting, normal)
