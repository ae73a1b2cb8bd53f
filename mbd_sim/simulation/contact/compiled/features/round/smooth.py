"""Where two convex bodies touch of which at least one is round: the features at slots, and how long these meet."""

from __future__ import annotations

import math

from mbd_sim.compiler.ir.python_kinds import Array, Integers, integers, zeros
from mbd_sim.dynamics.contact.shapes import FLAT_TILT
from mbd_sim.dynamics.contact.smooth_rows import SMOOTH_SIZE
from mbd_sim.simulation.contact.compiled.features.polytopes import BORDER, SUPPORT, TURNED, WITHIN
from mbd_sim.simulation.contact.compiled.features.round.bodies import FLAT, PlacedRound, codes, facing, lies, put_round
from mbd_sim.simulation.contact.compiled.features.round.crossings import (
    CHANGED,
    FREE,
    GAP,
    ITERABLE,
    LEAST_ITERABLE,
    MARGIN,
    MEETING,
    NORMAL,
    POINT,
    STEEP,
    TOWARD,
    crossings_gap,
    half_of_chord,
    is_crossing,
    is_steep,
    meet_crossing,
)
from mbd_sim.simulation.contact.compiled.features.round.flat_rims import Before, with_flat_rims
from mbd_sim.simulation.contact.compiled.features.round.flat_sides import (
    has_chord,
    is_chord_end,
    level,
    tilt_over_chord,
)
from mbd_sim.simulation.contact.compiled.features.round.meetings import meet
from mbd_sim.simulation.contact.compiled.features.round.normals import (
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
    RoundBodies,
    iterated_normal,
    key_at,
    simple_count,
    simple_normal,
    support,
)
from mbd_sim.simulation.contact.compiled.features.round.rims import is_rim_contact, meet_rim
from mbd_sim.simulation.contact.compiled.features.round.rounded_edges import is_at_rim, meet_at_rim
from mbd_sim.simulation.contact.compiled.features.round.slots import (
    arm_of,
    can_bend,
    chord_at,
    decode,
    has_direction,
    is_beneath,
    is_iterated,
    is_rim_on_face,
    lean_left,
    room_along,
    room_beside,
    stored_arm,
    write_arm,
    write_chord,
    write_lean,
    write_slot,
)
from mbd_sim.simulation.contact.compiled.features.round.smooth_distances import iterate, simple_gap
from mbd_sim.simulation.contact.compiled.features.vectors import (
    add,
    copy,
    cross,
    distance_of,
    place,
    place_back,
    scale,
    size_of,
    turn,
    turn_back,
)

ROLLED = 0.15  # rad by which the lowest point of a rim may run around it in a step, the faster the flatter it lies
LEVEL = 1e-9  # sine of the angle at which an edge that crosses a rim comes to lie on the end within it
OTHER_SIDE = 1e-3  # of both bodies: so deep are they beyond a crossing if the edge is on the other side of the end


def smooth_touching(p: RoundBodies, one: Array, other: Array, tolerance: float, slots: Array) -> int:
    """See `NarrowPhase`."""
    a = PlacedRound(p.first, zeros(12), zeros(3 * p.first.count), zeros(3 * p.first.sides), zeros(3 * p.first.faces))
    b = PlacedRound(
        p.second, zeros(12), zeros(3 * p.second.count), zeros(3 * p.second.sides), zeros(3 * p.second.faces)
    )
    key, normal, toward, count, simple, lies = integers(KEY), zeros(3), zeros(3), integers(1), simple_count(p), False
    normals, directions, points = zeros(3 * p.count), zeros(3 * p.count), zeros(3 * p.slots)
    put_round(a, one, other)
    put_round(b, other, other)
    apart = crossings_gap(p, a, b, simple_gap(p, a, b))
    for k in range(p.count):
        key_at(p, simple + k, key)
        iterate(p, a, b, key, normals[3 * k :], directions[3 * k :])
        apart = max(apart, support(p, a, b, normals[3 * k :]))
    bottom = min(with_flat_rims(p, a, b, Before(a, b, False, 0.0, zeros(0)), apart), 0.0) - SUPPORT * tolerance
    for index in range(simple + p.count):
        key_at(p, index, key)
        if index == simple:
            consider_crossings(p, a, b, bottom, tolerance, slots, points, count)
        if index >= simple:
            copy(normals[3 * (index - simple) :], normal)
            copy(directions[3 * (index - simple) :], toward)
            lies = level(p, a, b, key, normal, toward, FLAT, ITERABLE) < 0.0
            if lies and (count[0] > 0 or has_chord(p, a, b, key, toward)):
                continue
        elif not simple_normal(a, b, key, normal):
            continue
        is_face = key[KIND] in (CORNER_FACE, FACE_CORNER)
        if support(p, a, b, normal) < bottom - (FLAT_TILT * p.reach if is_face else 0.0):
            continue
        if is_face:
            consider_face(p, a, b, key, normal, bottom, tolerance, slots, points, count)
        else:
            consider(p, a, b, key, normal, toward, bottom, tolerance, slots, points, count)
    return count[0]


def consider_crossings(
    p: RoundBodies, a: PlacedRound, b: PlacedRound, bottom: float, top: float, slots: Array, points: Array,
    count: Integers,
) -> None:  # fmt: skip
    """Write the slots of edges and sides that cross the rims of round ends on which they lie, nearly or entirely."""
    key = integers(KEY)
    consider_chords(p, a, b, EDGE_RIM, bottom, top, slots, points, count)
    consider_chords(p, a, b, RIM_EDGE, bottom, top, slots, points, count)
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
    normal, meeting, apart = zeros(3), zeros(MEETING), -math.inf
    if key[KIND] == EDGE_RIM:
        apart = apart_at(p, a, b, facing(b, key[SECOND], a), a, -1.0)
    else:
        apart = apart_at(p, a, b, facing(a, key[FIRST], b), b, 1.0)
    for number in range(2):
        key[SIGN] = 2 * number - 1
        if not meet_crossing(a, b, key, meeting) or is_steep(axis, meeting):
            continue
        if max(apart, support(p, a, b, meeting[NORMAL:])) >= bottom - OTHER_SIDE * p.reach:
            scale(toward, axis, normal)
            consider(p, a, b, key, normal, normal, bottom, top, slots, points, count)


def apart_at(p: RoundBodies, a: PlacedRound, b: PlacedRound, face: int, body: PlacedRound, sign: float) -> float:
    """s(n) of the normal of a face of one of the bodies, times a sign."""
    normal = zeros(3)
    if face < 0:
        return -math.inf
    scale(sign, body.normals[3 * face :], normal)
    return support(p, a, b, normal)


def consider_chords(
    p: RoundBodies, a: PlacedRound, b: PlacedRound, kind: int, bottom: float, top: float, slots: Array, points: Array,
    count: Integers,
) -> None:  # fmt: skip
    """Write the slots of both ends of the chord of a round edge or a side that lies on a round end, or nearly so."""
    key, toward, normal, meeting = integers(KEY), zeros(3), zeros(3), zeros(MEETING)
    key[KIND] = kind
    for i in range(a.hull.sides if kind == EDGE_RIM else a.hull.count):
        for j in range(b.hull.count if kind == EDGE_RIM else b.hull.sides):
            for number in range(2):
                key[FIRST], key[SECOND], key[SIGN] = i, j, 2 * number - 1
                if not is_chord_end(p, a, b, key, toward):
                    continue
                meet(p, a, b, key, normal, toward, meeting)
                if tilt_over_chord(p, a, b, key, meeting, STEEP) <= 0.0:
                    consider(p, a, b, key, normal, toward, bottom, top, slots, points, count)


def consider_face(
    p: RoundBodies, a: PlacedRound, b: PlacedRound, key: Integers, normal: Array, bottom: float, top: float,
    slots: Array, points: Array, count: Integers,
) -> None:  # fmt: skip
    """Write the slots of all that touches at a face: corners, and points that are fixed in what lies on it."""
    body, other, at, own = a, b, zeros(3), FIRST
    face, kind = key[SECOND], POINT_FACE
    if key[KIND] == FACE_CORNER:
        body, other, own = b, a, SECOND
        face, kind = key[FIRST], FACE_POINT
    for corner in range(body.hull.count):
        key[own] = corner
        consider(p, a, b, key, normal, normal, bottom, top, slots, points, count)
    key[KIND] = kind
    for code in range(codes(body.hull)):
        if lies(body, other, face, code, 0.0, at):
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
    write_slot(p, a, b, key, meeting, -WITHIN * top, slots[SMOOTH_SIZE * count[0] :])
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
    if has_direction(p, a, b, key):
        turn(b.pose, numbers[22:], at)
    elif not is_crossing(key[KIND]):
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
    if is_iterated(p, a, b, key):
        turn(b.pose, numbers[22:], stored)
        margin = min(margin, meeting[FREE] - distance_of(meeting[TOWARD:], stored))
        margin = min(margin, level(p, a, b, key, normal, meeting[TOWARD:], LEVEL, LEAST_ITERABLE))
    elif is_beneath(p, a, b, key, numbers):
        margin = min(margin, room_beside(a, b, key, meeting[POINT:], numbers))
    elif is_crossing(key[KIND]):
        half = numbers[chord_at(key)]
        margin = min(margin, CHANGED * half - abs(half_of_chord(a, b, key) - half))
    elif key[KIND] == SIDE_SIDE:
        margin = min(margin, room_along(a, b, key, meeting[POINT:], numbers))
    elif is_rim_on_face(a, b, key):
        stored_arm(a, b, key, numbers, stored)
        arm_of(a, b, key, meeting[POINT:], own)
        margin = min(margin, ROLLED - distance_of(own, stored))
    if can_bend(numbers):
        margin = min(margin, lean_left(a, b, numbers))
    return margin


def smooth_renew(p: RoundBodies, one: Array, other: Array, numbers: Array) -> None:
    """See `NarrowPhase`."""
    a = PlacedRound(p.first, zeros(12), zeros(3 * p.first.count), zeros(3 * p.first.sides), zeros(3 * p.first.faces))
    b = PlacedRound(
        p.second, zeros(12), zeros(3 * p.second.count), zeros(3 * p.second.sides), zeros(3 * p.second.faces)
    )
    key, normal, meeting = integers(KEY), zeros(3), zeros(MEETING)
    decode(int(numbers[SMOOTH_SIZE - 1]), key)
    put_round(a, one, other)
    put_round(b, other, other)
    if can_bend(numbers):
        write_lean(a, b, numbers)
    if is_iterated(p, a, b, key):
        if is_at_rim(p, a, b, key):
            turn(b.pose, numbers[22:], normal)
            meet_at_rim(p, a, b, key, normal, meeting)
            copy(meeting[TOWARD:], normal)
        elif is_rim_contact(a, b, key):
            turn(b.pose, numbers[22:], normal)
            meet_rim(a, b, key, normal, meeting)
            copy(meeting[TOWARD:], normal)
        else:
            stored_normal(a, b, key, numbers, normal)
        turn_back(b.pose, normal, numbers[22:])
    elif is_crossing(key[KIND]) and not is_beneath(p, a, b, key, numbers):
        write_chord(a, b, key, numbers)
    elif is_rim_on_face(a, b, key):
        simple_normal(a, b, key, normal)
        meet(p, a, b, key, normal, normal, meeting)
        write_arm(a, b, key, meeting[POINT:], numbers)
    elif key[KIND] == SIDE_SIDE:
        simple_normal(a, b, key, normal)
        meet(p, a, b, key, normal, normal, meeting)
        place_back(b.pose, meeting[POINT:], numbers[22:])


def stored_normal(a: PlacedRound, b: PlacedRound, key: Integers, numbers: Array, out: Array) -> None:
    """The normal of a pair of features, from the hint among the numbers of its slot."""
    start = zeros(3)
    if key[KIND] in (SIDE_CORNER, CORNER_SIDE, CORNER_CORNER):
        turn(b.pose, numbers[22:], start)
        iterated_normal(a, b, key, start, True, out)
    else:
        simple_normal(a, b, key, out)
