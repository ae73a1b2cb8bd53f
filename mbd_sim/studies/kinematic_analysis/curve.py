"""The curve of configurations along a range of the drives, its dead points and its change points.

It is followed by continuation, with a predictor along the tangent and then Newton's method. The steps go by its arc
length (Allgower & Georg, ch. 2 and 6), so that the curve can be followed through dead points. They are short enough
that the tangent hardly turns, which keeps to one branch.

At dead points and change points the drives do not determine the motion; both are located to round-off. At a dead point
the drives reverse: their velocity along the curve is zero, and the determinant of the equations for the dependent
velocities with it. At a change point the equations of the curve themselves lose rank: two branches of the motion meet,
as in a parallelogram linkage lying flat (Uicker, Pennock & Shigley, ch. 1).

Where a drive cannot go through its whole range, errors say how far it can go.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from mbd_sim.base.errors import InputError, MbdSimError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.interrupts import interruptible
from mbd_sim.base.roots import first_zero
from mbd_sim.base.short_repr import short_repr
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.studies.kinematic_analysis.drive_line import CurvePoint, DriveLine, least_place
from mbd_sim.studies.kinematic_analysis.system import KinematicSystem, UnreachableError, is_rotation

VANISHING = 1e-6  # margin that counts as zero, at a point found to round-off
FARTHEST = 0.5  # rad, or sizes of the mechanism, within which a dead point is sought
NODES = np.array([-1.0, -0.85, -0.6, -0.35, 0.35, 0.6, 0.85, 1.0])  # of the interpolation about a change point
NEIGHBORHOOD = 0.06  # rad, or sizes of the mechanism, of this interpolation
SECTIONS = 16  # of the golden section search for the least margin

Kind = Literal["dead point", "change point"]


@dataclass(frozen=True, eq=False)
class SingularPoint:
    """The configuration q (nq,) of a singular point at the place s on the line of the drives."""

    q: Array
    s: float
    kind: Kind


def is_singular(margin: float) -> bool:
    """Whether a point is a change point."""
    return margin < VANISHING


def dead_point(line: DriveLine, before: CurvePoint, after: CurvePoint) -> SingularPoint:
    """The dead point between two points of the curve, where the pace of the drives changes its sign."""
    if after.pace == 0.0:
        return SingularPoint(after.q, after.s, "dead point")
    sign = 1.0 if before.pace > 0.0 else -1.0

    def pace(distance: float) -> float:
        found = line.beyond(before, distance)
        return float("nan") if found is None else sign * found.pace

    length = 1e-3
    while not (end := pace(length)) < 0.0 and length < FARTHEST:
        length *= 1.5
    distance = first_zero(pace, length, sign * before.pace, end, 1e-12)
    found = line.beyond(before, distance)
    assert found is not None
    return SingularPoint(found.q, found.s, "dead point")


def change_point(line: DriveLine, low: CurvePoint, middle: CurvePoint, high: CurvePoint) -> SingularPoint | None:
    """The change point among three points of the curve in order; None if the margin does not vanish there.

    The first two points may be the same: then the margin changes its sign between them and the third.

    The margin, with the sign changed on one side, is an analytic function of s. Its zero follows from interpolation at
    places on both sides, at which the equations are regular.
    """
    place = _lowest(line, low, middle, high)
    reach = NEIGHBORHOOD / line.length
    values, configurations = [], []
    for s in place + reach * NODES:
        found = _at(line, low, high, float(s))
        if found is None:
            return None
        values.append(found.margin)
        configurations.append(found.q)
    signed = np.array(values) * np.sign(NODES)
    polynomial = np.polyfit(NODES, signed, len(NODES) - 1)
    roots = np.roots(polynomial)
    real = roots[np.abs(roots.imag) < 1e-9].real
    if not len(real) or abs(root := float(real[np.argmin(np.abs(real))])) > 0.3:
        return None
    near = _at(line, low, high, place + reach * (root + 1e-3))
    if near is None or near.margin > 0.02 * max(values):
        return None
    q = np.array([np.polyval(np.polyfit(NODES, column, len(NODES) - 1), root) for column in np.array(configurations).T])
    s = place + reach * root
    return SingularPoint(q, s, "change point")


def _lowest(line: DriveLine, low: CurvePoint, middle: CurvePoint, high: CurvePoint) -> float:
    """Where the margin is least, nearly."""
    a, b = low.s, high.s
    if middle is low:  # one interval, in which the margin changes its sign
        return (a * high.margin + b * low.margin) / (low.margin + high.margin)

    def margin(s: float) -> float:
        found = _at(line, low, high, s)
        return np.inf if found is None else found.margin

    return least_place(margin, a, b, SECTIONS)


def _at(line: DriveLine, low: CurvePoint, high: CurvePoint, s: float) -> CurvePoint | None:
    """The point at s of the branch through two points."""
    part = (s - low.s) / (high.s - low.s)
    guess = line.system.displaced(low.q + part * (high.q - low.q), np.zeros(line.system.layout.nv))
    q = line.system.closed_at(guess, line.drives(s))
    return None if q is None else line.point(q, s, low.tangent)


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
                    f"{line.system.mechanism.name}: the motion cannot be followed beyond {line.described(point.s)}",
                    "Choose another range.",
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
    scales = line.system.constraints.coordinate_scales
    farthest = 3.0 * np.max(np.abs(stop.q - start.q) / scales) + VANISHING
    for guess in guesses:
        q = line.system.closed_at(line.system.displaced(guess, np.zeros(line.system.layout.nv)), line.drives(s))
        if q is not None and np.max(np.abs(q - near.q) / scales) <= farthest:
            return q
    raise MbdSimError(f"{line.system.mechanism.name}: no configuration is found at {line.described(s)}.")


FULL_TURN = 2.0 * np.pi
FAR = 20.0  # sizes of the mechanism, up to which displacements are followed


@dataclass(frozen=True)
class ReachableRange:
    """The interval of a drive in rad or m that can be reached from the start position, and what bounds it.

    An angle that goes round, and a displacement that has no end within a large distance, are infinite, with a bound "".
    """

    lower: float
    upper: float
    lower_bound: Kind | str
    upper_bound: Kind | str

    __repr__ = short_repr


@interruptible()
def reachable_range(mechanism: Mechanism, drive: str) -> ReachableRange:
    """How far the only drive of a mechanism can go in either direction from the start position in the file.

    :raises InputError: there is no such coordinate, or the mechanism has several degrees of freedom.
    :raises MechanismError: see `KinematicSystem`.
    """
    return _reach(KinematicSystem(mechanism, [drive]))


def _reach(system: KinematicSystem) -> ReachableRange:
    name, start = system.drives[0], system.start[system.q_driven]
    travel = FULL_TURN if is_rotation(system.mechanism, name) else FAR * system.constraints.size
    ends: list[tuple[float, Kind | str]] = []
    for sign in (-1.0, 1.0):
        line = DriveLine(system, start, start + sign * travel)
        curve = traced_curve(line, line.forward(system.start, 0.0, 1.0), through=False)
        if curve.singular:
            point = curve.singular[-1][1]
            ends.append((float(line.drives(point.s)[0]), point.kind))
        else:
            ends.append((sign * np.inf, ""))
    return ReachableRange(ends[0][0], ends[1][0], ends[0][1], ends[1][1])


def require_regular(system: KinematicSystem, line: DriveLine, first: CurvePoint) -> None:
    """Refuse to begin at a dead point or a change point, where the direction of the motion is not determined.

    :raises UnreachableError: the motion begins at one.
    """
    if is_singular(first.margin) or abs(first.pace) < VANISHING:
        kind = "change point" if is_singular(first.margin) else "dead point"
        raise UnreachableError(
            f"{system.mechanism.name}: the motion begins at a {kind}, at {_where(system, line, first.s)}, where its "
            "direction is not determined. Begin the range beside it."
        )


def require_reached(system: KinematicSystem, line: DriveLine, curve: TracedCurve) -> None:
    """Refuse a range that ends at a dead point or a change point.

    :raises UnreachableError: with the point and the reachable interval.
    """
    if not curve.singular and curve.points[-1].s == 1.0:
        return
    if not curve.singular:
        raise UnreachableError(
            f"{system.mechanism.name}: the end of the range cannot be reached", "Give a shorter one."
        )
    point = curve.singular[-1][1]
    text = f"{system.mechanism.name}: the drive cannot go on at the {point.kind} at {_where(system, line, point.s)}"
    if len(system.drives) == 1 and (interval := _interval(system)):
        text += f". {interval.removesuffix('.')}"
    raise UnreachableError(
        text,
        "Give a range within, or follow the motion through such points with --through-dead-points "
        '(dead_points="follow").',
    )


def _where(system: KinematicSystem, line: DriveLine, s: float) -> str:
    named = zip(system.drives, line.drives(s).tolist(), strict=True)
    return ", ".join(f"{name} = {shown(system.mechanism, name, value)}" for name, value in named)


def _interval(system: KinematicSystem) -> str:
    name = system.drives[0]
    try:
        reach = _reach(system)
    except InputError:
        return ""
    if np.isinf(reach.lower) and np.isinf(reach.upper):
        return ""
    first = "anywhere" if np.isinf(reach.lower) else shown(system.mechanism, name, reach.lower)
    last = "anywhere" if np.isinf(reach.upper) else shown(system.mechanism, name, reach.upper)
    start = shown(system.mechanism, name, float(system.start[system.q_driven][0]))
    return f"From the start position of the file, {start}, {name} reaches from {first} to {last}."


def shown(mechanism: Mechanism, name: str, value: float) -> str:
    """A coordinate for people: in degrees or in m."""
    return value_shown(value, rotation=is_rotation(mechanism, name))


def value_shown(value: float, *, rotation: bool) -> str:
    """An angle in rad or a displacement in m for people."""
    if rotation:
        return f"{round(float(np.degrees(value)), 9) + 0.0:.6g} deg"
    return f"{round(value, 12) + 0.0:.6g} m"
