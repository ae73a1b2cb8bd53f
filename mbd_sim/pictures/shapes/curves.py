"""Curves given by equations, followed point by point, and surfaces, drawn by curves on them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import casadi as ca
import numpy as np

from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.base.geometry.rotation import unit_or_zero
from mbd_sim.dynamics.math.expressions import all_evaluated, function_of
from mbd_sim.mechanism.elements.constraints import Surface, is_one_sided

EquationPair = Callable[[Array], tuple[Array, Array]]  # from a point (3,): two values (2,), gradients (2, 3)

LineKind = Literal["curve", "net", "outline"]

REACH = 1.3  # of the picture, relative to the distance of the constrained point from the frame of the equations
STEP, FINE_STEP = 0.04, 0.01  # from point to point, relative to the reach; of outlines that points touch from outside
MAX_STEPS = 500  # in each direction
LEVEL_LINES, MERIDIANS = 7, 8  # number of lines on a surface, besides its outline
MAX_ITERATIONS = 8
MIN_SINE_SQUARED = 1e-12  # sin² of the angle between two gradients, below which they count as parallel
TOLERANCE = 1e-9  # of Newton's method, relative to the step


@dataclass(frozen=True, eq=False)
class CurveLine:
    """A line through `points` (n, 3) in m: a whole curve, or of a surface a line of its `net` or of its `outline`.

    A line of a net is `front` where it lies on the side toward the eye.
    """

    points: Array
    kind: LineKind = "curve"
    front: bool = True


def curve_lines(constraint: Surface, point: Array, base: Pose) -> list[CurveLine]:
    """The curve through a point (3,) on which two equations hold, in ground's frame; the equations' frame is `base`.

    It is followed up to `REACH` times the distance of the point from the base.
    """
    x, values = _equations(constraint, base)
    return _through_point(x, values, point, base)


def section_lines(constraint: Surface, point: Array, base: Pose, normal: Array) -> list[CurveLine]:
    """The curve in which the plane through a point (3,) with a normal (3,) cuts a surface.

    If the constraint is one-sided, the point may be far from the surface.
    """
    x, values = _equations(constraint, base)
    both = ca.vertcat(values, ca.dot(ca.DM(normal), x - ca.DM(point)))
    if not is_one_sided(constraint):
        return _through_point(x, both, point, base)
    reach, pair = _reach(point, base), _equation_pair(x, both)
    start = _nearest_solution(pair, point, reach)
    if start is None:
        return []
    return _curve_lines([follow_curve(pair, start, FINE_STEP * reach, _within_reach(base, reach))], "curve")


def surface_lines(constraint: Surface, point: Array, base: Pose, toward: Array) -> list[CurveLine]:
    """A surface near a point (3,): lines on it, and its outline viewed from the direction `toward` (3,).

    The lines are level lines and meridians about the third axis of the frame. Where level lines are open, they are
    sections across the first two axes instead.
    """
    x, values = _equations(constraint, base)
    reach = _reach(point, base)
    within_reach, slope = _within_reach(base, reach), ca.jacobian(values, x)

    def cut(at: Array, normal: Array) -> Array:
        plane = ca.dot(ca.DM(normal), x - ca.DM(at))
        return follow_curve(_equation_pair(x, ca.vertcat(values, plane)), at, STEP * reach, within_reach)

    lines = [line for line in _grid(cut, point, base, reach) if len(line) > 2]
    outline_equations = _equation_pair(x, ca.vertcat(values, ca.dot(slope.T, ca.DM(toward))))
    outlines: list[Array] = []
    for line in lines:
        nearest_to_outline = line[int(np.argmin(np.abs(_gradients(x, slope, line) @ toward)))]
        start = _nearest_solution(outline_equations, nearest_to_outline, 0.2 * reach)
        if start is None or not within_reach(start):
            continue
        if all(_distance(outline, start) > 2.0 * STEP * reach for outline in outlines):
            outlines.append(follow_curve(outline_equations, start, STEP * reach, within_reach))
    return [*_visible_and_hidden(x, slope, lines, toward), *_curve_lines(outlines, "outline")]


def _through_point(x: ca.SX, values: ca.SX, point: Array, base: Pose) -> list[CurveLine]:
    reach = _reach(point, base)
    line = follow_curve(_equation_pair(x, values), point, STEP * reach, _within_reach(base, reach))
    return _curve_lines([line], "curve")


def _grid(cut: Callable[[Array, Array], Array], point: Array, base: Pose, reach: float) -> list[Array]:
    """Lines (n, 3) on a surface through and around a point.

    :param cut: returns the line through a point (3,) in the plane with a normal (3,).
    """
    first, second, up = base.rotation.T

    def meridian(at: Array) -> Array:
        across = np.cross(up, at - base.position)
        return cut(at, unit_or_zero(across) if np.linalg.norm(across) > STEP * reach else second)

    meridians = [meridian(point)]
    levels = [cut(at, up) for at in _evenly_spaced(meridians[0], LEVEL_LINES)]
    longest = max(levels, key=lambda line: float(np.sum(np.linalg.norm(np.diff(line, axis=0), axis=1))))
    if len(longest) > 2 and np.array_equal(longest[0], longest[-1]):
        for at in _evenly_spaced(longest, MERIDIANS):
            if all(_distance(line, at) > STEP * reach for line in meridians):
                meridians.append(meridian(at))
        return [*levels, *meridians]
    one, other = cut(point, first), cut(point, second)
    return [
        *(cut(at, second) for at in _evenly_spaced(one, MERIDIANS)),
        *(cut(at, first) for at in _evenly_spaced(other, MERIDIANS)),
    ]


def follow_curve(pair: EquationPair, start: Array, step: float, within_reach: Callable[[Array], bool]) -> Array:
    """Points (n, 3), about `step` m apart, on the curve on which both values are zero, both ways from `start`."""
    halves: list[list[Array]] = []
    for sign in (1.0, -1.0):
        points, along = [start], None
        while len(points) < MAX_STEPS:
            slopes = pair(points[-1])[1]
            tangent = unit_or_zero(np.cross(unit_or_zero(slopes[0]), unit_or_zero(slopes[1])))
            tangent = tangent * (sign if along is None else 1.0 if tangent @ along >= 0.0 else -1.0)
            following = _nearest_solution(pair, points[-1] + step * tangent, step) if tangent.any() else None
            if following is None or not within_reach(following):
                break
            if len(points) > 3 and np.linalg.norm(following - start) < 0.75 * step:
                return np.array([*points, start])
            points.append(following)
            along = tangent
        halves.append(points)
    return np.array([*halves[1][:0:-1], *halves[0]])


def _nearest_solution(pair: EquationPair, point: Array, step: float) -> Array | None:
    """The nearest point (3,) at which both values are zero, by Newton's method; None where it does not converge."""
    at = np.array(point)
    for _ in range(MAX_ITERATIONS):
        values, slopes = pair(at)
        if not (np.all(np.isfinite(values)) and np.all(np.isfinite(slopes))):
            return None
        (a, b), (_, d) = slopes @ slopes.T
        if (size := a * d - b * b) <= MIN_SINE_SQUARED * a * d:
            return None
        change = slopes.T @ np.array([d * values[0] - b * values[1], a * values[1] - b * values[0]]) / size
        at = at - change
        if np.linalg.norm(change) <= TOLERANCE * step:
            return at if np.linalg.norm(at - point) <= step else None
    return None


def _equations(constraint: Surface, base: Pose) -> tuple[ca.SX, ca.SX]:
    """The symbols of a point (3,) in ground's frame, and the values (k,) of the equations at that point and t = 0."""
    x = ca.SX.sym("x", 3)
    local = ca.DM(base.rotation.T) @ (x - ca.DM(base.position))
    names = {"x": local[0], "y": local[1], "z": local[2], "t": ca.SX(0)}
    return x, ca.vertcat(*(function_of(equation, names) for equation in constraint.equations))


def _equation_pair(x: ca.SX, values: ca.SX) -> EquationPair:
    function = ca.Function("pair", [x], [ca.densify(values), ca.densify(ca.jacobian(values, x))])

    def pair(point: Array) -> tuple[Array, Array]:
        results, gradients = all_evaluated(function, point)
        return results.ravel(), gradients

    return pair


def _gradients(x: ca.SX, slope: ca.SX, line: Array) -> Array:
    """The gradients (n, 3) at the points of a line (n, 3)."""
    return np.array(ca.Function("slope", [x], [ca.densify(slope.T)]).map(len(line))(line.T)).T


def _visible_and_hidden(x: ca.SX, slope: ca.SX, lines: Sequence[Array], toward: Array) -> list[CurveLine]:
    """The lines of a surface, split where they pass to the side that faces away from the eye."""
    if not lines:
        return []
    signs = [_gradients(x, slope, line) @ toward > 0.0 for line in lines]
    every, depth = np.concatenate(signs), np.concatenate(lines) @ toward
    front_sign = not every.any() or every.all() or depth[every].mean() >= depth[~every].mean()
    found = []
    for line, sign in zip(lines, signs, strict=True):
        for piece in np.split(np.arange(len(line)), np.flatnonzero(np.diff(sign)) + 1):
            points = line[piece[0] : piece[-1] + 2]
            if len(points) > 1:
                found.append(CurveLine(points, "net", bool(every.all() or sign[piece[0]] == front_sign)))
    return found


def _curve_lines(lines: Sequence[Array], kind: LineKind) -> list[CurveLine]:
    return [CurveLine(line, kind) for line in lines if len(line) > 1]


def _evenly_spaced(line: Array, count: int) -> list[Array]:
    """Points (3,) evenly spaced along a line, without its ends."""
    indices = np.linspace(0, len(line) - 1, count + 1 if len(line) > count else 2).round().astype(int)
    return [line[index] for index in indices[:-1] + (indices[1] - indices[0]) // 2]


def _distance(line: Array, at: Array) -> float:
    return float(np.min(np.linalg.norm(line - at, axis=1)))


def _reach(point: Array, base: Pose) -> float:
    return REACH * (float(np.linalg.norm(point - base.position)) or 1.0)


def _within_reach(base: Pose, reach: float) -> Callable[[Array], bool]:
    return lambda point: bool(np.linalg.norm(point - base.position) <= reach)
