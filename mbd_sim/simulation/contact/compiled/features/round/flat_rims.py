"""The distance of two bodies where a rim lies nearly flat on a face: points of the rim, which protrude, carry it."""

from __future__ import annotations

import math
from dataclasses import dataclass

from mbd_sim.compiler.ir.python_kinds import Array, Integers, integers, zeros
from mbd_sim.dynamics.contact.shapes import EXACT_TILT, FLAT_TILT, POINTS
from mbd_sim.simulation.contact.compiled.features.round.bodies import (
    CODES,
    PlacedRound,
    codes,
    corner_of,
    inside,
    lies,
    tilt,
)
from mbd_sim.simulation.contact.compiled.features.round.crossings import (
    GAP,
    MARGIN,
    MEETING,
    POINT,
    height_above,
    is_crossed,
    is_offered,
    meet_crossing,
    place_on_edge,
    point_on_edge,
)
from mbd_sim.simulation.contact.compiled.features.round.meetings import meet
from mbd_sim.simulation.contact.compiled.features.round.normals import (
    CORNER_FACE,
    EDGE_RIM,
    FACE_CORNER,
    FACE_POINT,
    FIRST,
    KEY,
    KIND,
    POINT_FACE,
    RIM_EDGE,
    SECOND,
    SIGN,
    RoundBodies,
    simple_normal,
    support,
)
from mbd_sim.simulation.contact.compiled.features.round.slots import encoded
from mbd_sim.simulation.contact.compiled.features.vectors import dot, scale, subtract

BENT = 4e-3  # of the radius of an end: more than it is bent, and than it lies in a face by, where it lies nearly flat
KNOWN = 1e-7  # of the radius of an end, by which a feature may have been beyond its border before
THIN = 1e-12  # of a body's reach: the thickness of a disc or a plate, which have none


@dataclass(frozen=True)
class Before:
    """Both bodies at an earlier pose; without one `is_known` is False.

    Gaps below a `limit` are not round-off. The keys `held` are those of points of edges beneath an end that bear.
    """

    a: PlacedRound
    b: PlacedRound
    is_known: bool
    limit: float
    held: Array


def with_flat_rims(p: RoundBodies, a: PlacedRound, b: PlacedRound, before: Before, apart: float) -> float:
    """The distance where rims that lie nearly flat on a face protrude, from that of the bodies without this.

    Below `EXACT_TILT` the gaps of the points that carry them take its place: a rim is lower between its points. Gaps
    that were negative `before` count from there.
    """
    found = zeros(2)  # the least gap, and whether a rim lies flat
    found[0] = math.inf
    if a.hull.faces and a.hull.is_curved and b.hull.faces:
        flat_rims(p, a, b, before, POINT_FACE, apart, found)
    if b.hull.faces and b.hull.is_curved and a.hull.faces:
        flat_rims(p, a, b, before, FACE_POINT, apart, found)
    return found[0] if found[1] > 0.0 else min(apart, found[0])


def flat_rims(
    p: RoundBodies, a: PlacedRound, b: PlacedRound, before: Before, kind: int, apart: float, found: Array
) -> None:
    """Note the gaps of points of rims that lie on faces of the other body; of a thin one, those of the better side."""
    sign, body, other, height, best = 1.0, a, b, 0.0, -math.inf
    normal, own, least = zeros(3), zeros(2), 0.0
    if kind == FACE_POINT:
        sign, body, other = -1.0, b, a
    least = min(apart, 0.0) - BENT * body.hull.face_radii[0]
    for face in range(other.hull.faces):
        scale(sign, other.normals[3 * face :], normal)
        height = support(p, a, b, normal)
        if is_thin(other):
            scale(-1.0, normal, normal)
            height = max(height, support(p, a, b, normal))
        if height < apart - FLAT_TILT * body.hull.reach:
            continue
        own[0], own[1] = math.inf, 0.0
        points_of_rims(p, a, b, before, kind, face, least, own)
        beneath(p, a, b, before, kind, other.normals[3 * face :], least, own)
        if own[0] <= apart + FLAT_TILT * body.hull.face_radii[0]:  # not what is far beneath an end that is beside
            found[1] = max(found[1], own[1])
        if not is_thin(other):
            found[0] = min(found[0], own[0])
        elif own[0] < math.inf:
            best = max(best, own[0])
    if best > -math.inf:
        found[0] = min(found[0], best)


def is_thin(body: PlacedRound) -> bool:
    """Whether a body is a disc or a plate: both of its faces are in one plane."""
    hull, line = body.hull, zeros(3)
    if hull.faces != 2:
        return False
    subtract(hull.centers[3:], hull.centers, line)
    return abs(dot(line, hull.normals)) <= THIN * hull.reach


def note(p: RoundBodies, before: Before, key: Integers, gap: float, least: float, found: Array) -> None:
    """Note a gap, unless bodies that are as far apart as they are must meet elsewhere, as at a side of a block."""
    if gap >= least:
        found[0] = min(found[0], gap - gap_before(p, before, key) if gap < 0.0 and before.is_known else gap)


def note_crossing(
    p: RoundBodies, a: PlacedRound, b: PlacedRound, before: Before, key: Integers, meeting: Array, least: float,
    found: Array,
) -> None:  # fmt: skip
    """Note the gap of a crossing; where the edge was within the end before, how far that point of it has moved."""
    earlier, own, at = zeros(MEETING), zeros(3), zeros(3)
    if meeting[GAP] < least or not (before.is_known and meeting[GAP] < 0.0):
        note(p, before, key, meeting[GAP], least, found)
        return
    for k in range(p.slots):
        if before.held[k] == encoded(key):
            return
    was = meet_crossing(before.a, before.b, key, earlier) and is_offered(before.a, before.b, key, earlier)
    if was and earlier[GAP] < before.limit:
        place_on_edge(before.a, before.b, key, earlier[POINT:], own)
        point_on_edge(a, b, key, own, at)
        moved = height_above(a, b, key, at) - height_above(before.a, before.b, key, earlier[POINT:])
        found[0] = min(found[0], moved)
    else:
        found[0] = min(found[0], meeting[GAP])


def gap_before(p: RoundBodies, before: Before, key: Integers) -> float:
    """The gap of a pair of features at the earlier pose if it was negative there; else 0."""
    a, b, normal, at, meeting = before.a, before.b, zeros(3), zeros(3), zeros(MEETING)
    radius = a.hull.reach + b.hull.reach
    simple_normal(a, b, key, normal)
    if key[KIND] == POINT_FACE and not lies(a, b, key[SECOND], key[FIRST], 1.0, at):
        return 0.0
    if key[KIND] == FACE_POINT and not lies(b, a, key[FIRST], key[SECOND], 1.0, at):
        return 0.0
    meet(p, a, b, key, normal, at, meeting)
    return min(meeting[GAP], 0.0) if meeting[MARGIN] >= -KNOWN * radius else 0.0


def points_of_rims(
    p: RoundBodies, a: PlacedRound, b: PlacedRound, before: Before, kind: int, face: int, least: float, found: Array
) -> None:
    """Note the gaps of points of rims that lie on a face of the other body, and whether one of the rims is flat."""
    sign, body, other = 1.0, a, b
    key, normal, at, meeting = integers(KEY), zeros(3), zeros(3), zeros(MEETING)
    if kind == FACE_POINT:
        sign, body, other = -1.0, b, a
    key[KIND], key[SIGN] = kind, 0
    scale(sign, other.normals[3 * face :], normal)
    for code in range(codes(body.hull)):
        if code % CODES < POINTS and lies(body, other, face, code, 1.0, at) and inside(other, face, at) >= 0.0:
            key[FIRST], key[SECOND] = code, face
            if kind == FACE_POINT:
                key[FIRST], key[SECOND] = face, code
            meet(p, a, b, key, normal, at, meeting)
            note(p, before, key, meeting[GAP], least, found)
            if meeting[GAP] >= least and tilt(body, code // CODES, normal) < EXACT_TILT:
                found[1] = 1.0


def beneath(
    p: RoundBodies, a: PlacedRound, b: PlacedRound, before: Before, kind: int, normal: Array, least: float,
    found: Array,
) -> None:  # fmt: skip
    """Note the gaps of corners and edges of the other body that are beneath the end of a body that lies nearly flat.

    The end lies flat also if it touches nothing else.
    """
    sign, body, other, face, sine, is_sharp = 1.0, a, b, 0, 0.0, p.radius == 0.0
    key, outward, at, meeting = integers(KEY), zeros(3), zeros(3), zeros(MEETING)
    if kind == FACE_POINT:
        sign, body, other = -1.0, b, a
    is_sharp = is_sharp and not other.hull.is_curved
    for k in range(body.hull.faces):
        if dot(body.normals[3 * k :], normal) < dot(body.normals[3 * face :], normal):
            face = k
    scale(-sign, body.normals[3 * face :], outward)
    sine = tilt(body, corner_of(body.hull, face), normal)
    if sine > FLAT_TILT or (found[1] == 0.0 and not is_sharp):
        return
    for code in range(codes(other.hull)):
        if code % CODES < POINTS or not lies(other, body, face, code, 1.0, at):
            continue
        if not (is_sharp and is_crossed(other, code // CODES, body, corner_of(body.hull, face))):  # see below
            key[KIND], key[FIRST], key[SECOND] = FACE_POINT, face, code
            if kind == FACE_POINT:
                key[KIND], key[FIRST], key[SECOND] = POINT_FACE, code, face
            meet(p, a, b, key, outward, at, meeting)
            note(p, before, key, meeting[GAP], least, found)
    # Over edges a part of the end may hang.
    for side in range(other.hull.sides if is_sharp else 0):
        key[KIND], key[FIRST], key[SECOND] = RIM_EDGE, face, side
        if kind == FACE_POINT:
            key[KIND], key[FIRST], key[SECOND] = EDGE_RIM, side, face
        for number in range(2):
            key[SIGN] = 2 * number - 1
            if meet_crossing(a, b, key, meeting) and is_offered(a, b, key, meeting):
                note_crossing(p, a, b, before, key, meeting, least, found)
    for corner in range(other.hull.count):
        if not other.hull.curved[corner]:
            key[KIND], key[FIRST], key[SECOND] = FACE_CORNER, face, corner
            if kind == FACE_POINT:
                key[KIND], key[FIRST], key[SECOND] = CORNER_FACE, corner, face
            meet(p, a, b, key, outward, at, meeting)
            if meeting[MARGIN] >= 0.0:
                note(p, before, key, meeting[GAP], least, found)
    if sine < EXACT_TILT and found[0] < math.inf:
        found[1] = 1.0
