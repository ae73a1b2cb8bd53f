"""The numbers of slots of round bodies: see `mbd_sim.dynamics.contact.smooth_rows`."""

from __future__ import annotations

import math

from mbd_sim.compiler.ir.python_kinds import Array, Integers, zeros
from mbd_sim.dynamics.contact.shapes import FLAT_TILT, POINTS
from mbd_sim.dynamics.contact.smooth_rows import FIXED_FIRST, FIXED_SECOND, FOUND_AT, ITERATED, SMOOTH_SIZE, TWO_SIDES
from mbd_sim.simulation.contact.compiled.features.polytopes import COUNT, PASSED, SLANTED
from mbd_sim.simulation.contact.compiled.features.round.bodies import (
    CODES,
    LEAST,
    PlacedRound,
    RoundHull,
    bend_below,
    facing,
    middle,
)
from mbd_sim.simulation.contact.compiled.features.round.crossings import (
    CHANGED,
    GAP,
    NORMAL,
    POINT,
    TOWARD,
    half_of_chord,
    height_of,
    is_crossing,
    lies_flat,
    point_on_edge,
)
from mbd_sim.simulation.contact.compiled.features.round.normals import (
    CORNER_CORNER,
    CORNER_FACE,
    CORNER_SIDE,
    EDGE_RIM,
    FACE_CORNER,
    FACE_POINT,
    FIRST,
    KIND,
    POINT_FACE,
    RIM_EDGE,
    SECOND,
    SIDE_CORNER,
    SIDE_SIDE,
    SIGN,
    RoundBodies,
)
from mbd_sim.simulation.contact.compiled.features.round.rims import is_rim_contact
from mbd_sim.simulation.contact.compiled.features.round.rounded_edges import is_at_rim
from mbd_sim.simulation.contact.compiled.features.vectors import (
    add,
    copy,
    cross,
    distance_of,
    divide,
    dot,
    least_axis,
    place_back,
    scale,
    size_of,
    subtract,
    turn,
    turn_back,
)

LEANED = 0.05 * FLAT_TILT  # by which an end that lies nearly flat may turn in a step: it is bent the more


def is_iterated(p: RoundBodies, a: PlacedRound, b: PlacedRound, key: Integers) -> bool:
    """Whether what a pair of features has in place of a fixed normal is iterated by its row."""
    return key[KIND] in (SIDE_CORNER, CORNER_SIDE, CORNER_CORNER) or has_direction(p, a, b, key)


def has_direction(p: RoundBodies, a: PlacedRound, b: PlacedRound, key: Integers) -> bool:
    """Whether the direction from the center of a rim is iterated in place of a normal."""
    return is_at_rim(p, a, b, key) or is_rim_contact(a, b, key)


def encoded(key: Integers) -> int:
    """A pair of features as one number."""
    return 1 + ((key[KIND] * COUNT + key[FIRST]) * COUNT + key[SECOND]) * 2 + (1 if key[SIGN] > 0 else 0)


def decode(number: int, key: Integers) -> None:
    """The pair of features with this number."""
    rest = number - 1
    key[KIND] = rest // (2 * COUNT * COUNT)
    key[FIRST], key[SECOND] = rest // (2 * COUNT) % COUNT, rest // 2 % COUNT
    key[SIGN] = 2 * (rest % 2) - 1 if key[KIND] == SIDE_SIDE or is_crossing(key[KIND]) else 0


def write_slot(
    p: RoundBodies, a: PlacedRound, b: PlacedRound, key: Integers, meeting: Array, limit: float, slot: Array
) -> None:  # fmt: skip
    """The numbers of a slot: see `mbd_sim.dynamics.contact.smooth_rows`.

    :param limit: features with lower gaps are within each other by more than round-off.
    """
    kind, own, mode = key[KIND], zeros(3), ITERATED
    if is_crossing(kind) and has_direction(p, a, b, key):  # its row is that of any side and corner
        kind = SIDE_CORNER if kind in (SIDE_CORNER, EDGE_RIM) else CORNER_SIDE
    for k in range(SMOOTH_SIZE):
        slot[k] = 0.0
    write_bend(p, a, b, key, kind, slot)
    if is_crossing(kind) and meeting[GAP] < limit and lies_flat(a, b, key):
        write_beneath(a, b, key, meeting, slot)
        return
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
    least_axis(own, slot[25:])
    turn_back(b.pose, meeting[TOWARD:], slot[22:])
    if mode == TWO_SIDES:
        place_back(b.pose, meeting[POINT:], slot[22:])
    if mode == FIXED_FIRST:
        turn_back(a.pose, meeting[TOWARD:], slot[22:])
    if is_crossing(kind):
        slot[30] = 1.0
        write_chord(a, b, key, slot)
    if kind == EDGE_RIM:
        copy(b.hull.normals[3 * key[SECOND] :], slot[22:])
    if kind == RIM_EDGE:
        copy(a.hull.normals[3 * key[FIRST] :], slot[22:])
    if is_rim_on_face(a, b, key):
        write_arm(a, b, key, meeting[POINT:], slot)
    if can_bend(slot):
        write_lean(a, b, slot)
        write_height(a, b, key, meeting, limit, slot)
    slot[SMOOTH_SIZE - 1] = encoded(key)


def write_beneath(a: PlacedRound, b: PlacedRound, key: Integers, meeting: Array, slot: Array) -> None:
    """The numbers of a slot whose edge was found within an end: of the edge and of a line across it in this end."""
    edge, end, own, side, face = a, b, 0, key[FIRST], key[SECOND]
    center, line, at = zeros(3), zeros(3), zeros(3)
    if key[KIND] == RIM_EDGE:
        edge, end, own, side, face = b, a, 1, key[SECOND], key[FIRST]
    axis, direction = end.normals[3 * face :], edge.directions[3 * side :]
    place_back(edge.pose, meeting[POINT:], at)
    subtract(at, edge.hull.at, slot[3 * own :])
    copy(edge.hull.directions[3 * side :], slot[6 + 3 * own :])
    middle(end, face, center)
    subtract(meeting[POINT:], center, line)
    depth = dot(line, axis)
    add(meeting[POINT:], -depth, axis, line)
    place_back(end.pose, line, at)
    subtract(at, end.hull.at, slot[3 - 3 * own :])
    cross(direction, axis, line)
    cosine = size_of(line)
    scale(key[SIGN] / cosine, line, line)
    turn_back(end.pose, line, slot[22:])
    cross(line, direction, at)
    turn_back(b.pose, at, line)
    least_axis(line, slot[25:])
    slot[16 + TWO_SIDES], slot[20] = 1.0, key[SIGN]
    write_chord(a, b, key, slot)
    write_lean(a, b, slot)
    slot[FOUND_AT] = depth * cosine - bend_below(end, face, edge, meeting[POINT:])
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
    elif is_face:
        copy(hull.centers[3 * feature :], at)
        if is_crossing(kind):
            slot[12 + own] = hull.face_radii[feature]
    else:
        copy(hull.corners[3 * corner :], at)
        slot[12 + own] = hull.marks[corner]
    subtract(at, hull.at, slot[3 * own :])


def room_along(a: PlacedRound, b: PlacedRound, key: Integers, point: Array, numbers: Array) -> float:
    """As `polytopes.room_along`, of two sides; their slot has their last crossing in place of a normal."""
    across, place, i, j = zeros(3), zeros(3), 2 * key[FIRST], 2 * key[SECOND]
    cross(a.directions[3 * key[FIRST] :], b.directions[3 * key[SECOND] :], across)
    if size_of(across) > SLANTED:
        return math.inf
    place_back(b.pose, point, place)
    one = distance_of(a.corners[3 * a.hull.ends[i] :], a.corners[3 * a.hull.ends[i + 1] :])
    other = distance_of(b.corners[3 * b.hull.ends[j] :], b.corners[3 * b.hull.ends[j + 1] :])
    return PASSED * min(one, other) - distance_of(place, numbers[22:])


def write_bend(p: RoundBodies, a: PlacedRound, b: PlacedRound, key: Integers, kind: int, slot: Array) -> None:
    """The radius of an end that lies nearly flat on a face, and the normal of this face: see `bend` in `bodies`."""
    i, j = key[FIRST], key[SECOND]
    if kind == POINT_FACE and i % CODES < POINTS:
        write_flat(0, a.hull.rims[i // CODES], b.hull, j, slot)
    elif kind == FACE_POINT and j % CODES < POINTS:
        write_flat(1, b.hull.rims[j // CODES], a.hull, i, slot)
    elif p.radius > 0.0:
        return
    elif kind in (CORNER_FACE, POINT_FACE, EDGE_RIM):
        write_flat(1, b.hull.face_radii[j], a.hull, facing(b, j, a), slot)
    elif kind in (FACE_CORNER, FACE_POINT, RIM_EDGE):
        write_flat(0, a.hull.face_radii[i], b.hull, facing(a, i, b), slot)


def write_flat(own: int, radius: float, other: RoundHull, face: int, slot: Array) -> None:
    """Write the radius of an end and the normal of a face of the other body, if there is one."""
    if face >= 0:
        slot[28 + own] = radius
        copy(other.normals[3 * face :], slot[6 + 3 * own :])


def can_bend(numbers: Array) -> bool:
    """Whether one of the bodies of a slot has an end that can be bent."""
    return numbers[28] + numbers[29] > 0.0


def write_height(a: PlacedRound, b: PlacedRound, key: Integers, meeting: Array, limit: float, slot: Array) -> None:
    """Write the height at which a feature is found beneath an end that can be bent, if it is lower than a limit."""
    if meeting[GAP] < limit:
        slot[FOUND_AT] = height_of(a, b, key, meeting)


def is_beneath(p: RoundBodies, a: PlacedRound, b: PlacedRound, key: Integers, numbers: Array) -> bool:
    """Whether the row of a crossing is that of a point of the edge, which was found within the end."""
    return is_crossing(key[KIND]) and numbers[30] == 0.0 and not has_direction(p, a, b, key)


def room_beside(a: PlacedRound, b: PlacedRound, key: Integers, point: Array, numbers: Array) -> float:
    """How far in m a crossing may still run along the edge from the point that was found there."""
    own, at = zeros(3), zeros(3)
    if key[KIND] == EDGE_RIM:
        add(numbers, 1.0, a.hull.at, own)
    else:
        add(numbers[3:], 1.0, b.hull.at, own)
    point_on_edge(a, b, key, own, at)
    return CHANGED * numbers[chord_at(key)] - distance_of(point, at)


def write_lean(a: PlacedRound, b: PlacedRound, slot: Array) -> None:
    """Write the present normal of the face on which an end lies, in the axes of the body with this end."""
    lean(a, b, slot, slot[31:])


def lean(a: PlacedRound, b: PlacedRound, numbers: Array, out: Array) -> None:
    """The normal of the face on which an end lies, in the axes of the body with this end."""
    normal = zeros(3)
    if numbers[28] > 0.0:
        turn(b.pose, numbers[6:], normal)
        turn_back(a.pose, normal, out)
    else:
        turn(a.pose, numbers[9:], normal)
        turn_back(b.pose, normal, out)


def lean_left(a: PlacedRound, b: PlacedRound, numbers: Array) -> float:
    """The sine by which an end that can be bent may still turn: up to where it begins or ceases to be, or little."""
    now, aside, known, axis = zeros(3), zeros(3), numbers[31:], a.hull.normals
    if not numbers[28] > 0.0:
        axis = b.hull.normals
    lean(a, b, numbers, now)
    add(known, -dot(axis, known), axis, aside)
    was_flat = size_of(aside) < FLAT_TILT
    add(now, -dot(axis, now), axis, aside)
    left = size_of(aside) - FLAT_TILT
    return min(-left, LEANED - distance_of(now, known)) if was_flat else left


def chord_at(key: Integers) -> int:
    """Where the number of a slot is that is half of the last chord of a crossing: the cosine of the end, not used."""
    return 15 if key[KIND] == EDGE_RIM else 14


def write_chord(a: PlacedRound, b: PlacedRound, key: Integers, slot: Array) -> None:
    """Write half of the present chord of a sharp edge."""
    slot[chord_at(key)] = half_of_chord(a, b, key)


def is_rim_on_face(a: PlacedRound, b: PlacedRound, key: Integers) -> bool:
    """Whether a rim touches a face in its lowest point."""
    if key[KIND] == CORNER_FACE:
        return a.hull.faces > 0 and a.hull.curved[key[FIRST]] != 0
    return key[KIND] == FACE_CORNER and b.hull.faces > 0 and b.hull.curved[key[SECOND]] != 0


def arm_of(a: PlacedRound, b: PlacedRound, key: Integers, point: Array, out: Array) -> None:
    """The direction from the center of a rim to the point that touches a face."""
    if key[KIND] == CORNER_FACE:
        subtract(point, a.corners[3 * key[FIRST] :], out)
    else:
        subtract(point, b.corners[3 * key[SECOND] :], out)
    divide(out, max(size_of(out), LEAST))


def arm_at(key: Integers) -> int:
    """Where the numbers of a slot are that have this direction: that of a side of the body with the rim, not used."""
    return 6 if key[KIND] == CORNER_FACE else 9


def write_arm(a: PlacedRound, b: PlacedRound, key: Integers, point: Array, slot: Array) -> None:
    """Write the present direction to a point of a rim, in the axes of the body with the face."""
    arm = zeros(3)
    arm_of(a, b, key, point, arm)
    if key[KIND] == CORNER_FACE:
        turn_back(b.pose, arm, slot[arm_at(key) :])
    else:
        turn_back(a.pose, arm, slot[arm_at(key) :])


def stored_arm(a: PlacedRound, b: PlacedRound, key: Integers, numbers: Array, out: Array) -> None:
    """The direction to a point of a rim among the numbers of a slot."""
    if key[KIND] == CORNER_FACE:
        turn(b.pose, numbers[arm_at(key) :], out)
    else:
        turn(a.pose, numbers[arm_at(key) :], out)
