"""Where pieces of outlines meet, and where an outline crosses or touches itself."""

from __future__ import annotations

import math
from itertools import combinations, pairwise

import numpy as np

from mbd_sim.mechanism.outlines.pieces import Outline, Piece, Point, Round, Straight

ROUND_OFF = 1e-9  # of the size, up to which points coincide
CHORD = 0.02  # rad, turn of the chords that stand for an involute


def crossing_points(one: Piece, other: Piece) -> list[Point]:
    """The points in which two lines or arcs meet, or would meet if they were longer; none if they run together."""
    match one, other:
        case Straight(), Straight():
            (ax, ay), (bx, by) = one.along, other.along
            sine = ax * by - ay * bx
            if abs(sine) < ROUND_OFF:
                return []
            dx, dy = other.start[0] - one.start[0], other.start[1] - one.start[1]
            way = (dx * by - dy * bx) / sine
            return [(one.start[0] + way * ax, one.start[1] + way * ay)]
        case Straight(), Round():
            return _on_circle(one.start, one.along, other)
        case Round(), Straight():
            return _on_circle(other.start, other.along, one)
        case Round(), Round():
            dx, dy = other.center[0] - one.center[0], other.center[1] - one.center[1]
            square = dx * dx + dy * dy
            if square < (ROUND_OFF * (abs(one.radius) + abs(other.radius))) ** 2:
                return []
            share = 0.5 + 0.5 * (one.radius**2 - other.radius**2) / square
            foot = (one.center[0] + share * dx, one.center[1] + share * dy)
            size = math.sqrt(square)
            return _on_circle(foot, (-dy / size, dx / size), one)
    raise AssertionError


def _on_circle(start: Point, along: Point, circle: Round) -> list[Point]:
    dx, dy = start[0] - circle.center[0], start[1] - circle.center[1]
    middle = -(dx * along[0] + dy * along[1])
    square = middle * middle + circle.radius**2 - dx * dx - dy * dy
    if square < -ROUND_OFF * circle.radius**2:
        return []
    half = math.sqrt(max(square, 0.0))
    ways = [middle - half, middle + half] if half > ROUND_OFF * abs(circle.radius) else [middle]
    return [(start[0] + way * along[0], start[1] + way * along[1]) for way in ways]


def lies_on(point: Point, piece: Piece, slack: float) -> bool:
    """Whether a point is on a line or an arc, within `slack` in m."""
    if isinstance(piece, Straight):
        dx, dy = point[0] - piece.start[0], point[1] - piece.start[1]
        way = dx * piece.along[0] + dy * piece.along[1]
        beside = dx * piece.normal[0] + dy * piece.normal[1]
        return abs(beside) <= slack and -slack <= way <= piece.length + slack
    dx, dy = point[0] - piece.center[0], point[1] - piece.center[1]
    if abs(math.hypot(dx, dy) - abs(piece.radius)) > slack:
        return False
    sign = -1.0 if piece.is_concave else 1.0
    return turn_into(math.atan2(sign * dy, sign * dx), piece, slack / abs(piece.radius)) is not None


def turn_into(angle: float, piece: Round, slack: float = 0.0) -> float | None:
    """An angle of a normal in rad as one between the first and the last of a piece, within `slack`; None without."""
    low, high = min(piece.first, piece.last), max(piece.first, piece.last)
    middle = 0.5 * (low + high)
    near = middle + math.remainder(angle - middle, 2.0 * math.pi)
    return near if low - slack <= near <= high + slack else None


def self_crossing(outline: Outline) -> tuple[int, int, Point] | None:
    """The indices of two pieces that meet where they should not, and the point; None without any."""
    simple = _simple_pieces(outline)
    slack = ROUND_OFF * outline.size
    boxes = np.array([_box(piece) for _, piece in simple])
    low, high = boxes[:, :2] - slack, boxes[:, 2:] + slack
    near = np.all((low[:, None] <= high[None]) & (low[None] <= high[:, None]), axis=2)
    last = len(simple) - 1
    for one, other in combinations(range(len(simple)), 2):
        if not near[one, other]:
            continue
        (first, piece), (second, second_piece) = simple[one], simple[other]
        shared = [piece.end] if other == one + 1 else []
        if outline.closed and one == 0 and other == last:
            shared.append(piece.start)
        ends = [end for end in (second_piece.start, second_piece.end) if lies_on(end, piece, slack)]
        ends += [end for end in (piece.start, piece.end) if lies_on(end, second_piece, slack)]
        for point in (*crossing_points(piece, second_piece), *ends):
            is_shared = any(math.dist(point, joint) <= 1e3 * slack for joint in shared)
            if not is_shared and lies_on(point, piece, slack) and lies_on(point, second_piece, slack):
                return first, second, point
    return None


def _simple_pieces(outline: Outline) -> list[tuple[int, Piece]]:
    """Lines and arcs in place of all pieces, without corners, each with the index of its piece."""
    found: list[tuple[int, Piece]] = []
    for index, piece in enumerate(outline.pieces):
        if isinstance(piece, Round) and piece.growth:
            count = math.ceil(abs(piece.last - piece.first) / CHORD)
            points = [(float(x), float(y)) for x, y in piece.points(np.linspace(0.0, 1.0, count + 1))]
            found += [(index, Straight(*ends)) for ends in pairwise(points)]
        elif not (isinstance(piece, Round) and piece.is_corner):
            found.append((index, piece))
    return found


def _box(piece: Piece) -> tuple[float, float, float, float]:
    if isinstance(piece, Straight):
        (ax, ay), (bx, by) = piece.start, piece.end
        return min(ax, bx), min(ay, by), max(ax, bx), max(ay, by)
    points = piece.points(np.linspace(0.0, 1.0, 33))
    spare = abs(piece.radius) * (abs(piece.last - piece.first) / 32.0) ** 2
    return (*(points.min(axis=0) - spare).tolist(), *(points.max(axis=0) + spare).tolist())
