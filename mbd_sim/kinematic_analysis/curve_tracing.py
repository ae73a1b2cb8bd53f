"""The motion of a mechanism along a range of its drives, by continuation: predictor along the tangent, then Newton.

The steps follow the curve of configurations by its arc length (Allgower & Georg, ch. 2 and 6), so that the curve can be
followed through dead points, at which the drives reverse. The steps are short enough that the tangent hardly turns,
which keeps to one branch.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from mbd_sim.errors import MbdSimError
from mbd_sim.geometry.pose import Array
from mbd_sim.kinematic_analysis.drive_line import CurvePoint, DriveLine
from mbd_sim.kinematic_analysis.singular_points import SingularPoint, change_point, dead_point, is_singular

FIRST, LONGEST, SHORTEST = 0.02, 0.15, 1e-9  # steps, in rad or sizes of the mechanism
TURN, SMALL_TURN = 0.2, 0.08  # rad, of the tangent in a step that is accepted, and after which the next one is longer
MOST_STEPS = 100_000
FALL = 4.0  # ratio of a margin and its fall in one step, below which it may vanish in the next
SAME = 1e-6  # of s, within which successive change points are one
END = 1e-12  # of s, within which a point is at the end of the range


@dataclass(frozen=True, eq=False)
class TracedCurve:
    """Points of the curve in order, and the singular points on it, each with the number of the point before it."""

    points: Sequence[CurvePoint]
    singular: Sequence[tuple[int, SingularPoint]]

    @property
    def s(self) -> Array:
        """The places (n,) of the points on the line of the drives."""
        return np.array([point.s for point in self.points])


def traced_curve(
    line: DriveLine, first: CurvePoint, *, through: bool, limits: tuple[float, float] = (0.0, 1.0)
) -> TracedCurve:
    """Follow the curve from its first point until the drives leave their range.

    :param through: whether to go on at singular points, at which the curve otherwise ends. Then it also ends where it
        comes back to its first point.
    :param limits: the range of s.
    :raises MbdSimError: the curve cannot be followed.
    """
    points, found = [first], list[tuple[int, SingularPoint]]()
    for point in _steps(line, first, limits, through):
        points.append(point)
        number = len(points) - 2
        singular = _singular(line, points, number, found)
        if singular is None:
            continue
        if (singular.s - points[number].s) * points[number].pace < 0.0 and singular.kind == "change point":
            number -= 1
        found.append((number, singular))
        if not through:
            return TracedCurve(points[: number + 1], found)
    return TracedCurve(points, found)


def _singular(
    line: DriveLine, points: Sequence[CurvePoint], number: int, found: Sequence[tuple[int, SingularPoint]]
) -> SingularPoint | None:
    """The singular point between a point and the next one."""
    before, after = points[number], points[number + 1]
    if before.pace * after.pace < 0.0 or (after.pace == 0.0 and before.pace != 0.0):
        return dead_point(line, before, after)
    crossed = float(before.left @ after.left) * float(before.right @ after.right) < 0.0
    lowest = number > 0 and points[number - 1].margin > before.margin < after.margin
    if lowest:  # a margin that vanishes falls by about its own size in a step
        lowest = before.margin < FALL * (max(points[number - 1].margin, after.margin) - before.margin)
    if not (crossed or lowest):
        return None
    low = points[max(number - 1, 0)] if lowest else before
    singular = change_point(line, low, before if lowest else after, after)
    if singular is None:
        return None
    again = any(abs(singular.s - other.s) < SAME for place, other in found if place >= number - 2)
    return None if again else singular


def _steps(line: DriveLine, first: CurvePoint, limits: tuple[float, float], through: bool) -> Iterator[CurvePoint]:
    point, length, travelled = first, FIRST, 0.0
    for _ in range(MOST_STEPS):
        following = line.beyond(point, length)
        turn = np.inf if following is None else _angle(point.tangent, following.tangent)
        if following is None or turn > TURN:
            length *= 0.5
            if length < SHORTEST:
                raise MbdSimError(
                    f"{line.system.mechanism.name}: the motion cannot be followed beyond {line.described(point.s)}. "
                    "Choose another range."
                )
            continue
        if (end := _end(point, following, limits)) is not None:
            q = line.system.closed_at(following.q, line.drives(end))
            if q is None:  # the range ends beside a dead point
                length *= 0.5
                if length < SHORTEST:
                    return
                continue
            yield line.point(q, end, following.tangent)
            return
        if through and travelled > 3.0 * LONGEST and _returns(line, point, following, first):
            yield first
            return
        yield following
        travelled += length
        point = following
        if turn < SMALL_TURN:
            length = min(1.4 * length, LONGEST)
    raise MbdSimError(f"{line.system.mechanism.name}: the motion does not end after {MOST_STEPS} steps.")


def _end(point: CurvePoint, following: CurvePoint, limits: tuple[float, float]) -> float | None:
    """The end of the range that a step reaches."""
    low, high = limits
    if following.s >= high - END and following.pace >= 0.0 and following.s > point.s:
        return high
    if following.s <= low + END and following.pace <= 0.0 and following.s < point.s:
        return low
    return None


def _returns(line: DriveLine, point: CurvePoint, following: CurvePoint, first: CurvePoint) -> bool:
    """Whether the first point lies between two others on the same piece of the curve."""

    def ahead(other: CurvePoint) -> Array:
        difference = other.q - first.q
        turned = line.system.angles
        difference[turned] = np.mod(difference[turned] + np.pi, 2.0 * np.pi) - np.pi
        return np.append(difference, other.s - first.s)

    one, other = ahead(point), ahead(following)
    chord = other - one
    near = max(np.linalg.norm(one), np.linalg.norm(other)) <= 1.5 * np.linalg.norm(chord) < 1.0
    return bool(near and one @ chord < 0.0 <= other @ chord)


def _angle(one: Array, other: Array) -> float:
    return float(2.0 * np.arcsin(min(1.0, 0.5 * float(np.linalg.norm(one - other)))))


def sampled(line: DriveLine, curve: TracedCurve, places: Array) -> list[tuple[float, Array, SingularPoint | None]]:
    """The configurations where the curve passes the `places` of s, and its singular points: (s, q, singular) in order.

    :raises MbdSimError: a configuration cannot be found.
    """
    singular = dict(curve.singular)
    nodes: list[CurvePoint | SingularPoint] = []
    for number, point in enumerate(curve.points):
        nodes += [point, singular[number]] if number in singular else [point]
    found: list[tuple[float, Array, SingularPoint | None]] = []
    if np.any(places == nodes[0].s):
        found.append((nodes[0].s, nodes[0].q, _at_end(curve.points[0])))
    for start, stop in pairwise(nodes):
        lowest, highest = min(start.s, stop.s), max(start.s, stop.s)
        within = places[(places > lowest) & (places < highest)]
        ordered = within if stop.s > start.s else within[::-1]
        found += [(float(s), _between(line, start, stop, float(s)), None) for s in ordered]
        if isinstance(stop, SingularPoint):
            found.append((stop.s, stop.q, stop))
        elif np.any(places == stop.s):
            found.append((stop.s, stop.q, _at_end(stop)))
    return found


def _at_end(point: CurvePoint) -> SingularPoint | None:
    return SingularPoint(point.q, point.s, "change point") if is_singular(point.margin) else None


def _between(line: DriveLine, start: CurvePoint | SingularPoint, stop: CurvePoint | SingularPoint, s: float) -> Array:
    """The configuration at s, sought from both ends."""
    if s == stop.s:
        return stop.q
    part = (s - start.s) / (stop.s - start.s)
    near, far = (start, stop) if part < 0.5 else (stop, start)
    guesses = [start.q + part * (stop.q - start.q), near.q, far.q]
    for guess in guesses:
        q = line.system.closed_at(line.system.displaced(guess, np.zeros(line.system.layout.nv)), line.drives(s))
        if q is not None and np.max(np.abs(q - near.q)) <= 3.0 * np.max(np.abs(stop.q - start.q)) + 1e-6:
            return q
    raise MbdSimError(f"{line.system.mechanism.name}: no configuration is found at {line.described(s)}.")
