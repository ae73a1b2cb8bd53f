"""Where two outlines in one plane meet: the narrow phase of pairs of chains of lines, arcs and involutes.

Only pieces that face each other can touch. A pair of pieces that penetrate each other counts if the points of both are
inside the other outline, and no pair beside it has less depth: the far side of a thin tip is not a place of contact.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mbd_sim.base.errors import DivergedError
from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.dynamics.contact.feature_rows import KEY
from mbd_sim.dynamics.contact.outline_rows import PieceFeatures
from mbd_sim.mechanism.elements.contacts import PlanarBody
from mbd_sim.mechanism.outlines.distances import (
    SURE,
    Distances,
    Indices,
    PieceTable,
    PlaneMotion,
    depth,
    distances,
    lower_bounds,
    table_of,
)
from mbd_sim.simulation.contact.features.narrow_phase import Bounds
from mbd_sim.simulation.contact.features.polytopes import dots, turned

REACH = 0.05  # of the size of the smaller outline, distance up to which pieces are looked at one by one
DEEP = 0.3  # of that size, depth up to which pieces of outlines that touch nowhere can penetrate each other
BORDER = 0.5  # of the tolerance, by which a point may be beyond the end of its piece
SAME = 8.0  # tolerances, up to which two points are one
PARALLEL = 1e-6  # sine of the angle up to which two normals are one
SURFACE = 1e-12  # of the size, depth up to which a point is on the outline


@dataclass(frozen=True, eq=False)
class _Found:
    """Pairs of pieces that face each other, by the indices of the `firsts` and `seconds`; and their distances."""

    firsts: Indices
    seconds: Indices
    at: Distances


class OutlinePair:
    """See `NarrowPhase`.

    :param names: those of both bodies, for people.
    """

    iterates = False

    def __init__(self, first: PlanarBody, second: PlanarBody, slots: int, names: tuple[str, str]) -> None:
        self._bodies, self._slots, self._names = (first, second), slots, names
        self._tables = table_of(first.outline), table_of(second.outline)
        self._scale = min(table.size for table in self._tables)
        self._latest: tuple[PlaneMotion, tuple[_Found | None, float]] | None = None  # is asked for several times
        self._is_roller = any(len(table) == 1 for table in self._tables)  # which can be inside in a single step
        self._samples = np.array([body.outline.pieces[0].start for body in self._bodies])  # a point of each
        self._circles = _circle(self._tables[0]), _circle(self._tables[1])
        self.bounds = _sphere(first, *self._circles[0]), _sphere(second, *self._circles[1])

    def distance(self, one: Pose, other: Pose) -> float:
        """See `NarrowPhase`."""
        place = self._place(one, other)
        found, beyond = self._near(place)
        distance = min(self._least(found, place), beyond)
        if distance < 0.0 or (distance <= REACH * self._scale and not self._is_roller):
            return distance
        deeper = self._least(self._near_pairs(place, DEEP * self._scale)[0], place)
        return deeper if deeper < 0.0 else -distance if self._is_within(place) else distance

    def _least(self, found: _Found | None, place: PlaneMotion) -> float:
        """The least gap in m of some pairs, negative if any of them penetrate each other; infinite without any."""
        if found is None:
            return math.inf
        valid, gaps = found.at.margins >= -SURE * self._scale, found.at.gaps
        inside = self._penetrating(found, place, np.flatnonzero(valid & (gaps < 0.0)).tolist())
        apart = float(np.min(gaps[valid & (gaps >= 0.0)], initial=np.inf))
        return min((float(gaps[row]) for row in inside), default=apart)

    def touching(self, one: Pose, other: Pose, tolerance: float) -> list[PieceFeatures]:
        """See `NarrowPhase`.

        :raises DivergedError: they touch in more points than they have slots.
        """
        place = self._place(one, other)
        found, _ = self._near(place)
        if found is None:
            return []
        gaps, valid = found.at.gaps, found.at.margins >= -BORDER * tolerance
        inside = self._penetrating(found, place, np.flatnonzero(valid & (gaps < -tolerance)).tolist())
        rows = sorted([*np.flatnonzero(valid & (np.abs(gaps) <= tolerance)).tolist(), *inside])
        sure = [row for row in rows if not self._both_corners(found, row)]
        chosen: list[int] = []
        for row in sure or rows:  # two corners in one point have no normal
            if not any(_is_same(found.at, row, known, tolerance) for known in chosen):
                chosen.append(row)
        if len(chosen) > self._slots:
            raise DivergedError(
                f"'{self._names[0]}' and '{self._names[1]}' touch in {len(chosen)} points at once, of which a pair of "
                f"outlines can have {self._slots}. Divide one of them into several shapes."
            )
        return [self._features(int(found.firsts[row]), int(found.seconds[row])) for row in sorted(chosen)]

    def margin(self, one: Pose, other: Pose, numbers: Array) -> float:
        """See `NarrowPhase`."""
        first, second = divmod(int(numbers[KEY]) - 1, len(self._tables[1]))
        place = self._place(one, other)
        found, _ = self._near(place)
        rows = [] if found is None else np.flatnonzero((found.firsts == first) & (found.seconds == second)).tolist()
        if found is None or not rows:
            return -self._scale
        return max(float(found.at.margins[rows[0]]), -self._scale)

    def renewed(self, one: Pose, other: Pose, numbers: Array) -> Array:
        """See `NarrowPhase`."""
        return numbers

    def _place(self, one: Pose, other: Pose) -> PlaneMotion:
        """The place of the plane of the first body in that of the second one."""
        axes = [turned(pose.rotation, body.axes.T) for pose, body in zip((one, other), self._bodies, strict=True)]
        at, other_at = (
            pose.position + turned(pose.rotation, body.origin)
            for pose, body in zip((one, other), self._bodies, strict=True)
        )
        cosine, sine = float(dots(axes[0][0], axes[1][0])), float(dots(axes[0][0], axes[1][1]))
        return PlaneMotion(cosine, sine, float(dots(axes[1][0], at - other_at)), float(dots(axes[1][1], at - other_at)))

    def _near(self, place: PlaneMotion) -> tuple[_Found | None, float]:
        """The pairs of pieces that may be near each other; and a distance below which no other pair is."""
        if self._latest is not None and self._latest[0] == place:
            return self._latest[1]
        found = self._near_pairs(place, REACH * self._scale)
        self._latest = place, found
        return found

    def _near_pairs(self, place: PlaneMotion, reach: float) -> tuple[_Found | None, float]:
        one, other = self._tables
        (center, radius), (other_center, other_radius) = self._circles
        lines = place.points(one.middles) - other_center, other.middles - place.points(center[None])
        apart = (
            np.hypot(*lines[0].T) - one.spreads - other_radius,
            np.hypot(*lines[1].T) - other.spreads - radius,
        )
        chosen = [np.flatnonzero(each <= reach) for each in apart]
        beyond = min(float(np.min(each[each > reach], initial=np.inf)) for each in apart)
        bounds = lower_bounds(one, other, place, *chosen)
        near = bounds <= reach
        beyond = min(beyond, float(np.min(bounds[~near], initial=np.inf)))
        if not np.any(near):
            return None, beyond
        rows, columns = np.nonzero(near)
        firsts, seconds = chosen[0][rows], chosen[1][columns]
        return _Found(firsts, seconds, distances(one, other, place, firsts, seconds)), beyond

    def _penetrating(self, found: _Found, place: PlaneMotion, rows: list[int]) -> list[int]:
        """Those of some pairs that penetrate each other where they face each other, without deeper ones beside them."""
        at, kept = found.at, list[int]()
        for row in sorted(rows, key=lambda row: -at.gaps[row]):
            if not any(self._is_beside(found, row, known) for known in kept) and self._is_inside(found, row, place):
                kept.append(row)
        return kept

    def _is_inside(self, found: _Found, row: int, place: PlaneMotion) -> bool:
        """Whether the point of each piece is inside the other outline.

        If one is a corner, only its point need be; if one is thin, only that of the thin one.
        """
        one, other = self._tables
        surface = -SURFACE * self._scale
        own = not one.thin and (other.thin or not one.corners[found.firsts[row]])
        if not other.thin and (one.thin or not other.corners[found.seconds[row]]):
            x, y = found.at.points[row].tolist()
            if depth(other, x, y) < surface:
                return False
        x, y = found.at.others[row].tolist()
        return not own or depth(one, *place.back(x, y)) >= surface

    def _is_within(self, place: PlaneMotion) -> bool:
        """Whether one of two outlines that do not cross each other is inside the other one."""
        (x, y), (other_x, other_y) = place.points(self._samples[:1])[0].tolist(), self._samples[1].tolist()
        (center, radius), (other_center, other_radius) = self._circles
        if math.hypot(x - other_center[0], y - other_center[1]) < other_radius and depth(self._tables[1], x, y) > 0.0:
            return True
        x, y = place.back(other_x, other_y)
        return math.hypot(x - center[0], y - center[1]) < radius and depth(self._tables[0], x, y) > 0.0

    def _is_beside(self, found: _Found, row: int, known: int) -> bool:
        """Whether a pair has a piece in common with a known one of less depth, at the same place."""
        if found.firsts[row] != found.firsts[known] and found.seconds[row] != found.seconds[known]:
            return False
        at, reach = found.at, abs(float(found.at.gaps[row])) + abs(float(found.at.gaps[known]))
        apart = [math.dist(points[row], points[known]) for points in (at.points, at.others)]
        return min(apart) <= 2.0 * reach and max(apart) <= 4.0 * reach

    def _both_corners(self, found: _Found, row: int) -> bool:
        return bool(self._tables[0].corners[found.firsts[row]] and self._tables[1].corners[found.seconds[row]])

    def _features(self, first: int, second: int) -> PieceFeatures:
        one, other = self._tables
        return PieceFeatures(
            1 + first * len(other) + second,
            (one.centers[first], other.centers[second]),
            (one.starts[first], other.starts[second]),
            (float(one.radii[first]), float(other.radii[second])),
            (float(one.growths[first]), float(other.growths[second])),
            (bool(one.straight[first]), bool(other.straight[second])),
            bool(one.hollow[first] or other.hollow[second]),
        )


def _is_same(at: Distances, row: int, known: int, tolerance: float) -> bool:
    """Whether two pairs touch in the same point and direction."""
    if math.dist(at.points[row], at.points[known]) > SAME * tolerance:
        return False
    (ax, ay), (bx, by) = at.normals[row].tolist(), at.normals[known].tolist()
    return bool(ax * bx + ay * by > 0.0 and abs(ax * by - ay * bx) <= PARALLEL)


def _circle(table: PieceTable) -> tuple[Array, float]:
    """The center (2,) and the radius in m of a circle around an outline."""
    low = np.min(table.middles - table.spreads[:, None], axis=0)
    high = np.max(table.middles + table.spreads[:, None], axis=0)
    center = 0.5 * (low + high)
    return center, float(np.max(np.hypot(*(table.middles - center).T) + table.spreads))


def _sphere(body: PlanarBody, center: Array, radius: float) -> Bounds:
    """Around an outline, higher than that: both need not be at one place across their plane."""
    x, y = center.tolist()
    return Bounds(body.origin + x * body.axes[:, 0] + y * body.axes[:, 1], math.sqrt(2.0) * radius)
