"""The distance of two bodies where a rim lies nearly flat on a face: points of the rim, which protrude, carry it."""

from __future__ import annotations

import math

from mbd_sim.compiler.ir.python_kinds import Array, integers, zeros
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
from mbd_sim.simulation.contact.compiled.features.round.crossings import GAP, MARGIN, MEETING, crossing
from mbd_sim.simulation.contact.compiled.features.round.meetings import meet
from mbd_sim.simulation.contact.compiled.features.round.normals import (
    CORNER_FACE,
    FACE_CORNER,
    FACE_POINT,
    FIRST,
    KEY,
    KIND,
    POINT_FACE,
    SECOND,
    SIGN,
    RoundBodies,
    support,
)
from mbd_sim.simulation.contact.compiled.features.vectors import dot, scale, subtract

BENT = 4e-3  # of the radius of an end: more than it is bent, and than it lies in a face by, where it lies nearly flat
THIN = 1e-12  # of a body's reach: the thickness of a disc or a plate, which have none


def with_flat_rims(p: RoundBodies, a: PlacedRound, b: PlacedRound, apart: float) -> float:
    """The distance where rims that lie nearly flat on a face protrude, from that of the bodies without this.

    Below `EXACT_TILT` the gaps of the points that carry them take its place: a rim is lower between its points.
    """
    found = zeros(2)  # the least gap, and whether a rim lies flat
    found[0] = math.inf
    if a.hull.faces and a.hull.is_curved and b.hull.faces:
        flat_rims(p, a, b, POINT_FACE, apart, found)
    if b.hull.faces and b.hull.is_curved and a.hull.faces:
        flat_rims(p, a, b, FACE_POINT, apart, found)
    return found[0] if found[1] > 0.0 else min(apart, found[0])


def flat_rims(p: RoundBodies, a: PlacedRound, b: PlacedRound, kind: int, apart: float, found: Array) -> None:
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
        points_of_rims(p, a, b, kind, face, least, own)
        beneath(p, a, b, kind, other.normals[3 * face :], least, own)
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


def note(gap: float, least: float, found: Array) -> None:
    """Note a gap, unless bodies that are as far apart as they are must meet elsewhere, as at a side of a block."""
    if gap >= least:
        found[0] = min(found[0], gap)


def points_of_rims(
    p: RoundBodies, a: PlacedRound, b: PlacedRound, kind: int, face: int, least: float, found: Array
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
            note(meeting[GAP], least, found)
            if meeting[GAP] >= least and tilt(body, code // CODES, normal) < EXACT_TILT:
                found[1] = 1.0


def beneath(
    p: RoundBodies, a: PlacedRound, b: PlacedRound, kind: int, normal: Array, least: float, found: Array
) -> None:
    """Note the gaps of corners and edges of the other body that are beneath the end of a body that lies nearly flat.

    The end lies flat also if it touches nothing else.
    """
    sign, body, other, face, sine = 1.0, a, b, 0, 0.0
    key, outward, at, meeting = integers(KEY), zeros(3), zeros(3), zeros(MEETING)
    if kind == FACE_POINT:
        sign, body, other = -1.0, b, a
    for k in range(body.hull.faces):
        if dot(body.normals[3 * k :], normal) < dot(body.normals[3 * face :], normal):
            face = k
    scale(-sign, body.normals[3 * face :], outward)
    sine = tilt(body, corner_of(body.hull, face), normal)
    if sine > FLAT_TILT or (found[1] == 0.0 and (p.radius > 0.0 or other.hull.is_curved)):
        return
    for code in range(codes(other.hull)):
        if code % CODES >= POINTS and lies(other, body, face, code, 1.0, at):
            key[KIND], key[FIRST], key[SECOND] = FACE_POINT, face, code
            if kind == FACE_POINT:
                key[KIND], key[FIRST], key[SECOND] = POINT_FACE, code, face
            meet(p, a, b, key, outward, at, meeting)
            note(meeting[GAP], least, found)
    # Over edges a part of the end may hang.
    for side in range(0 if other.hull.is_curved or p.radius > 0.0 else other.hull.sides):
        for number in range(2):
            if crossing(other, side, body, face, 2 * number - 1, sign, meeting) and meeting[MARGIN] >= 0.0:
                note(meeting[GAP], least, found)
    for corner in range(other.hull.count):
        if not other.hull.curved[corner]:
            key[KIND], key[FIRST], key[SECOND] = FACE_CORNER, face, corner
            if kind == FACE_POINT:
                key[KIND], key[FIRST], key[SECOND] = CORNER_FACE, corner, face
            meet(p, a, b, key, outward, at, meeting)
            if meeting[MARGIN] >= 0.0:
                note(meeting[GAP], least, found)
    if sine < EXACT_TILT and found[0] < math.inf:
        found[1] = 1.0
