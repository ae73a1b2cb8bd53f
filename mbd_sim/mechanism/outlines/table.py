"""The pieces of an outline as columns of numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.rounded import sine_cosine
from mbd_sim.mechanism.outlines.pieces import Outline, Piece, Round, Straight

DENT = 1e-6  # rad, turn to the right up to which a joint is smooth
FULL = 2.0 * math.pi - 1e-9  # rad, turn from which on a round piece is a whole circle

Mask = NDArray[np.bool_]


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
    return sine_cosine(angle)[::-1]


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
