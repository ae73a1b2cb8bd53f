"""The narrow phase of two convex bodies of which at least one is round.

The bodies are apart by the largest of the s(n) of `normals`: of the normals of faces, of pairs of sides, and of those
that are iterated.
"""

from __future__ import annotations

import math

from mbd_sim.compiler.ir.python_kinds import Array, Integers, integers, zeros
from mbd_sim.dynamics.contact.shapes import FLAT_TILT, POINTS
from mbd_sim.dynamics.contact.smooth_rows import FIXED_FIRST, FIXED_SECOND, ITERATED, SMOOTH_SIZE, TWO_SIDES
from mbd_sim.simulation.contact.compiled.features.crossings import (
    CROSSING,
    GAP,
    ITERABLE,
    LEAST_ITERABLE,
    MARGIN,
    MEETING,
    NORMAL,
    POINT,
    crossings_gap,
    is_crossed,
    is_steep,
    meet_crossing,
)
from mbd_sim.simulation.contact.compiled.features.flat_rims import with_flat_rims
from mbd_sim.simulation.contact.compiled.features.meetings import meet
from mbd_sim.simulation.contact.compiled.features.normals import (
    CORNER_CORNER,
    CORNER_FACE,
    CORNER_SIDE,
    EDGE_RIM,
    FACE_CORNER,
    FACE_POINT,
    FIRST,
    KEY,
    KIND,
    POINT_FACE,
    RIM_EDGE,
    SECOND,
    SIDE_CORNER,
    SIDE_SIDE,
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
from mbd_sim.simulation.contact.compiled.features.polytopes import BORDER, COUNT, SUPPORT, TURNED
from mbd_sim.simulation.contact.compiled.features.round_bodies import (
    CHORD,
    CODES,
    FLAT,
    PlacedRound,
    codes,
    lies,
    put_round,
    tilt,
)
from mbd_sim.simulation.contact.compiled.features.vectors import (
    add,
    copy,
    cross,
    distance_of,
    least_axis,
    place,
    place_back,
    scale,
    size_of,
    subtract,
    turn,
    turn_back,
)

HINT = 0.1  # rad by which a normal may turn from its hint
LEVEL = 1e-9  # sine of the angle at which an edge that crosses a rim comes to lie on the end within it
ROUND_OFF = 1e-6  # of `near`: a distance that is not less is at least the one found first


def smooth_distance(p: RoundBodies, one: Array, other: Array) -> float:
    """See `NarrowPhase`."""
    a = PlacedRound(p.first, zeros(12), zeros(3 * p.first.count), zeros(3 * p.first.sides), zeros(3 * p.first.faces))
    b = PlacedRound(
        p.second, zeros(12), zeros(3 * p.second.count), zeros(3 * p.second.sides), zeros(3 * p.second.faces)
    )
    put_round(a, one, other)
    put_round(b, other, other)
    return smooth_gap(p, a, b)


def smooth_gap(p: RoundBodies, a: PlacedRound, b: PlacedRound) -> float:
    """The distance of both bodies."""
    key, normal, simple = integers(KEY), zeros(3), simple_count(p)
    apart = crossings_gap(p, a, b, max(simple_gap(p, a, b), starts_gap(p, a, b)))
    if not (apart > ROUND_OFF * p.near or is_on_face(p, a, b, apart)):
        for index in range(simple, simple + p.count):
            key_at(p, index, key)
            iterated_normal(a, b, key, normal, False, normal)
            apart = max(apart, support(p, a, b, normal))
    return with_flat_rims(p, a, b, apart)


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
            if meeting[MARGIN] >= 0.0 and meeting[GAP] <= apart:
                return True
    return False


def smooth_touching(p: RoundBodies, one: Array, other: Array, tolerance: float, slots: Array) -> int:
    """See `NarrowPhase`."""
    a = PlacedRound(p.first, zeros(12), zeros(3 * p.first.count), zeros(3 * p.first.sides), zeros(3 * p.first.faces))
    b = PlacedRound(
        p.second, zeros(12), zeros(3 * p.second.count), zeros(3 * p.second.sides), zeros(3 * p.second.faces)
    )
    key, normal, count, simple = integers(KEY), zeros(3), integers(1), simple_count(p)
    normals, points = zeros(3 * p.count), zeros(3 * p.slots)
    put_round(a, one, other)
    put_round(b, other, other)
    apart = crossings_gap(p, a, b, simple_gap(p, a, b))
    for k in range(p.count):
        key_at(p, simple + k, key)
        iterated_normal(a, b, key, normal, False, normals[3 * k :])
        apart = max(apart, support(p, a, b, normals[3 * k :]))
    bottom = min(with_flat_rims(p, a, b, apart), 0.0) - SUPPORT * tolerance
    for index in range(simple + p.count):
        key_at(p, index, key)
        if index == simple:
            consider_crossings(p, a, b, bottom, tolerance, slots, points, count)
        if index >= simple:
            copy(normals[3 * (index - simple) :], normal)
            if count[0] > 0 and level(p, a, b, key, normal, FLAT, ITERABLE) < 0.0:
                continue
        elif not simple_normal(a, b, key, normal):
            continue
        is_face = key[KIND] in (CORNER_FACE, FACE_CORNER)
        if support(p, a, b, normal) < bottom - (FLAT_TILT * p.reach if is_face else 0.0):
            continue
        if is_face:
            consider_face(p, a, b, key, normal, bottom, tolerance, slots, points, count)
        else:
            consider(p, a, b, key, normal, normal, bottom, tolerance, slots, points, count)
    return count[0]


def level(
    p: RoundBodies, a: PlacedRound, b: PlacedRound, key: Integers, normal: Array, limit: float, crossed: float
) -> float:
    """In m, negative where an edge lies on the end of a body so flat that it has no normal of its own at the rim.

    There the support of the rim has no derivative; its crossings, or points of edges and the corners on this end, carry
    the edge.

    :param limit: the sine of the angle up to which it lies flat; `crossed` is that of edges with crossings.
    """
    if key[KIND] == SIDE_CORNER and not a.hull.ruled[key[FIRST]] and b.hull.curved[key[SECOND]]:
        if p.radius == 0.0 and is_crossed(a, key[FIRST], b, key[SECOND]):
            limit = crossed
        return (tilt(b, key[SECOND], normal) - limit) * b.hull.rims[key[SECOND]]
    if key[KIND] == CORNER_SIDE and not b.hull.ruled[key[SECOND]] and a.hull.curved[key[FIRST]]:
        if p.radius == 0.0 and is_crossed(b, key[SECOND], a, key[FIRST]):
            limit = crossed
        return (tilt(a, key[FIRST], normal) - limit) * a.hull.rims[key[FIRST]]
    return math.inf


def consider_crossings(
    p: RoundBodies, a: PlacedRound, b: PlacedRound, bottom: float, top: float, slots: Array, points: Array,
    count: Integers,
) -> None:  # fmt: skip
    """Write the slots of sharp edges that cross the rims of round ends on which they lie, nearly or entirely."""
    key = integers(KEY)
    if p.radius > 0.0:
        return
    key[KIND] = EDGE_RIM
    for face in range(0 if a.hull.is_curved else b.hull.faces):
        for side in range(a.hull.sides if b.hull.face_radii[face] > 0.0 else 0):
            key[FIRST], key[SECOND] = side, face
            consider_crossing(p, a, b, key, b.normals[3 * face :], 1.0, bottom, top, slots, points, count)
    key[KIND] = RIM_EDGE
    for face in range(0 if b.hull.is_curved else a.hull.faces):
        for side in range(b.hull.sides if a.hull.face_radii[face] > 0.0 else 0):
            key[FIRST], key[SECOND] = face, side
            consider_crossing(p, a, b, key, a.normals[3 * face :], -1.0, bottom, top, slots, points, count)


def consider_crossing(
    p: RoundBodies, a: PlacedRound, b: PlacedRound, key: Integers, axis: Array, toward: float, bottom: float,
    top: float, slots: Array, points: Array, count: Integers,
) -> None:  # fmt: skip
    """Write the slots of both ends of the chord of an edge across a round end, unless it is on the other side."""
    normal, meeting = zeros(3), zeros(MEETING)
    for number in range(2):
        key[SIGN] = 2 * number - 1
        if not meet_crossing(a, b, key, meeting) or is_steep(axis, meeting):
            continue
        scale(toward, axis, normal)
        if support(p, a, b, normal) >= bottom - CROSSING * p.reach:
            consider(p, a, b, key, normal, normal, bottom, top, slots, points, count)


def consider_face(
    p: RoundBodies, a: PlacedRound, b: PlacedRound, key: Integers, normal: Array, bottom: float, top: float,
    slots: Array, points: Array, count: Integers,
) -> None:  # fmt: skip
    """Write the slots of all that touches at a face: corners, and points that are fixed in what lies on it."""
    body, other, at, own, part = a, b, zeros(3), FIRST, CHORD if p.radius > 0.0 else 0.0
    face, kind = key[SECOND], POINT_FACE
    if key[KIND] == FACE_CORNER:
        body, other, own = b, a, SECOND
        face, kind = key[FIRST], FACE_POINT
    for corner in range(body.hull.count):
        key[own] = corner
        consider(p, a, b, key, normal, normal, bottom, top, slots, points, count)
    key[KIND] = kind
    for code in range(codes(body.hull)):
        if lies(body, other, face, code, part, at):
            key[own] = code
            consider(p, a, b, key, normal, at, bottom, top, slots, points, count)


def consider(
    p: RoundBodies, a: PlacedRound, b: PlacedRound, key: Integers, normal: Array, at: Array, bottom: float, top: float,
    slots: Array, points: Array, count: Integers,
) -> None:  # fmt: skip
    """Write the slot of two features that meet, unless a point has been found at this place or no slot is left."""
    meeting = zeros(MEETING)
    meet(p, a, b, key, normal, at, meeting)
    if count[0] == p.slots or not (bottom <= meeting[GAP] <= top and meeting[MARGIN] >= -BORDER * top):
        return
    for k in range(count[0]):
        if distance_of(meeting[POINT:], points[3 * k :]) <= p.near:
            return
    copy(meeting[POINT:], points[3 * count[0] :])
    write_slot(a, b, key, meeting, slots[SMOOTH_SIZE * count[0] :])
    count[0] += 1


def smooth_margin(p: RoundBodies, one: Array, other: Array, numbers: Array, spot: Array) -> float:
    """See `NarrowPhase`, and `SPOT` in `pairs`."""
    a = PlacedRound(p.first, zeros(12), zeros(3 * p.first.count), zeros(3 * p.first.sides), zeros(3 * p.first.faces))
    b = PlacedRound(
        p.second, zeros(12), zeros(3 * p.second.count), zeros(3 * p.second.sides), zeros(3 * p.second.faces)
    )
    key, normal, at, own = integers(KEY), zeros(3), zeros(3), zeros(3)
    meeting, side, stored = zeros(MEETING), zeros(3), zeros(3)
    put_round(a, one, other)
    put_round(b, other, other)
    decode(int(numbers[SMOOTH_SIZE - 1]), key)
    if not is_crossing(key[KIND]):
        stored_normal(a, b, key, numbers, normal)
    if key[KIND] == POINT_FACE:
        add(numbers, 1.0, p.first.at, own)
        place(a.pose, own, at)
    if key[KIND] == FACE_POINT:
        add(numbers[3:], 1.0, p.second.at, own)
        place(b.pose, own, at)
    meet(p, a, b, key, normal, at, meeting)
    copy(meeting[NORMAL:], normal)
    turn(b.pose, numbers[25:], stored)
    cross(stored, normal, side)
    copy(meeting[POINT:], spot)
    copy(normal, spot[3:])
    spot[6] = meeting[GAP]
    margin = min(meeting[MARGIN], size_of(side) - TURNED)
    if is_iterated(key[KIND]):
        turn(b.pose, numbers[22:], stored)
        margin = min(
            min(margin, HINT - distance_of(normal, stored)), level(p, a, b, key, normal, LEVEL, LEAST_ITERABLE)
        )
    return margin


def smooth_renew(p: RoundBodies, one: Array, other: Array, numbers: Array) -> None:
    """See `NarrowPhase`."""
    a = PlacedRound(p.first, zeros(12), zeros(3 * p.first.count), zeros(3 * p.first.sides), zeros(3 * p.first.faces))
    b = PlacedRound(
        p.second, zeros(12), zeros(3 * p.second.count), zeros(3 * p.second.sides), zeros(3 * p.second.faces)
    )
    key, normal = integers(KEY), zeros(3)
    decode(int(numbers[SMOOTH_SIZE - 1]), key)
    if is_iterated(key[KIND]):
        put_round(a, one, other)
        put_round(b, other, other)
        stored_normal(a, b, key, numbers, normal)
        turn_back(b.pose, normal, numbers[22:])


def is_iterated(kind: int) -> bool:
    """Whether the normal of a kind of pairs is iterated."""
    return kind in (SIDE_CORNER, CORNER_SIDE, CORNER_CORNER)


def is_crossing(kind: int) -> bool:
    """Whether the features of a kind are an edge and a rim that it crosses."""
    return kind in (EDGE_RIM, RIM_EDGE)


def stored_normal(a: PlacedRound, b: PlacedRound, key: Integers, numbers: Array, out: Array) -> None:
    """The normal of a pair of features, from the hint among the numbers of its slot."""
    start = zeros(3)
    if is_iterated(key[KIND]):
        turn(b.pose, numbers[22:], start)
        iterated_normal(a, b, key, start, True, out)
    else:
        simple_normal(a, b, key, out)


def encoded(key: Integers) -> int:
    """A pair of features as one number."""
    return 1 + ((key[KIND] * COUNT + key[FIRST]) * COUNT + key[SECOND]) * 2 + (1 if key[SIGN] > 0 else 0)


def decode(number: int, key: Integers) -> None:
    """The pair of features with this number."""
    rest = number - 1
    key[KIND] = rest // (2 * COUNT * COUNT)
    key[FIRST], key[SECOND] = rest // (2 * COUNT) % COUNT, rest // 2 % COUNT
    key[SIGN] = 2 * (rest % 2) - 1 if key[KIND] == SIDE_SIDE or is_crossing(key[KIND]) else 0


def write_slot(a: PlacedRound, b: PlacedRound, key: Integers, meeting: Array, slot: Array) -> None:
    """The numbers of a slot: see `mbd_sim.dynamics.contact.smooth_rows`."""
    kind, own, mode = key[KIND], zeros(3), ITERATED
    for k in range(SMOOTH_SIZE):
        slot[k] = 0.0
    is_side, is_face = kind in (SIDE_SIDE, SIDE_CORNER, EDGE_RIM), kind in (FACE_CORNER, FACE_POINT, RIM_EDGE)
    write_body(a, 0, key[FIRST], is_side, is_face, kind, meeting, slot)
    is_side, is_face = kind in (SIDE_SIDE, CORNER_SIDE, RIM_EDGE), kind in (CORNER_FACE, POINT_FACE, EDGE_RIM)
    write_body(b, 1, key[SECOND], is_side, is_face, kind, meeting, slot)
    if kind in (CORNER_FACE, POINT_FACE):
        mode = FIXED_SECOND
    elif kind in (FACE_CORNER, FACE_POINT):
        mode = FIXED_FIRST
    elif kind == SIDE_SIDE:
        mode = TWO_SIDES
    if not is_crossing(kind):
        slot[16 + mode] = 1.0
    slot[20] = key[SIGN]
    slot[21] = 1.0 if kind in (FACE_CORNER, FACE_POINT, SIDE_CORNER) else 0.0
    turn_back(b.pose, meeting[NORMAL:], own)
    copy(own, slot[22:])
    least_axis(own, slot[25:])
    if mode == FIXED_FIRST:
        turn_back(a.pose, meeting[NORMAL:], slot[22:])
    if is_crossing(kind):
        slot[30] = 1.0
    if kind == EDGE_RIM:
        copy(b.hull.normals[3 * key[SECOND] :], slot[22:])
    if kind == RIM_EDGE:
        copy(a.hull.normals[3 * key[FIRST] :], slot[22:])
    slot[SMOOTH_SIZE - 1] = encoded(key)


def write_body(
    body: PlacedRound, own: int, feature: int, is_side: bool, is_face: bool, kind: int, meeting: Array, slot: Array
) -> None:
    """The numbers of a slot that belong to one of the bodies: its corner, rim, direction, cosine and flat rim."""
    hull, is_point = body.hull, kind in (POINT_FACE, FACE_POINT) and not is_face
    corner, at = feature, zeros(3)
    if is_side:
        corner = hull.ends[2 * feature]
        copy(hull.directions[3 * feature :], slot[6 + 3 * own :])
        slot[14 + own] = hull.cosines[feature]
    if is_point:
        place_back(body.pose, meeting[POINT:], at)
        if feature % CODES < POINTS:
            slot[28 + own] = hull.rims[feature // CODES]
    elif is_face:
        copy(hull.centers[3 * feature :], at)
        if is_crossing(kind):
            slot[12 + own] = hull.face_radii[feature]
    else:
        copy(hull.corners[3 * corner :], at)
        slot[12 + own] = hull.marks[corner]
    subtract(at, hull.at, slot[3 * own :])
