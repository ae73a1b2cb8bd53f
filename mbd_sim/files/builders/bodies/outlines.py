"""Builds the outlines of parts from the chains of points, lines and curves in the file.

The pieces are made one after the other, then corners are rounded, and a closed outline is turned so that it runs
counterclockwise. Last, each joint at which the outline turns to the left becomes a corner.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from mbd_sim.base.errors import InputError, Problem
from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.base.rounded import arc_tangent, hypotenuse, sine_cosine
from mbd_sim.files.schema.shapes import AnyShapeSpec, OutlineSpec, StrokeSpec
from mbd_sim.mechanism.elements.contacts import PlanarBody
from mbd_sim.mechanism.elements.parts import Attachment
from mbd_sim.mechanism.outlines.area import runs_clockwise
from mbd_sim.mechanism.outlines.biarcs import arc_middle, biarc_joint, curve_tangents
from mbd_sim.mechanism.outlines.crossings import ROUND_OFF, crossing_points, lies_on, self_crossing
from mbd_sim.mechanism.outlines.pieces import Outline, Piece, Point, Round, Straight
from mbd_sim.mechanism.values.source import Location, Source

SMOOTH = 1e-6  # rad, turn up to which a joint is no corner
MEETS = 1e-6  # relative; how exactly the ends of an arc must have the same distance from its center
AXES = {
    "xy": np.eye(3),
    "xz": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
    "yz": np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
}  # the columns are the axes of the outline: both of its plane, and the one across


class OutlineError(InputError):
    """A point of an outline that cannot be used, with its index in the file."""

    def __init__(self, index: int, message: str, remedy: str) -> None:
        super().__init__(message, remedy)
        self.index = index


@dataclass(frozen=True)
class _Stroke:
    """The way to a point, with its `index` in the file; `curve` is that of the file, turned."""

    to: Point
    index: int
    spec: StrokeSpec | None = None
    through: Point | None = None
    center: Point | None = None

    @property
    def round(self) -> float:
        return (self.spec.round or 0.0) if self.spec is not None else 0.0


def outline_of(spec: OutlineSpec, hollow: bool = False) -> Outline:
    """The outline of a shape in its plane.

    :param hollow: the material is around it.
    :raises OutlineError: it cannot be built.
    """
    strokes = _strokes(spec)
    size = max(max(abs(x), abs(y)) for x, y in (stroke.to for stroke in strokes)) or 1.0
    if spec.closed and math.dist(strokes[0].to, strokes[-1].to) > ROUND_OFF * size:
        strokes.append(_Stroke(strokes[0].to, 0, replace_spec(strokes[0])))
    elif spec.closed:
        strokes[-1] = replace(strokes[-1], to=strokes[0].to)
    pieces: list[Piece] = []
    kept: list[_Stroke] = []
    for before, stroke in pairwise(strokes):
        if math.dist(before.to, stroke.to) <= ROUND_OFF * size:
            if stroke.index or spec.repeat == 1.0:
                raise OutlineError(stroke.index, "is the point before it as well", "Remove one of the two points.")
            continue
        pieces.append(_piece(before.to, stroke))
        kept.append(stroke)
    pieces = _rounded(pieces, kept, spec.closed)
    outline = Outline(tuple(pieces), spec.closed)
    if spec.closed and runs_clockwise(outline) is not hollow:
        outline = Outline(tuple(_reversed(piece) for piece in reversed(pieces)))
    return Outline(tuple(_with_corners(outline)), spec.closed)


def replace_spec(first: _Stroke) -> StrokeSpec | None:
    """The first entry as the end of the closing line, which only its rounding concerns."""
    return None if first.spec is None else first.spec.model_copy(update={"through": None, "center": None})


def check_outlines(
    shapes: Sequence[AnyShapeSpec], location: Location, alone: bool, source: Source, problems: list[Problem]
) -> bool:
    """Report the outlines among the shapes of a part that cannot be built, or that cross themselves.

    :param alone: the part has a `shape` and not `shapes`.
    :returns: whether all can be used.
    """
    before, unknown = len(problems), False
    for number, shape in enumerate(shapes):
        if not isinstance(shape, OutlineSpec):
            continue
        if not _is_known(shape):  # the parameters that cause this are reported
            unknown = True
            continue
        where = (*location, "shape") if alone else (*location, "shapes", number)
        try:
            outline = outline_of(shape)
        except OutlineError as error:
            problems.append(source.problem((*where, "points", error.index), error.message, error.remedy))
            continue
        if (found := self_crossing(outline)) is not None:
            ends = [outline.pieces[index].end for index in found[:2]]
            at, one, other = (f"[{x:.6g}, {y:.6g}] m" for x, y in (found[2], *ends))
            message = f"the outline meets itself at {at}, in its pieces to {one} and to {other}"
            problems.append(source.problem((*where, "points"), message, "Its pieces may only meet at their ends."))
    return len(problems) == before and not unknown


def is_usable(spec: OutlineSpec) -> bool:
    """Whether an outline can be built; `check_outlines` reports others, or what their numbers depend on is reported."""
    try:
        return _is_known(spec) and bool(outline_of(spec).pieces)
    except OutlineError:
        return False


def _is_known(spec: OutlineSpec) -> bool:
    """Whether all numbers of an outline are finite."""
    numbers = [spec.repeat]
    for entry in spec.points:
        values = [entry] if not isinstance(entry, StrokeSpec) else [*(entry.curve or ())]
        values += entry.model_dump(exclude={"curve"}).values() if isinstance(entry, StrokeSpec) else ()
        for value in values:
            numbers += value if isinstance(value, tuple) else (value,) if value is not None else ()
    return all(math.isfinite(number) for number in numbers)


def _strokes(spec: OutlineSpec) -> list[_Stroke]:
    """The entries of all repetitions; the first one only says where the outline begins."""
    first = spec.points[0]
    if isinstance(first, StrokeSpec) and any((first.through, first.center, first.radius, first.involute, first.curve)):
        raise OutlineError(0, "has no point before it, from which a curve could begin", "Begin with a point.")
    found = []
    for turn in range(int(spec.repeat)):
        angle = 2.0 * math.pi * turn / spec.repeat
        sine, cosine = sine_cosine(angle) if turn else (0.0, 1.0)

        def turned(point: Point, cosine: float = cosine, sine: float = sine) -> Point:
            x, y = float(point[0]), float(point[1])
            return cosine * x - sine * y, sine * x + cosine * y

        for index, entry in enumerate(spec.points):
            if not isinstance(entry, StrokeSpec):
                found.append(_Stroke(turned(entry), index))
                continue
            if entry.curve is not None:
                found += _curve(found[-1].to, [turned(point) for point in entry.curve], index, entry)
                continue
            center = (0.0, 0.0) if entry.involute and entry.center is None else entry.center
            through = entry.through and turned(entry.through)
            found.append(_Stroke(turned(_target(entry)), index, entry, through, center and turned(center)))
    return found


def _curve(start: Point, points: Sequence[Point], index: int, entry: StrokeSpec) -> Iterator[_Stroke]:
    """Arcs that are tangent to each other, two from each point of a tabulated curve to the next."""
    chain = [start, *points]
    inner = entry.model_copy(update={"round": None})
    for number, (one, other) in enumerate(pairwise(chain)):
        if one == other:
            message = f"point {number + 1} of the curve is the one before it as well"
            raise OutlineError(index, message, "Remove one of the two points.")
    tangents = curve_tangents(chain)
    for number, (one, other) in enumerate(pairwise(chain)):
        middle = biarc_joint(one, tangents[number], other, tangents[number + 1])
        if middle is None:
            message = f"the curve turns back at point {number + 1}"
            raise OutlineError(index, message, "Give more points where it turns, or end the curve in the corner.")
        yield _Stroke(middle, index, inner, arc_middle(one, tangents[number], middle))
        back = (-tangents[number + 1][0], -tangents[number + 1][1])
        last = number == len(points) - 1
        yield _Stroke(other, index, entry if last else inner, arc_middle(other, back, middle))


def _target(entry: StrokeSpec) -> Point:
    """The point to which an entry leads."""
    if entry.to is not None:
        return entry.to
    assert entry.polar is not None
    radius, angle = float(entry.polar[0]), float(entry.polar[1])
    sine, cosine = sine_cosine(angle)
    return radius * cosine, radius * sine


def _piece(start: Point, stroke: _Stroke) -> Piece:
    """The line or curve from a point."""
    spec, end, index = stroke.spec, stroke.to, stroke.index
    if spec is None:
        return Straight(start, end)
    if stroke.through is not None:
        return _arc_through(start, stroke.through, end, index)
    if spec.involute is not None:
        assert stroke.center is not None
        return _involute(start, end, stroke.center, float(spec.involute), index)
    if stroke.center is not None:
        return _arc_around(start, stroke.center, end, index)
    if spec.radius is not None:
        half, radius = 0.5 * math.dist(start, end), float(spec.radius)
        if abs(radius) < half * (1.0 + ROUND_OFF):
            raise OutlineError(
                index,
                f"the ends of the arc are {2.0 * half:.6g} m apart, too far for a radius of {abs(radius):.6g} m",
                "Use a larger radius; an arc of half a turn or more is given by 'through'.",
            )
        across = math.copysign(math.sqrt(radius * radius - half * half), radius) / (2.0 * half)
        (ax, ay), (bx, by) = start, end
        center = (0.5 * (ax + bx) - across * (by - ay), 0.5 * (ay + by) + across * (bx - ax))
        return _arc(start, center, end, radius > 0.0)
    return Straight(start, end)


def _arc(start: Point, center: Point, end: Point, left: bool) -> Round:
    """The arc around a center from one point to another, which turns to the left or right."""
    sign = 1.0 if left else -1.0
    first, last = (arc_tangent(sign * (y - center[1]), sign * (x - center[0])) for x, y in (start, end))
    turn = math.fmod(last - first, 2.0 * math.pi)
    if turn * sign <= 0.0:
        turn += sign * 2.0 * math.pi
    return Round(center, sign * math.dist(start, center), first, first + turn)


def _arc_around(start: Point, center: Point, end: Point, index: int) -> Round:
    radii = math.dist(start, center), math.dist(end, center)
    if abs(radii[0] - radii[1]) > MEETS * max(radii):
        raise OutlineError(
            index,
            f"the arc does not meet its ends, which are {radii[0]:.6g} m and {radii[1]:.6g} m from its center",
            "Move the center or one of the ends, or give 'radius' or 'through'.",
        )
    (ax, ay), (bx, by) = start, end
    dx, dy, square = bx - ax, by - ay, (bx - ax) ** 2 + (by - ay) ** 2
    share = ((center[0] - 0.5 * (ax + bx)) * dx + (center[1] - 0.5 * (ay + by)) * dy) / square
    center = (center[0] - share * dx, center[1] - share * dy)
    turn = (ax - center[0]) * (by - center[1]) - (ay - center[1]) * (bx - center[0])
    if abs(turn) <= MEETS * max(radii) ** 2:
        message = "the arc around its center is half a turn, which leads along either side"
        raise OutlineError(index, message, "Give a point that it leads through: 'through' in place of 'center'.")
    return _arc(start, center, end, turn > 0.0)


def _arc_through(start: Point, through: Point, end: Point, index: int) -> Round:
    (ax, ay), (bx, by), (cx, cy) = start, through, end
    dx, dy, ex, ey = bx - ax, by - ay, cx - ax, cy - ay
    cross = dx * ey - dy * ex
    if abs(cross) <= ROUND_OFF * (math.hypot(dx, dy) + math.hypot(ex, ey)) ** 2:
        message = "the three points of the arc are on one line"
        raise OutlineError(index, message, "Move the point 'through', or remove it for a straight line.")
    one, other = 0.5 * (dx * dx + dy * dy) / cross, 0.5 * (ex * ex + ey * ey) / cross
    center = (ax + one * ey - other * dy, ay - one * ex + other * dx)
    return _arc(start, center, end, cross > 0.0)


def _involute(start: Point, end: Point, center: Point, base: float, index: int) -> Round:
    """The involute of a circle through two points: outward or inward, to the left or to the right."""
    radii = [math.dist(point, center) for point in (start, end)]
    if min(radii) < base * (1.0 - ROUND_OFF):
        message = (
            f"an end of the involute is {min(radii):.6g} m from its center, within the base circle of {base:.6g} m"
        )
        raise OutlineError(index, message, "Begin the involute outside its base circle.")
    rolls = [math.sqrt(max(radius / base * (radius / base) - 1.0, 0.0)) for radius in radii]
    polar = [arc_tangent(point[1] - center[1], point[0] - center[0]) for point in (start, end)]
    spread = rolls[1] - arc_tangent(rolls[1]) - rolls[0] + arc_tangent(rolls[0])
    turned = math.remainder(polar[1] - polar[0], 2.0 * math.pi)
    hand = 1.0 if turned * spread >= 0.0 else -1.0
    if abs(abs(turned) - abs(spread)) > MEETS * max(abs(spread), base / radii[0]):
        raise OutlineError(
            index,
            f"the ends of the involute are {math.degrees(abs(turned)):.7g} deg apart, seen from its center; on an "
            f"involute they are {math.degrees(abs(spread)):.7g} deg apart",
            "Turn one of the ends, or correct its distance from the center.",
        )
    begin = polar[0] - hand * (rolls[0] - arc_tangent(rolls[0]))  # of the involute, at the base circle
    outward = 1.0 if rolls[1] > rolls[0] else -1.0
    sign = hand * outward  # of the curvature: to the left where it is 1
    first, last = (begin + hand * (roll - 0.5 * math.pi) + (math.pi if sign < 0.0 else 0.0) for roll in rolls)
    return Round(center, sign * base * rolls[0], first, last, outward * base)


def _rounded(pieces: list[Piece], strokes: Sequence[_Stroke], closed: bool) -> list[Piece]:
    """The pieces with arcs in place of the corners that are rounded."""
    pieces, arcs = list(pieces), dict[int, Round]()
    for number, stroke in enumerate(strokes):
        if not stroke.round:
            continue
        following = (number + 1) % len(pieces)
        if following == 0 and not closed:
            raise OutlineError(stroke.index, "is an end, which cannot be rounded", "Remove 'round'.")
        found = _rounding(pieces[number], pieces[following], float(stroke.round), stroke.index)
        if found is not None:
            pieces[number], arcs[number], pieces[following] = found
    return [each for number, piece in enumerate(pieces) for each in (piece, arcs.get(number)) if each is not None]


def _rounding(before: Piece, after: Piece, radius: float, index: int) -> tuple[Piece, Round, Piece] | None:
    """Two pieces, shortened, with the arc of a radius between them; None where they do not meet in a corner."""
    turn = math.remainder(after.first - before.last, 2.0 * math.pi)
    if abs(turn) <= SMOOTH:
        return None
    if any(isinstance(piece, Round) and piece.growth for piece in (before, after)):
        message = "a corner of an involute cannot be rounded"
        raise OutlineError(index, message, "Write the arc as a piece of its own.")
    left = 1.0 if turn > 0.0 else -1.0
    shifted = [_shifted(piece, -left * radius) for piece in (before, after)]
    corner, slack = before.end, ROUND_OFF * (radius + math.dist(before.start, before.end))
    for center in sorted(crossing_points(*shifted), key=lambda point: math.dist(point, corner)):
        one, other = _foot(before, center), _foot(after, center)
        if lies_on(one, before, slack) and lies_on(other, after, slack):
            arc = _arc(one, center, other, left > 0.0)
            return _until(before, one), arc, _from(after, other)
    message = f"the corner cannot be rounded with {radius:.6g} m: the arc does not fit between its pieces"
    raise OutlineError(index, message, "Use a smaller radius.")


def _shifted(piece: Piece, outward: float) -> Piece:
    """A line or an arc moved along its normals."""
    if isinstance(piece, Round):
        return replace(piece, radius=piece.radius + outward)
    (nx, ny), (ax, ay), (bx, by) = piece.normal, piece.start, piece.end
    return Straight((ax + outward * nx, ay + outward * ny), (bx + outward * nx, by + outward * ny))


def _foot(piece: Piece, point: Point) -> Point:
    """The point of a line or circle nearest to another point."""
    if isinstance(piece, Straight):
        (ax, ay), (ux, uy) = piece.start, piece.along
        way = (point[0] - ax) * ux + (point[1] - ay) * uy
        return ax + way * ux, ay + way * uy
    dx, dy = point[0] - piece.center[0], point[1] - piece.center[1]
    scale = abs(piece.radius) / hypotenuse(dx, dy)
    return piece.center[0] + scale * dx, piece.center[1] + scale * dy


def _until(piece: Piece, end: Point) -> Piece:
    return (
        replace(piece, end=end)
        if isinstance(piece, Straight)
        else _arc(piece.start, piece.center, end, piece.radius > 0)
    )


def _from(piece: Piece, start: Point) -> Piece:
    return (
        replace(piece, start=start)
        if isinstance(piece, Straight)
        else _arc(start, piece.center, piece.end, piece.radius > 0)
    )


def _reversed(piece: Piece) -> Piece:
    """A piece in the other direction, with the material on its other side."""
    if isinstance(piece, Straight):
        return Straight(piece.end, piece.start)
    return Round(piece.center, -piece.reach(piece.last), piece.last + math.pi, piece.first + math.pi, -piece.growth)


def _with_corners(outline: Outline) -> Iterator[Piece]:
    """The pieces with a corner wherever they turn to the left; the ends of an open chain turn by a right angle."""
    pieces = outline.pieces
    if not outline.closed:
        yield Round(pieces[0].start, 0.0, pieces[0].first - 0.5 * math.pi, pieces[0].first)
    for piece, following in zip(pieces, (*pieces[1:], pieces[0]), strict=True):
        yield piece
        if not outline.closed and piece is pieces[-1]:
            yield Round(piece.end, 0.0, piece.last, piece.last + 0.5 * math.pi)
            return
        turn = math.remainder(following.first - piece.last, 2.0 * math.pi)
        if turn > SMOOTH:
            yield Round(piece.end, 0.0, piece.last, piece.last + turn)


def planar_body(part: str, spec: OutlineSpec, pose: Pose, hollow: bool) -> PlanarBody:
    """What others touch of an outline with this pose of its plane; it is around them where it is `hollow`."""
    return PlanarBody(Attachment(part, np.zeros(3)), pose.position, pose.rotation, outline_of(spec, hollow))


def outline_axes(spec: OutlineSpec) -> Array:
    """The axes (3, 3) of the plane of an outline in the axes of its shape: columns x, y, and z across it."""
    return AXES[spec.plane]
