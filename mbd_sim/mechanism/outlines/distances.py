"""The distances of pairs of pieces of two outlines in one plane, in closed form.

A pair of pieces touches, or would touch if it were nearer, where the outward normals are opposite. With n the normal
of the second piece, D the line from its center to that of the first one, and p the distances of the tangents from the
centers, the gap is g = n·D - p_A - p_B. A straight piece gives n. For two round pieces g is stationary in the angle of
n, where dn/dα·D is the sum of the growths c of both, so that n·D = ±√(D² - c²), negative in hollows.

Everything is in the axes of the second outline, for many pairs at once.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.geometry.pose import Array
from mbd_sim.mechanism.outlines.pieces import Outline, Piece, Round, Straight

TINY = 1e-60  # m², square of a length that counts as zero
DENT = 1e-6  # rad, turn to the right up to which a joint is smooth
FULL = 2.0 * math.pi - 1e-9  # rad, turn from which on a round piece is a whole circle

Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class PlaneMotion:
    """The place of one plane in another: turned by the angle with this `cosine` and `sine`, then moved by x and y."""

    cosine: float
    sine: float
    x: float
    y: float

    def directions(self, vectors: Array) -> Array:
        """Directions (n, 2), turned."""
        x, y = vectors[:, 0], vectors[:, 1]
        return np.stack([self.cosine * x - self.sine * y, self.sine * x + self.cosine * y], axis=1)

    def points(self, points: Array) -> Array:
        """Points (n, 2), turned and moved."""
        return np.asarray(self.directions(points) + np.array([self.x, self.y]))

    def back(self, x: float, y: float) -> tuple[float, float]:
        """The point in the moved plane that is at a point of the other one."""
        dx, dy = x - self.x, y - self.y
        return self.cosine * dx + self.sine * dy, self.cosine * dy - self.sine * dx


STILL = PlaneMotion(1.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class PieceTable:
    """The pieces of an outline as columns.

    `centers` (n, 2) are those of round pieces, and the middles of straight ones, of which `halves` (n,) are the half
    lengths; a round one has 0 there. `starts` (n, 2) are the normals at the first ends, `lows` and `highs` (n, 2) those
    at the ends of the turn, counterclockwise, and `bisectors` (n, 2) those halfway; `wide` is whether a piece turns by
    more than half a turn, `full` by a whole one. `middles` (n, 2) and `spreads` (n,) are circles around the pieces,
    `dents` (m, 2) the points at which the outline turns to the right. `thin` is whether it runs there and back, with
    nothing inside.
    """

    straight: Mask
    centers: Array
    halves: Array
    starts: Array
    lows: Array
    highs: Array
    bisectors: Array
    wide: Mask
    full: Mask
    radii: Array
    growths: Array
    middles: Array
    spreads: Array
    dents: Array
    size: float
    thin: bool = False

    def __len__(self) -> int:
        return len(self.radii)

    @cached_property
    def hollow(self) -> Mask:
        """Which pieces are concave."""
        return np.asarray(self.radii < 0.0)

    @cached_property
    def corners(self) -> Mask:
        """Which pieces are points."""
        return np.asarray(~self.straight & (self.radii == 0.0) & (self.growths == 0.0))

    @cached_property
    def shortest(self) -> float:
        """The length in m of the shortest straight piece, or without any the size."""
        return min(self.size, 2.0 * float(np.min(self.halves[self.straight], initial=np.inf)))

    @cached_property
    def along(self) -> Array:
        """The directions (n, 2) of straight pieces."""
        return np.stack([-self.starts[:, 1], self.starts[:, 0]], axis=1)


def table_of(outline: Outline) -> PieceTable:
    """The table of an outline."""
    pieces = outline.pieces
    rounds = [piece if isinstance(piece, Round) else None for piece in pieces]
    turns = np.array([piece.last - piece.first for piece in pieces])
    lows, highs = ([edge(piece.first, piece.last) for piece in pieces] for edge in (min, max))
    around = [_circle_around(piece) for piece in pieces]
    return PieceTable(
        straight=np.array([one is None for one in rounds]),
        centers=np.array([_center(piece) for piece in pieces]),
        halves=np.array([0.5 * piece.length if isinstance(piece, Straight) else 0.0 for piece in pieces]),
        starts=np.array([piece.normal if isinstance(piece, Straight) else _unit(piece.first) for piece in pieces]),
        lows=np.array([_unit(angle) for angle in lows]),
        highs=np.array([_unit(angle) for angle in highs]),
        bisectors=np.array([_unit(0.5 * (piece.first + piece.last)) for piece in pieces]),
        wide=np.abs(turns) > math.pi,
        full=np.abs(turns) >= FULL,
        radii=np.array([0.0 if one is None else one.radius for one in rounds]),
        growths=np.array([0.0 if one is None else one.growth for one in rounds]),
        middles=np.array([middle for middle, _ in around]),
        spreads=np.array([spread for _, spread in around]),
        dents=_dents_of(outline),
        size=(outline.size if len(pieces) > 1 else 2.0 * around[0][1]) or math.inf,  # a point has none
        thin=outline.closed
        and len(pieces) == 4
        and all(one is None or one.is_corner for one in rounds)
        and rounds.count(None) == 2,
    )


def _unit(angle: float) -> tuple[float, float]:
    return math.cos(angle), math.sin(angle)


def _center(piece: Piece) -> tuple[float, float]:
    if isinstance(piece, Round):
        return piece.center
    return 0.5 * (piece.start[0] + piece.end[0]), 0.5 * (piece.start[1] + piece.end[1])


def _circle_around(piece: Piece) -> tuple[tuple[float, float], float]:
    if isinstance(piece, Straight):
        return _center(piece), 0.5 * piece.length
    if abs(piece.last - piece.first) > math.pi and not piece.growth:
        return piece.center, abs(piece.radius)
    points = piece.points(np.linspace(0.0, 1.0, 17))
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    farthest = float(np.max(np.hypot(*(points - middle).T)))
    return (float(middle[0]), float(middle[1])), farthest + piece.length * abs(piece.last - piece.first) / 64.0


@dataclass(frozen=True, eq=False)
class Distances:
    """The distances of k pairs of pieces, in the axes of the second outline.

    `gaps` (k,) in m are negative where the pieces penetrate each other. `margins` (k,) in m say how far the pair is
    from where neighbors take its place, negative where these have, or where the pair cannot touch. Both ends of a
    straight piece that lies on another one with the same gap, but for a small part of it, have small margins.
    `normals` (k, 2) are those of the second pieces, `points` and `others` (k, 2) where the two would touch.
    """

    gaps: Array
    margins: Array
    normals: Array
    points: Array
    others: Array


def distances(one: PieceTable, other: PieceTable, place: PlaneMotion, firsts: Indices, seconds: Indices) -> Distances:
    """The distances of pairs of pieces, by their indices; the first outline is at a place in the plane of the other."""
    flat, other_flat = one.straight[firsts], other.straight[seconds]
    starts = place.directions(one.starts[firsts])
    centers, other_centers = place.points(one.centers[firsts]), other.centers[seconds]
    growths, other_growths = one.growths[firsts], other.growths[seconds]
    lines, growing = centers - other_centers, growths + other_growths
    hollow = one.hollow[firsts] | other.hollow[seconds]
    squares = _dots(lines, lines)
    rest = squares - growing * growing
    reach = np.where(hollow, -1.0, 1.0) * np.sqrt(np.maximum(rest, 0.0))
    normals = (reach[:, None] * lines - growing[:, None] * _turned(lines)) / (squares + TINY)[:, None]
    normals = np.where(flat[:, None], -starts, np.where(other_flat[:, None], other.starts[seconds], normals))
    radii = one.radii[firsts] + growths * _angles(starts, -normals, growths)
    other_radii = other.radii[seconds] + other_growths * _angles(other.starts[seconds], normals, other_growths)
    gaps = _dots(normals, lines) - radii - other_radii
    turned = _turned(normals)
    points = centers - radii[:, None] * normals - growths[:, None] * turned
    others = other_centers + other_radii[:, None] * normals + other_growths[:, None] * turned
    scale = 0.25 * min(one.shortest, other.shortest)
    margins = np.minimum(
        np.where(flat, np.inf, np.maximum(np.abs(radii), scale) * _room(one, firsts, -normals, place)),
        np.where(other_flat, np.inf, np.maximum(np.abs(other_radii), scale) * _room(other, seconds, normals, STILL)),
    )
    beside = np.abs(_dots(_turned(starts), others - centers))
    other_beside = np.abs(_dots(other.along[seconds], points - other_centers))
    margins = np.where(flat, np.minimum(margins, one.halves[firsts] - beside), margins)
    margins = np.where(other_flat, np.minimum(margins, other.halves[seconds] - other_beside), margins)
    fits = np.where(hollow, radii + other_radii < 0.0, rest >= 0.0) & ~(one.hollow[firsts] & other.hollow[seconds])
    possible = np.where(flat | other_flat, ~(flat & other_flat) & ~hollow, fits)
    points = np.where(flat[:, None], others + gaps[:, None] * normals, points)
    others = np.where(other_flat[:, None], points - gaps[:, None] * normals, others)
    return Distances(gaps, np.where(possible, margins, -np.inf), normals, points, others)


def lower_bounds(one: PieceTable, other: PieceTable, place: PlaneMotion, firsts: Indices, seconds: Indices) -> Array:
    """Distances (n, m) in m that pairs of pieces do not fall below, from the circles around them.

    They are less than 0 where these overlap.
    """
    middles, along = place.points(one.middles[firsts])[:, None], place.directions(one.along[firsts])[:, None]
    other_middles, other_along = other.middles[seconds], other.along[seconds]
    halves, other_halves = one.halves[firsts][:, None], other.halves[seconds]
    spreads, other_spreads = one.spreads[firsts][:, None], other.spreads[seconds]
    lines = middles - other_middles
    found = np.hypot(lines[..., 0], lines[..., 1]) - spreads - other_spreads
    beside = lines - np.clip(_dots(lines, along), -halves, halves)[..., None] * along
    nearer = np.hypot(beside[..., 0], beside[..., 1]) - other_spreads
    found = np.where(one.straight[firsts][:, None], np.maximum(found, nearer), found)
    beside = lines - np.clip(_dots(lines, other_along), -other_halves, other_halves)[..., None] * other_along
    nearer = np.hypot(beside[..., 0], beside[..., 1]) - spreads
    return np.where(other.straight[seconds], np.maximum(found, nearer), found)


def _dots(one: Array, other: Array) -> Array:
    return np.asarray(one[..., 0] * other[..., 0] + one[..., 1] * other[..., 1])


def _turned(vectors: Array) -> Array:
    """Vectors (k, 2), turned by a right angle counterclockwise."""
    return np.stack([-vectors[:, 1], vectors[:, 0]], axis=1)


def _angles(starts: Array, ends: Array, growths: Array) -> Array:
    """The angles (k,) in rad from one direction to another where a piece grows, and 0 elsewhere."""
    found = np.zeros(len(starts))
    for row in np.flatnonzero(growths).tolist():
        (ax, ay), (bx, by) = starts[row].tolist(), ends[row].tolist()
        found[row] = math.atan2(ax * by - ay * bx, ax * bx + ay * by)
    return found


def _room(table: PieceTable, chosen: Indices, normals: Array, place: PlaneMotion) -> Array:
    """How far normals (k, 2) are within the turns of round pieces: sines of the angles to the nearer ends."""
    middles, wide = place.directions(table.bisectors[chosen]), table.wide[chosen]
    low = _ahead(place.directions(table.lows[chosen]), normals)
    high = _ahead(normals, place.directions(table.highs[chosen]))
    room = np.where(middles[:, 0] * normals[:, 1] < middles[:, 1] * normals[:, 0], low, high)
    forward = _dots(middles, normals) > 0.0
    room = np.where(forward == wide, np.where(wide, 1.0, -1.0) * np.abs(room), room)  # certainly within, or beyond
    return np.where(table.full[chosen], np.inf, room)


def _ahead(one: Array, other: Array) -> Array:
    """The sine of the angle from one direction (k, 2) to another; beyond a right angle it goes on to grow, up to 2."""
    sines, cosines = one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0], _dots(one, other)
    return np.where(cosines >= 0.0, sines, np.copysign(2.0 - np.abs(sines), sines))


POINT = PieceTable(
    straight=np.array([False]),
    centers=np.zeros((1, 2)),
    halves=np.zeros(1),
    starts=np.array([[1.0, 0.0]]),
    lows=np.array([[1.0, 0.0]]),
    highs=np.array([[1.0, 0.0]]),
    bisectors=np.array([[-1.0, 0.0]]),
    wide=np.array([True]),
    full=np.array([True]),
    radii=np.zeros(1),
    growths=np.zeros(1),
    middles=np.zeros((1, 2)),
    spreads=np.zeros(1),
    dents=np.zeros((0, 2)),
    size=np.inf,
)
SURE = 1e-9  # of the size, by which a pair may be beyond the ends of its pieces


def depth(table: PieceTable, x: float, y: float) -> float:
    """How far in m a point is inside an outline; negative outside."""
    everyone = np.arange(len(table))
    found = distances(POINT, table, PlaneMotion(1.0, 0.0, x, y), np.zeros(len(table), dtype=np.intp), everyone)
    gaps = np.where(found.margins >= -SURE * table.size, found.gaps, np.inf)
    dents = np.hypot(table.dents[:, 0] - x, table.dents[:, 1] - y)
    nearest = float(gaps[int(np.argmin(np.abs(gaps)))])
    deepest = float(np.min(dents, initial=np.inf))
    return -nearest if abs(nearest) <= deepest else deepest


def _dents_of(outline: Outline) -> Array:
    """The points (n, 2) at which an outline turns to the right without an arc."""
    pieces: Sequence[Piece] = outline.pieces
    following = (*pieces[1:], pieces[0]) if outline.closed else pieces[1:]
    found = [
        piece.end
        for piece, after in zip(pieces, following, strict=False)
        if math.remainder(after.first - piece.last, 2.0 * math.pi) < -DENT
    ]
    return np.array(found).reshape(-1, 2)
