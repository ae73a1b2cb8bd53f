"""Sharp edges that cross the rim of a round end and lie on this end, nearly or entirely.

The normal there is that of the edge and of the tangent of the rim; while the edge lies flat, it is that of the end. As
the edge slides and turns, the crossing follows: the ends of the chord carry the edge until the chord vanishes.
"""

from __future__ import annotations

import math

from mbd_sim.compiler.ir.python_kinds import Array, Integers, zeros
from mbd_sim.dynamics.contact.shapes import FLAT_TILT, UNBENT
from mbd_sim.simulation.contact.compiled.features.round.bodies import (
    CROSSED,
    FLAT,
    PlacedRound,
    RoundHull,
    bend_below,
    corner_of,
    facing,
    middle,
    tilt,
)
from mbd_sim.simulation.contact.compiled.features.round.normals import (
    EDGE_RIM,
    FIRST,
    KIND,
    RIM_EDGE,
    SECOND,
    SIGN,
    RoundBodies,
    support,
)
from mbd_sim.simulation.contact.compiled.features.vectors import (
    add,
    cross,
    dot,
    place,
    place_back,
    scale,
    size_of,
    subtract,
)

# Two features that meet, or could: their unit normal, gap, margin, and the point at which they meet; the direction from
# which a row iterates, which is mostly the normal, and how far it may turn from there.
NORMAL, GAP, MARGIN, POINT, TOWARD, FREE = 0, 3, 4, 5, 8, 11
MEETING = 12
HINT = 0.1  # rad by which a normal may turn from its hint
# Sines of the tilt of a normal against the axis of a rim: at most that of a crossing; up to which one is offered; from
# which on the normal of an edge and a rim is iterated instead; and below which it is not any more. Nearer to the axis,
# where the support of the rim has a kink, steps from the last normal may lead past the next one.
CROSSING, STEEP, ITERABLE, LEAST_ITERABLE = 0.5, 0.4, 0.35, UNBENT
CHANGED = 0.25  # of a chord, by which it may change in a step: its ends run along the rim ever faster as it vanishes
ALONG, HALF = 0, 1  # of a chord: from the start of the edge to its middle, and half of its length, along the edge
CHORD_SIZE = 2


def chord(edge: PlacedRound, side: int, end: PlacedRound, face: int, out: Array) -> bool:
    """The chord of an edge across a round end, seen along its axis, if there is one; the edge is prolonged."""
    line, center = zeros(3), zeros(3)
    direction, axis, radius = edge.directions[3 * side :], end.normals[3 * face :], end.hull.face_radii[face]
    if edge.hull.ruled[side] or radius == 0.0:
        return False
    rise = dot(direction, axis)
    if abs(rise) > CROSSING:
        return False
    middle(end, face, center)
    subtract(edge.corners[3 * edge.hull.ends[2 * side] :], center, line)
    above, level = dot(line, axis), 1.0 - rise * rise
    along = dot(line, direction) - above * rise
    square = along * along - level * (dot(line, line) - above * above - radius * radius)
    out[ALONG], out[HALF] = -along / level, math.sqrt(max(square, 0.0)) / level
    return square > 0.0


def is_crossed(edge: PlacedRound, side: int, end: PlacedRound, corner: int) -> bool:
    """Whether both ends of the chord of an edge across the end with this rim can carry it."""
    face, found = face_of(end.hull, corner), zeros(CHORD_SIZE)
    return face >= 0 and chord(edge, side, end, face, found) and found[HALF] > CROSSED * end.hull.rims[corner]


def is_at_middle(edge: PlacedRound, side: int, end: PlacedRound, corner: int) -> bool:
    """Whether the middle of a chord carries an edge that lies flat on the end with this rim, as the chord is short."""
    face, found = face_of(end.hull, corner), zeros(CHORD_SIZE)
    if face < 0 or not chord(edge, side, end, face, found):
        return False
    is_flat = abs(dot(edge.directions[3 * side :], end.normals[3 * face :])) <= FLAT
    return is_flat and found[HALF] <= CROSSED * end.hull.rims[corner]


def face_of(hull: RoundHull, corner: int) -> int:
    """A round face with the rim of this number; -1 if there is none."""
    line = zeros(3)
    for face in range(hull.faces):
        if hull.face_radii[face] > 0.0:
            subtract(hull.centers[3 * face :], hull.corners[3 * corner :], line)
            if size_of(line) == 0.0:
                return face
    return -1


def crossing(edge: PlacedRound, side: int, end: PlacedRound, face: int, sign: int, toward: float, out: Array) -> bool:
    """Where an edge crosses a rim, at one of the ends of the chord; False where there is none.

    :param toward: 1 if the normal points from the end to the edge, and -1 if it points from the edge to the end.
    """
    found, line, center, tangent, normal = zeros(CHORD_SIZE), zeros(3), zeros(3), zeros(3), out[NORMAL:]
    if not chord(edge, side, end, face, found):
        return False
    direction, axis, radius = edge.directions[3 * side :], end.normals[3 * face :], end.hull.face_radii[face]
    first, second = edge.hull.ends[2 * side], edge.hull.ends[2 * side + 1]
    at = found[ALONG] + sign * found[HALF]
    add(edge.corners[3 * first :], at, direction, out[POINT:])
    middle(end, face, center)
    subtract(out[POINT:], center, line)
    height = dot(line, axis)
    cross(axis, line, tangent)
    cross(tangent, direction, normal)
    size = size_of(normal)
    if size == 0.0:
        return False
    scale(-sign / size, normal, normal)
    cosine = dot(normal, axis)
    out[GAP] = (height - bend_at_crossing(end, face, edge, out[POINT:], cosine)) * cosine
    subtract(edge.corners[3 * second :], edge.corners[3 * first :], line)
    out[MARGIN] = min(min(at, size_of(line) - at), found[HALF] - CROSSED * radius)
    out[MARGIN] = min(out[MARGIN], (CROSSING - math.sqrt(max(0.0, 1.0 - cosine * cosine))) * radius)
    scale(toward, normal, normal)
    return True


def bend_at_crossing(end: PlacedRound, face: int, edge: PlacedRound, point: Array, cosine: float) -> float:
    """How far in m an end is bent at a crossing; less where the normal is tilted, as an iterated one knows no bend."""
    rest = max(1.0 - (1.0 - cosine * cosine) / (UNBENT * UNBENT), 0.0)
    return rest * rest * rest * bend_below(end, face, edge, point)


def meet_crossing(a: PlacedRound, b: PlacedRound, key: Integers, out: Array) -> bool:
    """The crossing of a key; without one its margin is negative."""
    if key[KIND] == EDGE_RIM:
        found = crossing(a, key[FIRST], b, key[SECOND], key[SIGN], 1.0, out)
    else:
        found = crossing(b, key[SECOND], a, key[FIRST], key[SIGN], -1.0, out)
    if not found:
        out[GAP], out[MARGIN] = 0.0, -1.0
        scale(1.0 if key[KIND] == EDGE_RIM else -1.0, end_normal(a, b, key), out[NORMAL:])
    return found


def is_crossing(kind: int) -> bool:
    """Whether the features of a kind are an edge and a rim that it crosses."""
    return kind in (EDGE_RIM, RIM_EDGE)


def is_offered(a: PlacedRound, b: PlacedRound, key: Integers, meeting: Array) -> bool:
    """Whether a crossing that meets is where an edge can touch: its chord is long enough, and its normal not steep."""
    return meeting[MARGIN] >= 0.0 and not is_steep(end_normal(a, b, key), meeting)


def lies_flat(a: PlacedRound, b: PlacedRound, key: Integers) -> bool:
    """Whether the end of a crossing lies nearly flat on a face of the body with the edge."""
    edge, end, face = a, b, key[SECOND]
    if key[KIND] == RIM_EDGE:
        edge, end, face = b, a, key[FIRST]
    own = facing(end, face, edge)
    return own >= 0 and tilt(end, corner_of(end.hull, face), edge.normals[3 * own :]) <= FLAT_TILT


def height_of(a: PlacedRound, b: PlacedRound, key: Integers, meeting: Array) -> float:
    """The gap of features that meet, and of a crossing that along the axis of the end."""
    return meeting[GAP] / abs(dot(meeting[NORMAL:], end_normal(a, b, key))) if is_crossing(key[KIND]) else meeting[GAP]


def place_on_edge(a: PlacedRound, b: PlacedRound, key: Integers, point: Array, out: Array) -> None:
    """A point in the frame of the part with the edge of a crossing."""
    place_back(a.pose if key[KIND] == EDGE_RIM else b.pose, point, out)


def point_on_edge(a: PlacedRound, b: PlacedRound, key: Integers, own: Array, out: Array) -> None:
    """Where a point is that is fixed in the part with the edge of a crossing."""
    place(a.pose if key[KIND] == EDGE_RIM else b.pose, own, out)


def height_above(a: PlacedRound, b: PlacedRound, key: Integers, point: Array) -> float:
    """How far in m a point of the edge of a crossing is above the end, as this is bent; negative within it."""
    edge, end, face, center, line = a, b, key[SECOND], zeros(3), zeros(3)
    if key[KIND] == RIM_EDGE:
        edge, end, face = b, a, key[FIRST]
    middle(end, face, center)
    subtract(point, center, line)
    return dot(line, end.normals[3 * face :]) - bend_below(end, face, edge, point)


def half_of_chord(a: PlacedRound, b: PlacedRound, key: Integers) -> float:
    """Half of the chord of a crossing in m, along the edge; 0 without one."""
    found, has_chord = zeros(CHORD_SIZE), False
    if key[KIND] == EDGE_RIM:
        has_chord = chord(a, key[FIRST], b, key[SECOND], found)
    else:
        has_chord = chord(b, key[SECOND], a, key[FIRST], found)
    return found[HALF] if has_chord else 0.0


def end_normal(a: PlacedRound, b: PlacedRound, key: Integers) -> Array:
    """The normal of the round end of a key."""
    return b.normals[3 * key[SECOND] :] if key[KIND] == EDGE_RIM else a.normals[3 * key[FIRST] :]


def crossings_gap(p: RoundBodies, a: PlacedRound, b: PlacedRound, apart: float) -> float:
    """The largest s(n) of the normals of crossings, if it is larger than the distance `apart` without them."""
    if p.radius == 0.0:
        apart = max(crossings_of(p, a, b, a, b, 1.0, apart), crossings_of(p, a, b, b, a, -1.0, apart))
    return apart


def crossings_of(
    p: RoundBodies, a: PlacedRound, b: PlacedRound, edge: PlacedRound, end: PlacedRound, toward: float, apart: float
) -> float:
    """As `crossings_gap`, of the edges of one body and the ends of the other."""
    meeting = zeros(MEETING)
    if edge.hull.is_curved:
        return apart
    for face in range(end.hull.faces):
        for side in range(edge.hull.sides if end.hull.face_radii[face] > 0.0 else 0):
            for number in range(2):
                if not crossing(edge, side, end, face, 2 * number - 1, toward, meeting):
                    continue
                if meeting[MARGIN] >= -CROSSED * end.hull.face_radii[face]:  # those of short chords count as well
                    apart = max(apart, support(p, a, b, meeting[NORMAL:]))
    return apart


def is_steep(axis: Array, meeting: Array) -> bool:
    """Whether the normal of a crossing is so far from the axis of the end that it is not offered."""
    cosine = dot(meeting[NORMAL:], axis)
    return 1.0 - cosine * cosine > STEEP * STEEP
