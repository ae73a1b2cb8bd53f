"""The pieces of an outline: lines, arcs and involutes, in the plane of the outline, in m.

A piece is passed from its start to its end, with the material on its left and its outward normal on its right. All
round pieces, and corners, are described in one way: at the angle α of the outward normal n, the distance of the tangent
from the `center` is p(α) = radius + growth (α - first), and the piece is at center + p n + growth dn/dα. The radius of
curvature is p, negative where the piece is concave, and 0 at a corner. An involute grows by the radius of its base
circle, which its normals touch.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.rounded import arc_tangent, sine_cosine, sines_cosines

Point = tuple[float, float]


@dataclass(frozen=True)
class Straight:
    """A straight line."""

    start: Point
    end: Point

    @cached_property
    def length(self) -> float:
        """In m."""
        return math.dist(self.start, self.end)

    @cached_property
    def along(self) -> Point:
        """Its direction, a unit vector."""
        return (self.end[0] - self.start[0]) / self.length, (self.end[1] - self.start[1]) / self.length

    @cached_property
    def normal(self) -> Point:
        """The unit vector away from the material."""
        return self.along[1], -self.along[0]

    @cached_property
    def first(self) -> float:
        """The angle of the normal in rad."""
        return arc_tangent(self.normal[1], self.normal[0])

    @property
    def last(self) -> float:
        """The angle of the normal in rad, which does not turn."""
        return self.first

    def points(self, shares: Array) -> Array:
        """Points (n, 2) at shares (n,) of the way."""
        return np.outer(1.0 - shares, self.start) + np.outer(shares, self.end)

    def slopes(self, shares: Array) -> Array:
        """Derivatives (n, 2) of the points by the share."""
        return np.tile(np.subtract(self.end, self.start), (len(shares), 1))


@dataclass(frozen=True)
class Round:
    """An arc, an involute, or with neither `radius` nor `growth` a corner: see the module.

    Its normal turns from the angle `first` to `last` in rad, counterclockwise where it is convex.
    """

    center: Point
    radius: float
    first: float
    last: float
    growth: float = 0.0

    @property
    def is_corner(self) -> bool:
        """Whether it is a single point."""
        return self.radius == 0.0 and self.growth == 0.0

    @property
    def is_concave(self) -> bool:
        """Whether it is hollow."""
        return self.radius < 0.0

    @cached_property
    def start(self) -> Point:
        """Where it begins."""
        return self.at(self.first)

    @cached_property
    def end(self) -> Point:
        """Where it ends."""
        return self.at(self.last)

    @cached_property
    def length(self) -> float:
        """Along the curve, in m."""
        turned = self.last - self.first
        return abs(self.radius * turned + 0.5 * self.growth * turned * turned)

    def reach(self, angle: float) -> float:
        """The distance in m of the tangent from the center, which is the radius of curvature."""
        return self.radius + self.growth * (angle - self.first)

    def at(self, angle: float) -> Point:
        """The point with the normal at this angle in rad."""
        (sine, cosine), reach = sine_cosine(angle), self.reach(angle)
        return (
            self.center[0] + reach * cosine - self.growth * sine,
            self.center[1] + reach * sine + self.growth * cosine,
        )

    def points(self, shares: Array) -> Array:
        """Points (n, 2) at shares (n,) of the turn."""
        angles = self.first + (self.last - self.first) * shares
        (sines, cosines), reach = sines_cosines(angles), self.radius + self.growth * (angles - self.first)
        x, y = reach * cosines - self.growth * sines, reach * sines + self.growth * cosines
        return np.column_stack([x, y]) + self.center

    def slopes(self, shares: Array) -> Array:
        """Derivatives (n, 2) of the points by the share."""
        turn = self.last - self.first
        angles = self.first + turn * shares
        reach = self.radius + self.growth * (angles - self.first)
        sines, cosines = sines_cosines(angles)
        return np.column_stack([-sines, cosines]) * (turn * reach)[:, None]


Piece = Straight | Round


@dataclass(frozen=True)
class Outline:
    """A chain of pieces, each of which begins where the one before ends; a `closed` one ends where it begins."""

    pieces: tuple[Piece, ...]
    closed: bool = True

    @cached_property
    def size(self) -> float:
        """The larger side in m of the box around it."""
        return float(np.max(np.ptp(polyline(self), axis=0)))

    @cached_property
    def middle(self) -> Point:
        """The center in m of the box around it."""
        points = polyline(self)
        x, y = (0.5 * (points.min(axis=0) + points.max(axis=0))).tolist()
        return x, y

    def moved(self, x: float, y: float) -> Outline:
        """This outline moved along both axes by lengths in m."""

        def shifted(point: Point) -> Point:
            return point[0] + x, point[1] + y

        pieces = [
            Straight(shifted(piece.start), shifted(piece.end))
            if isinstance(piece, Straight)
            else replace(piece, center=shifted(piece.center))
            for piece in self.pieces
        ]
        return Outline(tuple(pieces), self.closed)


def polyline(outline: Outline, largest_turn: float = 0.05) -> Array:
    """Points (n, 2) along an outline, straight lines between which turn by at most an angle in rad.

    A closed one does not repeat its first point.
    """
    found = []
    for piece in outline.pieces:
        if isinstance(piece, Round) and piece.is_corner:
            continue
        count = math.ceil(abs(piece.last - piece.first) / largest_turn) or 1
        found.append(piece.points(np.arange(count) / count))
    if not outline.closed:
        found.append(np.array([outline.pieces[-1].end]))
    return np.vstack(found)
