"""Convex bodies that may be round at a pose: see `mbd_sim.simulation.contact.features.round_bodies`."""

from __future__ import annotations

import math
from dataclasses import dataclass

from mbd_sim.compiler.ir.python_kinds import Array, Integers, zeros
from mbd_sim.dynamics.contact.shapes import BEND, EXACT_TILT, FLAT_TILT, LEVEL_TILT, POINTS
from mbd_sim.simulation.contact.compiled.features.vectors import (
    add,
    divide,
    dot,
    place,
    place_back,
    relative_pose,
    scale,
    size_of,
    subtract,
    turn,
    turn_back,
)

LEAST = 1e-30  # of √(n·K n) in m, which is zero along the axis of a rim
FEET, DEEPEST = 15, -0.9  # steps to the nearest point of an ellipsoid, and how deep it may be beyond, in its curvature
FLAT = 1e-6  # sine of the angle below which an edge lies on a face
CODES = POINTS + 2  # numbers of points of a rim, and of an edge
CROSSED = 1e-3  # of the radius of a disc: half of a chord, up to which its middle carries an edge


@dataclass(frozen=True)
class RoundHull:
    """A body in the frame of its part: see `mbd_sim.simulation.contact.features.round_bodies.RoundBody`.

    `curved` corners have `rims` in m; an ellipsoid has 1. `marks` are those rims as the numbers of slots have them. The
    `arms` (3 `POINTS`,) are unit vectors from the center of a rim to its points. Face k has the corners of its border
    from number `border_first` k on, with the directions `inward` from its sides, or is a disc with a radius.
    """

    count: int
    corners: Array
    roots: Array
    curved: Integers
    is_curved: bool
    rims: Array
    marks: Array
    arms: Array
    sides: int
    ends: Integers
    directions: Array
    cosines: Array
    ruled: Integers
    faces: int
    normals: Array
    centers: Array
    face_radii: Array
    border_first: Integers
    borders: Array
    inward: Array
    reach: float
    at: Array


@dataclass(frozen=True)
class PlacedRound:
    """A body at a pose, in ground's axes; positions are from the origin of the second part."""

    hull: RoundHull
    pose: Array
    corners: Array
    directions: Array
    normals: Array


def put_round(placed: PlacedRound, pose: Array, origin: Array) -> None:
    """Place a body."""
    hull = placed.hull
    relative_pose(pose, origin, placed.pose)
    for i in range(hull.count):
        place(placed.pose, hull.corners[3 * i :], placed.corners[3 * i :])
    for i in range(hull.sides):
        turn(placed.pose, hull.directions[3 * i :], placed.directions[3 * i :])
    for i in range(hull.faces):
        turn(placed.pose, hull.normals[3 * i :], placed.normals[3 * i :])


def is_rim(body: PlacedRound, corner: int) -> bool:
    """Whether a corner is a rim."""
    return body.hull.faces > 0 and body.hull.curved[corner] != 0


def folded(body: PlacedRound, corner: int, own: Array, out: Array) -> float:
    """R n of a corner and its size √(n·K n), which n·n - (n·a)² would lose near the axis a of a rim.

    :param own: n in the frame of the part.
    """
    for row in range(3):
        out[row] = dot(body.hull.roots[9 * corner + 3 * row :], own)
    return size_of(out)


def unfolded(body: PlacedRound, corner: int, fold: Array, out: Array) -> None:
    """Rᵀ times a vector."""
    roots = body.hull.roots[9 * corner :]
    for k in range(3):
        out[k] = roots[k] * fold[0] + roots[3 + k] * fold[1] + roots[6 + k] * fold[2]


def offset(body: PlacedRound, corner: int, normal: Array, out: Array) -> None:
    """From a corner to its farthest point along a normal."""
    own, fold, arm = zeros(3), zeros(3), zeros(3)
    turn_back(body.pose, normal, own)
    divide(fold, max(folded(body, corner, own, fold), LEAST))
    unfolded(body, corner, fold, arm)
    turn(body.pose, arm, out)


def farthest(body: PlacedRound, corner: int, normal: Array, sign: float, out: Array) -> None:
    """The farthest point of a corner along a normal times `sign`, without rounding."""
    arm = zeros(3)
    offset(body, corner, normal, arm)
    add(body.corners[3 * corner :], sign, arm, out)


def nearest_on_ellipsoid(body: PlacedRound, corner: int, line: Array, arm: Array, normal: Array) -> float:
    """From the center of an ellipsoid to its point nearest to the end of a `line` from there, and the unit normal.

    :returns: the length that x / r² has there, 1 over the distance of the center from the plane that touches it.
    """
    own, fold, level, outward, roots = zeros(3), zeros(3), zeros(3), zeros(3), body.hull.roots[9 * corner :]
    turn_back(body.pose, line, own)
    for i in range(3):
        fold[i] = dot(roots[3 * i :], own)
    far = foot(roots, fold)
    for i in range(3):
        square = dot(roots[3 * i :], roots[3 * i :])
        add(level, fold[i] / (square + far), roots[3 * i :], level)
        add(outward, fold[i] / (square * (square + far)), roots[3 * i :], outward)
    size = max(size_of(outward), LEAST)
    divide(outward, size)
    turn(body.pose, outward, normal)
    turn(body.pose, level, arm)
    return size


def foot(roots: Array, fold: Array) -> float:
    """λ of the nearest point of an ellipsoid: its parts along the half axes r are r² z / (r² + λ) of the parts z.

    :param fold: the products r z.
    """
    far, least = 0.0, math.inf
    for i in range(3):
        least = min(least, dot(roots[3 * i :], roots[3 * i :]))
    for _ in range(FEET):
        excess, slope = -1.0, 0.0
        for i in range(3):
            square = dot(roots[3 * i :], roots[3 * i :]) + far
            excess += fold[i] * fold[i] / (square * square)
            slope += fold[i] * fold[i] / (square * square * square)
        if not slope > 0.0:
            break
        far = max(far + 0.5 * excess / slope, DEEPEST * least)
    return far


def add_bend(body: PlacedRound, corner: int, normal: Array, out: Array) -> None:
    """Subtract the derivative (9,) of an offset by the normal, in ground's axes."""
    own, fold, arm, row_of, half, part = zeros(3), zeros(3), zeros(3), zeros(3), zeros(9), zeros(3)
    if not body.hull.curved[corner]:
        return
    roots = body.hull.roots[9 * corner :]
    turn_back(body.pose, normal, own)
    size = max(folded(body, corner, own, fold), LEAST)
    divide(fold, size)
    unfolded(body, corner, fold, arm)
    for row in range(3):
        for column in range(3):
            row_of[column] = -arm[row] * arm[column]
            for k in range(3):
                row_of[column] += roots[3 * k + row] * roots[3 * k + column]
        divide(row_of, size)
        turn(body.pose, row_of, half[3 * row :])
    for column in range(3):
        for row in range(3):
            row_of[row] = half[3 * row + column]
        turn(body.pose, row_of, part)
        for row in range(3):
            out[3 * row + column] -= part[row]


def height(body: PlacedRound, corner: int, normal: Array, sign: float, own: Array) -> float:
    """How far in m a corner reaches along a normal times `sign`; this normal is `own` in the frame of the part."""
    fold, found = zeros(3), sign * dot(body.corners[3 * corner :], normal)
    return found + folded(body, corner, own, fold) if body.hull.curved[corner] else found


def reach(body: PlacedRound, normal: Array, sign: float) -> float:
    """How far in m a body reaches along a normal times `sign`, without rounding."""
    own, found = zeros(3), -math.inf
    turn_back(body.pose, normal, own)
    for i in range(body.hull.count):
        found = max(found, height(body, i, normal, sign, own))
    return found


def lead(body: PlacedRound, first: int, second: int, normal: Array, sign: float) -> float:
    """How far in m a corner reaches beyond all others but a second one along a normal times `sign`."""
    own, found = zeros(3), -math.inf
    turn_back(body.pose, normal, own)
    for i in range(body.hull.count):
        if i != first and i != second:
            found = max(found, height(body, i, normal, sign, own))
    return height(body, first, normal, sign, own) - found


def inside(body: PlacedRound, face: int, point: Array) -> float:
    """How far in m a point is inside the border of a face, seen along its normal."""
    own, arm, aside, hull, found = zeros(3), zeros(3), zeros(3), body.hull, math.inf
    place_back(body.pose, point, own)
    if hull.face_radii[face] > 0.0:
        subtract(own, hull.centers[3 * face :], arm)
        add(arm, -dot(arm, hull.normals[3 * face :]), hull.normals[3 * face :], aside)
        return hull.face_radii[face] - size_of(aside)
    for k in range(hull.border_first[face], hull.border_first[face + 1]):
        subtract(own, hull.borders[3 * k :], arm)
        found = min(found, dot(arm, hull.inward[3 * k :]))
    return found


def beside(body: PlacedRound, corner: int, point: Array) -> float:
    """How far in m a point is outside a rim, seen along its axis."""
    own, fold = zeros(3), zeros(3)
    place_back(body.pose, point, own)
    subtract(own, body.hull.corners[3 * corner :], own)
    return folded(body, corner, own, fold) / body.hull.rims[corner] - body.hull.rims[corner]


def middle(body: PlacedRound, face: int, out: Array) -> None:
    """A point of a face."""
    place(body.pose, body.hull.centers[3 * face :], out)


def tilt(body: PlacedRound, corner: int, normal: Array) -> float:
    """The sine of the tilt of a rim against a face with a normal; 1 for an ellipsoid."""
    own, fold = zeros(3), zeros(3)
    if body.hull.faces == 0:
        return 1.0
    turn_back(body.pose, normal, own)
    return folded(body, corner, own, fold) / body.hull.rims[corner]


def tilted(body: PlacedRound, corner: int, normal: Array) -> float:
    """In m, negative where a rim lies so flat on a face with this normal that it rests on points; large for others."""
    if not body.hull.curved[corner]:
        return math.inf
    return (tilt(body, corner, normal) - EXACT_TILT) * body.hull.rims[corner]


def bend(body: PlacedRound, corner: int, normal: Array, point: Array) -> float:
    """How far in m the end with this rim, which lies nearly flat, is bent toward a face at a point: see `smooth_rows`.

    :param normal: that of the face, towards this body.
    """
    own, at, fold, arm, radius = zeros(3), zeros(3), zeros(3), zeros(3), body.hull.rims[corner]
    turn_back(body.pose, normal, own)
    folded(body, corner, own, fold)
    place_back(body.pose, point, at)
    subtract(at, body.hull.corners[3 * corner :], at)
    folded(body, corner, at, arm)
    square = dot(fold, fold) / (radius * radius)
    low = max(-dot(fold, arm) / (radius * radius * radius), 0.0)
    rest = max(1.0 - square / (FLAT_TILT * FLAT_TILT), 0.0)
    return BEND * radius * low * low * low * low / (square + LEVEL_TILT * LEVEL_TILT) * rest * rest * rest


def bend_below(body: PlacedRound, face: int, other: PlacedRound, point: Array) -> float:
    """How far in m a round end is bent at a point towards the face of a sharp body that is nearly parallel to it."""
    own = facing(body, face, other)
    if own < 0:
        return 0.0
    return bend(body, corner_of(body.hull, face), other.normals[3 * own :], point)


def facing(body: PlacedRound, face: int, other: PlacedRound) -> int:
    """The face of a sharp body that is nearest to parallel to a round end; -1 if there is none."""
    found, least, radius = -1, 0.0, body.hull.face_radii[face]
    for k in range(other.hull.faces if radius > 0.0 and not other.hull.is_curved else 0):
        cosine = dot(body.normals[3 * face :], other.normals[3 * k :])
        if cosine < least:
            found, least = k, cosine
    return found


def corner_of(hull: RoundHull, face: int) -> int:
    """The rim of a round end."""
    return min(face, hull.count - 1)


def codes(hull: RoundHull) -> int:
    """The numbers of points that are fixed in a body and can lie on faces."""
    return CODES * max(hull.count, hull.sides)


def lies(one: PlacedRound, other: PlacedRound, face: int, code: int, part: float, out: Array) -> bool:
    """Whether the point with this number lies on a face of another body: one of a rim, or of an edge across a disc.

    :param part: see `edge_lies`.
    """
    number, feature = code % CODES, code // CODES
    if number < POINTS:
        return one.hull.is_curved and feature < one.hull.count and rim_lies(one, other, face, feature, number, out)
    return feature < one.hull.sides and edge_lies(one, other, face, feature, number - POINTS, part, out)


def rim_lies(one: PlacedRound, other: PlacedRound, face: int, corner: int, number: int, out: Array) -> bool:
    """Whether a rim lies flat on a face; `out` becomes one of its points."""
    normal, arm, own = other.normals[3 * face :], zeros(3), zeros(3)
    if not one.hull.curved[corner] or tilt(one, corner, normal) > FLAT_TILT:
        return False
    if lead(one, corner, -1, normal, -1.0) < 0.0:
        return False
    scale(one.hull.rims[corner], one.hull.arms[3 * number :], own)
    turn(one.pose, own, arm)
    add(one.corners[3 * corner :], 1.0, arm, out)
    return True


def edge_lies(one: PlacedRound, other: PlacedRound, face: int, side: int, number: int, part: float, out: Array) -> bool:
    """Whether an edge or a side lies across a disc; `out` becomes one of the two points that carry it.

    :param part: of the chord, between these points; 0 if the middle of a short one carries it, which a side can only.
    """
    direction, line, center, normal = zeros(3), zeros(3), zeros(3), other.normals[3 * face :]
    start, stop, radius = zeros(3), zeros(3), other.hull.face_radii[face]
    if radius == 0.0 or (one.hull.ruled[side] and part > 0.0):
        return False
    farthest(one, one.hull.ends[2 * side], normal, -1.0, start)
    farthest(one, one.hull.ends[2 * side + 1], normal, -1.0, stop)
    subtract(stop, start, direction)
    length = size_of(direction)
    divide(direction, length)
    if abs(dot(direction, normal)) > FLAT:
        return False
    middle(other, face, center)
    subtract(start, center, line)
    along = dot(direction, line)
    chord = radius * radius - dot(line, line) + along * along
    if not chord > 0.0:
        return False
    if part == 0.0 and (number == 1 or chord > CROSSED * CROSSED * radius * radius):
        return False
    half = part * math.sqrt(chord)
    end = -along + (half if number == 1 else -half)
    add(start, end, direction, out)
    return 0.0 < end < length
