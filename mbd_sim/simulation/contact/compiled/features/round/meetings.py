"""Where two features of round bodies meet: their gap, and how far they are from where others take their place."""

from __future__ import annotations

import math

from mbd_sim.compiler.ir.python_kinds import Array, Integers, zeros
from mbd_sim.dynamics.contact.shapes import POINTS
from mbd_sim.simulation.contact.compiled.features.round.bodies import (
    CODES,
    CROSSED,
    PlacedRound,
    bend,
    bend_below,
    beside,
    farthest,
    inside,
    lead,
    middle,
    tilt,
    tilted,
)
from mbd_sim.simulation.contact.compiled.features.round.chords import add_chord_margin
from mbd_sim.simulation.contact.compiled.features.round.crossings import (
    FREE,
    GAP,
    HINT,
    MARGIN,
    NORMAL,
    POINT,
    TOWARD,
    meet_crossing,
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
    RoundBodies,
    is_point_at_rim,
)
from mbd_sim.simulation.contact.compiled.features.round.rims import is_rim_contact, meet_rim
from mbd_sim.simulation.contact.compiled.features.round.rounded_edges import is_at_rim, meet_at_rim
from mbd_sim.simulation.contact.compiled.features.vectors import add, copy, divide, dot, scale, size_of, subtract


def meet(p: RoundBodies, a: PlacedRound, b: PlacedRound, key: Integers, normal: Array, at: Array, out: Array) -> None:
    """Two features with a normal: points of sides and of faces are those of the other feature's corner.

    :param at: of `POINT_FACE` and `FACE_POINT`, the point that is fixed in one of the bodies; of a rim and a
        rounded edge, another rim, a round side or an ellipsoid, the direction near which they touch.
    """
    kind, i, j = key[KIND], key[FIRST], key[SECOND]
    copy(normal, out[NORMAL:])
    copy(normal, out[TOWARD:])
    out[FREE] = HINT
    if is_at_rim(p, a, b, key):
        meet_at_rim(p, a, b, key, at, out)
        add_own_margins(a, b, kind, i, j, out)
    elif is_rim_contact(a, b, key):
        meet_rim(a, b, key, at, out)
        if kind in (EDGE_RIM, RIM_EDGE):
            add_chord_margin(a, b, key, out)
        add_own_margins(a, b, kind, i, j, out)
    elif kind in (EDGE_RIM, RIM_EDGE):
        meet_crossing(a, b, key, out)
    elif kind == POINT_FACE:
        meet_fixed(p, a, i, b, j, 1.0, at, out)
    elif kind == FACE_POINT:
        meet_fixed(p, b, j, a, i, -1.0, at, out)
    elif kind == CORNER_FACE:
        meet_face(p, a, i, b, j, 1.0, out)
    elif kind == FACE_CORNER:
        meet_face(p, b, j, a, i, -1.0, out)
    else:
        meet_round(p, a, b, kind, i, j, out)


def meet_fixed(
    p: RoundBodies, body: PlacedRound, code: int, other: PlacedRound, face: int, sign: float, at: Array, out: Array
) -> None:
    """A point that is fixed in a body, on a face of the other; the normal times `sign` is that of the face."""
    base, line, outward = zeros(3), zeros(3), zeros(3)
    middle(other, face, base)
    subtract(at, base, line)
    scale(sign, out[NORMAL:], outward)
    out[GAP] = dot(outward, line) - p.radius
    if code % CODES < POINTS:
        out[GAP] -= bend(body, code // CODES, outward, at)
    elif p.radius == 0.0:
        out[GAP] -= bend_below(other, face, body, at)
    out[MARGIN] = inside(other, face, at)
    copy(at, out[POINT:])
    if code % CODES >= POINTS:  # the middle of a chord, until the ends of this can carry the edge
        radius = other.hull.face_radii[face]
        half = math.sqrt(max(0.0, (2.0 * radius - out[MARGIN]) * out[MARGIN]))
        out[MARGIN] = min(out[MARGIN], 2.0 * CROSSED * radius - half)


def meet_face(
    p: RoundBodies, body: PlacedRound, corner: int, other: PlacedRound, face: int, sign: float, out: Array
) -> None:
    """A corner of a body on a face of the other; the normal times `sign` is that of the face."""
    base, line, normal = zeros(3), zeros(3), out[NORMAL:]
    farthest(body, corner, normal, -sign, out[POINT:])
    middle(other, face, base)
    subtract(out[POINT:], base, line)
    out[GAP] = sign * dot(normal, line) - p.radius
    if p.radius == 0.0 and not body.hull.is_curved:
        out[GAP] -= bend_below(other, face, body, out[POINT:])
    out[MARGIN] = min(inside(other, face, out[POINT:]), tilted(body, corner, normal))


def meet_round(p: RoundBodies, a: PlacedRound, b: PlacedRound, kind: int, i: int, j: int, out: Array) -> None:
    """Two sides, a side and a corner, or two corners."""
    at, other, line, normal = zeros(3), zeros(3), zeros(3), out[NORMAL:]
    first_side, second_side = kind in (SIDE_SIDE, SIDE_CORNER), kind in (SIDE_SIDE, CORNER_SIDE)
    farthest(a, a.hull.ends[2 * i] if first_side else i, normal, -1.0, at)
    farthest(b, b.hull.ends[2 * j] if second_side else j, normal, 1.0, other)
    subtract(at, other, line)
    out[GAP] = dot(normal, line) - p.radius
    copy(at, out[POINT:])
    if kind == SIDE_CORNER:
        copy(other, out[POINT:])
    if kind == SIDE_SIDE:
        crossing(a, i, b, j, normal, at, other, out[POINT:])
    out[MARGIN] = math.inf
    add_own_margins(a, b, kind, i, j, out)
    if p.radius == 0.0 and not first_side and a.hull.curved[i]:
        out[FREE] = HINT * min(1.0, tilt(a, i, normal))
    if p.radius == 0.0 and not second_side and b.hull.curved[j]:
        out[FREE] = min(out[FREE], HINT * min(1.0, tilt(b, j, normal)))
    if kind == CORNER_CORNER and is_point_at_rim(a, i, b, j):
        out[MARGIN] = min(out[MARGIN], beside(b, j, at) if b.hull.curved[j] else beside(a, i, other))


def add_own_margins(a: PlacedRound, b: PlacedRound, kind: int, i: int, j: int, out: Array) -> None:
    """Reduce the margin to those of both features, sides or corners."""
    first = own_margin(a, i, kind in (SIDE_SIDE, SIDE_CORNER, EDGE_RIM), out[NORMAL:], -1.0, out[POINT:])
    second = own_margin(b, j, kind in (SIDE_SIDE, CORNER_SIDE, RIM_EDGE), out[NORMAL:], 1.0, out[POINT:])
    out[MARGIN] = min(out[MARGIN], min(first, second))


def own_margin(body: PlacedRound, feature: int, is_side: bool, normal: Array, sign: float, point: Array) -> float:
    """How far in m a side or a corner of a body is from where others take its place."""
    start, stop = zeros(3), zeros(3)
    if not is_side:
        return lead(body, feature, -1, normal, sign)
    first, second = body.hull.ends[2 * feature], body.hull.ends[2 * feature + 1]
    farthest(body, first, normal, sign, start)
    farthest(body, second, normal, sign, stop)
    subtract(stop, start, stop)
    length = size_of(stop)
    subtract(point, start, start)
    along = dot(start, stop) / length
    return min(min(along, length - along), lead(body, first, second, normal, sign))


def ruling(body: PlacedRound, side: int, normal: Array, sign: float, out: Array) -> None:
    """The direction of the line of a side that reaches farthest along a normal times `sign`."""
    start, stop = zeros(3), zeros(3)
    farthest(body, body.hull.ends[2 * side], normal, sign, start)
    farthest(body, body.hull.ends[2 * side + 1], normal, sign, stop)
    subtract(stop, start, out)
    divide(out, size_of(out))


def crossing(
    a: PlacedRound, i: int, b: PlacedRound, j: int, normal: Array, at: Array, other: Array, out: Array
) -> None:
    """The point of the first of two sides where both cross, seen along their normal."""
    one, two, apart = zeros(3), zeros(3), zeros(3)
    ruling(a, i, normal, -1.0, one)
    ruling(b, j, normal, 1.0, two)
    subtract(at, other, apart)
    cosine = dot(one, two)
    along = (cosine * dot(two, apart) - dot(one, apart)) / (1.0 - cosine * cosine)
    add(at, along, one, out)
