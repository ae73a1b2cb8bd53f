"""Convex polytopes at their poses, and how far two of them are apart.

Sharp ones are as far apart as their faces and pairs of edges separate them (separating axes; Gottschalk, Lin & Manocha
1996). Of rounded ones the cores do not touch, and their nearest features are the true ones.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from mbd_sim.compiler.ir.python_kinds import Array, Integers, zeros
from mbd_sim.simulation.contact.compiled.features.vectors import (
    cross,
    divide,
    dot,
    place,
    place_back,
    relative_pose,
    size_of,
    subtract,
    turn,
)

PARALLEL = 1e-9  # sine of the angle below which edges count as parallel
NEARLY_PARALLEL = 1e-6  # the same, below which round-off may decide where their lines are nearest


@dataclass(frozen=True)
class SharpHull:
    """A convex polytope in the frame of its part: see `mbd_sim.simulation.contact.features.polytopes.Polytope`.

    Face k begins with the vertex `firsts` k and has `sides` `corners` with their `inward` directions. Edge k has two
    `ends`; the directions from it into the faces are `beside` from number `beside_first` k on. The edges that leave
    vertex k are `leaving` from number `leaving_first` k on. A point is a segment without a length.
    """

    count: int
    vertices: Array
    faces: int
    normals: Array
    offsets: Array
    firsts: Integers
    sides: int
    corners: Array
    inward: Array
    edges: int
    ends: Integers
    directions: Array
    lengths: Array
    axes_count: int
    axes: Array
    segments: int
    segment_starts: Array
    segment_directions: Array
    segment_lengths: Array
    beside_first: Integers
    beside: Array
    leaving_first: Integers
    leaving: Array


@dataclass(frozen=True)
class Polytopes:
    """Two polytopes, with the sum of their `radii` (2,); `solid`: one of them has faces."""

    first: SharpHull
    second: SharpHull
    radii: Array
    radius: float
    solid: bool
    slots: int


@dataclass(frozen=True)
class PlacedHull:
    """A polytope at a pose, with its vertices in ground's axes; positions are from the origin of the second part."""

    hull: SharpHull
    pose: Array
    vertices: Array


def put(placed: PlacedHull, pose: Array, origin: Array) -> None:
    """Place a polytope."""
    relative_pose(pose, origin, placed.pose)
    for i in range(placed.hull.count):
        place(placed.pose, placed.hull.vertices[3 * i :], placed.vertices[3 * i :])


def polytope_distance(p: Polytopes, one: Array, other: Array) -> float:
    """See `NarrowPhase`."""
    a = PlacedHull(p.first, zeros(12), zeros(3 * p.first.count))
    b = PlacedHull(p.second, zeros(12), zeros(3 * p.second.count))
    put(a, one, other)
    put(b, other, other)
    return gap_of(p, a, b)


def gap_of(p: Polytopes, a: PlacedHull, b: PlacedHull) -> float:
    """The distance of both bodies."""
    apart = separation(a, b) if p.solid or p.radius == 0.0 else math.inf
    if p.radius != 0.0 and apart > 0.0:
        apart = min(min(edge_distance(a, b), face_distance(a, b)), face_distance(b, a))
    return apart - p.radius


def separation(a: PlacedHull, b: PlacedHull) -> float:
    """How far faces and pairs of edges separate two cores; negative by the depth of penetration."""
    found = max(faces_apart(a, b), faces_apart(b, a))
    one, other, axis = zeros(3), zeros(3), zeros(3)
    for i in range(a.hull.axes_count):
        turn(a.pose, a.hull.axes[3 * i :], one)
        for j in range(b.hull.axes_count):
            turn(b.pose, b.hull.axes[3 * j :], other)
            cross(one, other, axis)
            size = size_of(axis)
            if size > PARALLEL:
                divide(axis, size)
                low, high = lowest(a, axis), highest(a, axis)
                found = max(found, max(low - highest(b, axis), lowest(b, axis) - high))
    return found


def lowest(body: PlacedHull, axis: Array) -> float:
    """How far the vertices reach against a direction."""
    found = math.inf
    for i in range(body.hull.count):
        found = min(found, dot(body.vertices[3 * i :], axis))
    return found


def highest(body: PlacedHull, axis: Array) -> float:
    """How far the vertices reach along a direction."""
    found = -math.inf
    for i in range(body.hull.count):
        found = max(found, dot(body.vertices[3 * i :], axis))
    return found


def faces_apart(one: PlacedHull, other: PlacedHull) -> float:
    """How far the faces of the other body separate it from the vertices of the first one."""
    own, hull, found = zeros(3 * one.hull.count), other.hull, -math.inf
    into_frame(one, other, own)
    for face in range(hull.faces):
        height = math.inf
        for i in range(one.hull.count):
            height = min(height, dot(own[3 * i :], hull.normals[3 * face :]) - hull.offsets[face])
        found = max(found, height)
    return found


def into_frame(one: PlacedHull, other: PlacedHull, own: Array) -> None:
    """The vertices of one body in the frame of the other."""
    for i in range(one.hull.count):
        place_back(other.pose, one.vertices[3 * i :], own[3 * i :])


def depth(hull: SharpHull, face: int, own: Array) -> float:
    """How far inside the border of a face a point in the frame of the part is, seen along the normal."""
    found, arm = math.inf, zeros(3)
    for k in range(hull.sides):
        at = 3 * (face * hull.sides + k)
        subtract(own, hull.corners[at:], arm)
        found = min(found, dot(arm, hull.inward[at:]))
    return found


def face_distance(one: PlacedHull, other: PlacedHull) -> float:
    """The least height of vertices of one core above the faces of the other, within their borders."""
    own, hull, found = zeros(3 * one.hull.count), other.hull, math.inf
    into_frame(one, other, own)
    for i in range(one.hull.count):
        for face in range(hull.faces):
            height = dot(own[3 * i :], hull.normals[3 * face :]) - hull.offsets[face]
            if 0.0 <= height < found and depth(hull, face, own[3 * i :]) >= 0.0:
                found = height
    return found


def edge_distance(a: PlacedHull, b: PlacedHull) -> float:
    """The least distance of edges of both cores."""
    found = math.inf
    for i in range(a.hull.segments):
        for j in range(b.hull.segments):
            found = min(found, segment_distance(a, i, b, j))
    return found


def segment_distance(a: PlacedHull, i: int, b: PlacedHull, j: int) -> float:
    """The distance of two edges (Ericson, *Real-Time Collision Detection*).

    Where they are nearly parallel, they are nearest at an end of one of them if not where their lines are.
    """
    start, direction, other_start, other_direction = zeros(3), zeros(3), zeros(3), zeros(3)
    line, across = zeros(3), zeros(3)
    place(a.pose, a.hull.segment_starts[3 * i :], start)
    turn(a.pose, a.hull.segment_directions[3 * i :], direction)
    place(b.pose, b.hull.segment_starts[3 * j :], other_start)
    turn(b.pose, b.hull.segment_directions[3 * j :], other_direction)
    subtract(start, other_start, line)
    cross(direction, other_direction, across)
    length, other_length, square = a.hull.segment_lengths[i], b.hull.segment_lengths[j], dot(across, across)
    along, cosine = dot(direction, line), dot(direction, other_direction)
    beside = dot(other_direction, line)
    s = clipped((cosine * beside - along) / square, length) if square > PARALLEL * PARALLEL else 0.0
    found = apart_from(s, length, other_length, line, direction, other_direction)
    if square < NEARLY_PARALLEL * NEARLY_PARALLEL:
        found = min(found, apart_from(0.0, length, other_length, line, direction, other_direction))
        found = min(found, apart_from(length, length, other_length, line, direction, other_direction))
    return found


def apart_from(
    s: float, length: float, other_length: float, line: Array, direction: Array, other_direction: Array
) -> float:  # fmt: skip
    """The distance of two edges near a place s on the first one; the `line` is from the start of the second to its."""
    cosine, apart = dot(direction, other_direction), zeros(3)
    t = clipped(cosine * s + dot(other_direction, line), other_length)
    nearest = clipped(cosine * t - dot(direction, line), length)
    for k in range(3):
        apart[k] = line[k] + nearest * direction[k] - t * other_direction[k]
    return size_of(apart)


def clipped(value: float, highest: float) -> float:
    """The nearest number from 0 to `highest`."""
    return min(max(value, 0.0), highest)
