"""The distances of pairs of pieces of two outlines in one plane, in closed form.

A pair of pieces touches, or would touch if it were nearer, where the outward normals are opposite. With n the normal
of the second piece, D the line from its center to that of the first one, and p the distances of the tangents from the
centers, the gap is g = n·D - p_A - p_B. A straight piece gives n. For two round pieces g is stationary in the angle of
n, where dn/dα·D is the sum of the growths c of both, so that n·D = ±√(D² - c²), negative in hollows.

Everything is in the axes of the second outline. The first one is at a `place` in its plane: the cosine and the sine of
a turn, and a shift.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from mbd_sim.compiler.ir.python_kinds import Array, Integers, zeros

TINY = 1e-60  # m², square of a length that counts as zero
SURE = 1e-9  # of the size, by which a pair may be beyond the ends of its pieces
FLAT_PART = 0.25  # of the shortest straight piece, the least radius with which margins are measured
# Of two pieces, in the axes of the second outline: their gap, negative where they penetrate each other; the margin, how
# far in m the pair is from where neighbors take its place, negative where these have; the normal of the second one; and
# the points of both at which they would touch.
GAP, MARGIN, NORMAL, AT, OTHER = 0, 1, 2, 4, 6
MEETING = 8


@dataclass(frozen=True)
class Pieces:
    """The pieces of an outline, see `mbd_sim.mechanism.outlines.table.PieceTable`; there are `count`.

    The circle around all has a `center` (2,) and a `radius`; `sample` (2,) is a point of the outline.
    """

    count: int
    straight: Integers
    centers: Array
    halves: Array
    starts: Array
    along: Array
    lows: Array
    highs: Array
    bisectors: Array
    wide: Integers
    full: Integers
    hollow: Integers
    corners: Integers
    radii: Array
    growths: Array
    middles: Array
    spreads: Array
    dents_count: int
    dents: Array
    size: float
    shortest: float
    thin: bool
    center: Array
    radius: float
    sample: Array


def turned_x(place: Array, v: Array) -> float:
    """The first part of a direction in the plane of the other outline."""
    return place[0] * v[0] - place[1] * v[1]


def turned_y(place: Array, v: Array) -> float:
    """The second part of a direction in the plane of the other outline."""
    return place[1] * v[0] + place[0] * v[1]


def length_of(x: float, y: float) -> float:
    """The length of a vector."""
    return math.sqrt(x * x + y * y)


def angle_between(ax: float, ay: float, bx: float, by: float) -> float:
    """The angle in rad from one direction to another."""
    return math.atan2(ax * by - ay * bx, ax * bx + ay * by)


def ahead(ax: float, ay: float, bx: float, by: float) -> float:
    """The sine of the angle from one direction to another; beyond a right angle it goes on to grow, up to 2."""
    sine = ax * by - ay * bx
    if ax * bx + ay * by >= 0.0:
        return sine
    return 2.0 - abs(sine) if sine >= 0.0 else abs(sine) - 2.0


def room(p: Pieces, i: int, x: float, y: float, place: Array) -> float:
    """How far a normal is within the turn of a round piece: the sine of the angle to the nearer end."""
    middle_x, middle_y = turned_x(place, p.bisectors[2 * i :]), turned_y(place, p.bisectors[2 * i :])
    low, high = p.lows[2 * i :], p.highs[2 * i :]
    if p.full[i]:
        return math.inf
    if middle_x * y < middle_y * x:
        found = ahead(turned_x(place, low), turned_y(place, low), x, y)
    else:
        found = ahead(x, y, turned_x(place, high), turned_y(place, high))
    is_forward = middle_x * x + middle_y * y > 0.0
    if is_forward and p.wide[i]:
        return abs(found)  # certainly within
    if not is_forward and not p.wide[i]:
        return -abs(found)
    return found


def normal_of(one: Pieces, other: Pieces, i: int, j: int, place: Array, lines: Array, out: Array) -> float:
    """The normal of the second of two pieces; the square of the length along it, negative where they cannot touch."""
    growing = one.growths[i] + other.growths[j]
    square = lines[0] * lines[0] + lines[1] * lines[1]
    rest = square - growing * growing
    if one.straight[i]:
        out[0], out[1] = -turned_x(place, one.starts[2 * i :]), -turned_y(place, one.starts[2 * i :])
    elif other.straight[j]:
        out[0], out[1] = other.starts[2 * j], other.starts[2 * j + 1]
    else:
        reach = math.sqrt(max(rest, 0.0))
        if one.hollow[i] or other.hollow[j]:
            reach = -reach
        out[0] = (reach * lines[0] + growing * lines[1]) / (square + TINY)
        out[1] = (reach * lines[1] - growing * lines[0]) / (square + TINY)
    return rest


def meet_pieces(one: Pieces, other: Pieces, place: Array, i: int, j: int, out: Array) -> None:
    """The distance of two pieces, see `MEETING`."""
    center, lines, still, normal = zeros(2), zeros(2), zeros(4), out[NORMAL:]
    point, end = out[AT:], out[OTHER:]
    still[0] = 1.0
    start_x, start_y = turned_x(place, one.starts[2 * i :]), turned_y(place, one.starts[2 * i :])
    center[0] = turned_x(place, one.centers[2 * i :]) + place[2]
    center[1] = turned_y(place, one.centers[2 * i :]) + place[3]
    for k in range(2):
        lines[k] = center[k] - other.centers[2 * j + k]
    rest = normal_of(one, other, i, j, place, lines, normal)
    radius, other_radius, growth, other_growth = one.radii[i], other.radii[j], one.growths[i], other.growths[j]
    if growth != 0.0:
        radius += growth * angle_between(start_x, start_y, -normal[0], -normal[1])
    if other_growth != 0.0:
        angle = angle_between(other.starts[2 * j], other.starts[2 * j + 1], normal[0], normal[1])
        other_radius += other_growth * angle
    out[GAP] = normal[0] * lines[0] + normal[1] * lines[1] - radius - other_radius
    point[0] = center[0] - radius * normal[0] + growth * normal[1]
    point[1] = center[1] - radius * normal[1] - growth * normal[0]
    end[0] = other.centers[2 * j] + other_radius * normal[0] - other_growth * normal[1]
    end[1] = other.centers[2 * j + 1] + other_radius * normal[1] + other_growth * normal[0]
    least = FLAT_PART * min(one.shortest, other.shortest)
    margin = math.inf
    if not one.straight[i]:
        margin = max(abs(radius), least) * room(one, i, -normal[0], -normal[1], place)
    if not other.straight[j]:
        margin = min(margin, max(abs(other_radius), least) * room(other, j, normal[0], normal[1], still))
    beside = abs(start_x * (end[1] - center[1]) - start_y * (end[0] - center[0]))
    x, y = point[0] - other.centers[2 * j], point[1] - other.centers[2 * j + 1]
    other_beside = abs(other.along[2 * j] * x + other.along[2 * j + 1] * y)
    if one.straight[i]:
        margin = min(margin, one.halves[i] - beside)
        for k in range(2):
            point[k] = end[k] + out[GAP] * normal[k]
    if other.straight[j]:
        margin = min(margin, other.halves[j] - other_beside)
        for k in range(2):
            end[k] = point[k] - out[GAP] * normal[k]
    out[MARGIN] = margin if can_touch(one, other, i, j, radius + other_radius, rest) else -math.inf


def can_touch(one: Pieces, other: Pieces, i: int, j: int, radii: float, rest: float) -> bool:
    """Whether two pieces can touch between their ends."""
    is_hollow = one.hollow[i] or other.hollow[j]
    if one.straight[i] or other.straight[j]:
        return not (one.straight[i] and other.straight[j]) and not is_hollow
    if is_hollow:
        return radii < 0.0 and not (one.hollow[i] and other.hollow[j])
    return rest >= 0.0


def lower_bound(one: Pieces, other: Pieces, place: Array, i: int, j: int) -> float:
    """A distance in m that two pieces do not fall below, from the circles around them; negative where they overlap."""
    x = turned_x(place, one.middles[2 * i :]) + place[2] - other.middles[2 * j]
    y = turned_y(place, one.middles[2 * i :]) + place[3] - other.middles[2 * j + 1]
    found = length_of(x, y) - one.spreads[i] - other.spreads[j]
    if one.straight[i]:
        along_x, along_y = turned_x(place, one.along[2 * i :]), turned_y(place, one.along[2 * i :])
        found = max(found, beside_length(x, y, along_x, along_y, one.halves[i]) - other.spreads[j])
    if other.straight[j]:
        along_x, along_y = other.along[2 * j], other.along[2 * j + 1]
        found = max(found, beside_length(x, y, along_x, along_y, other.halves[j]) - one.spreads[i])
    return found


def beside_length(x: float, y: float, along_x: float, along_y: float, half: float) -> float:
    """The distance of a point from a straight piece about the origin."""
    s = min(max(x * along_x + y * along_y, -half), half)
    return length_of(x - s * along_x, y - s * along_y)


def depth_of(point: Pieces, p: Pieces, x: float, y: float) -> float:
    """How far in m a point is inside an outline; negative outside.

    :param point: the outline that is a point.
    """
    place, meeting, nearest, deepest = zeros(4), zeros(MEETING), math.inf, math.inf
    place[0], place[2], place[3] = 1.0, x, y
    for j in range(p.count):
        meet_pieces(point, p, place, 0, j, meeting)
        if meeting[MARGIN] >= -SURE * p.size and abs(meeting[GAP]) < abs(nearest):
            nearest = meeting[GAP]
    for k in range(p.dents_count):
        deepest = min(deepest, length_of(p.dents[2 * k] - x, p.dents[2 * k + 1] - y))
    return -nearest if abs(nearest) <= deepest else deepest
