"""Smooth curves through points as arcs: two from each point to the next, which meet in a common tangent.

The tangent at a point is that of the circle through it and both of its neighbors. The distance of the arcs from a
smooth curve falls with the third power of the distance of its points.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from mbd_sim.mechanism.outlines.pieces import Point

LEVEL = 1e-9  # rad between an arc and its chord, up to which it counts as a line


def curve_tangents(points: Sequence[Point]) -> list[Point]:
    """The unit tangents at the points of a curve; a curve that ends where it begins has one tangent there."""
    count = len(points)
    closed = points[0] == points[-1]
    found = []
    for number in range(count):
        if 0 < number < count - 1:
            found.append(_tangent(points[number - 1], points[number], points[number + 1]))
        elif closed:
            found.append(_tangent(points[-2], points[0], points[1]))
        elif number == 0:
            found.append(_mirrored(points[0], points[1], _tangent(*points[:3])))
        else:
            found.append(_mirrored(points[-2], points[-1], _tangent(*points[-3:])))
    return found


def _tangent(before: Point, at: Point, after: Point) -> Point:
    """The tangent at the second of three points of the circle through them."""
    (ax, ay), (bx, by) = _direction(before, at), _direction(at, after)
    one, other = math.dist(before, at), math.dist(at, after)
    x, y = ax * other + bx * one, ay * other + by * one
    size = math.hypot(x, y)
    return (x / size, y / size) if size > 0.0 else (ax, ay)


def _mirrored(one: Point, other: Point, tangent: Point) -> Point:
    """The tangent at one end of an arc from that at its other end: mirrored at the chord."""
    x, y = _direction(one, other)
    along = 2.0 * (tangent[0] * x + tangent[1] * y)
    return along * x - tangent[0], along * y - tangent[1]


def _direction(one: Point, other: Point) -> Point:
    size = math.dist(one, other)
    return (other[0] - one[0]) / size, (other[1] - one[1]) / size


def biarc_joint(start: Point, first: Point, end: Point, last: Point) -> Point | None:
    """Where two arcs meet that lead from a point to another with unit tangents there; None if one would turn back.

    Both have the same length d from their ends to the crossing of their tangents: |v - d (t₁ + t₂)| = 2 d.
    """
    vx, vy = end[0] - start[0], end[1] - start[1]
    sx, sy = first[0] + last[0], first[1] + last[1]
    along, chord = vx * sx + vy * sy, vx * vx + vy * vy
    spare = 2.0 * (1.0 - (first[0] * last[0] + first[1] * last[1]))
    root = math.sqrt(along * along + spare * chord)
    if not along + root > 0.0:
        return None
    length = chord / (along + root)
    x = 0.5 * (start[0] + end[0] + length * (first[0] - last[0]))
    y = 0.5 * (start[1] + end[1] + length * (first[1] - last[1]))
    turns = [math.remainder(math.atan2(y - at[1], x - at[0]) - math.atan2(t[1], t[0]), 2.0 * math.pi)
             for at, t in ((start, first), (end, (-last[0], -last[1])))]  # fmt: skip
    return (x, y) if max(map(abs, turns)) < 0.5 * math.pi else None


def arc_middle(start: Point, tangent: Point, end: Point) -> Point | None:
    """The middle of the arc from a point to another with a unit tangent at the first; None if it is a line."""
    x, y = end[0] - start[0], end[1] - start[1]
    turn = math.atan2(tangent[0] * y - tangent[1] * x, tangent[0] * x + tangent[1] * y)
    if abs(turn) <= LEVEL:
        return None
    rise = 0.5 * math.tan(0.5 * turn)
    return 0.5 * (start[0] + end[0]) + rise * y, 0.5 * (start[1] + end[1]) - rise * x
