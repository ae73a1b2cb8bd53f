"""The solids and lines of which pictures are made, the same in Rerun, in RViz and in drawings.

Solids stand for the shapes of a part; the outline of a prism is any polygon that does not cross itself. Symbols are
made of lines in the plane and in space: circles, spirals, coils, dashpots and curved arrows.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import assert_never

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.geometry.convex_hull import fans
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.geometry.rotation import aligning_z
from mbd_sim.mechanism.elements.parts import Part, Polyhedron, Shape
from mbd_sim.mechanism.outlines.pieces import polyline

Indices = NDArray[np.int64]


@dataclass(frozen=True)
class Prism:
    """A body of a `height` along z with an outline through `corners` in x and y, or without `closed` a wall."""

    corners: tuple[tuple[float, float], ...]
    height: float
    closed: bool = True


def prism_triangles(prism: Prism) -> Array:
    """The surface (n, 3, 3) of a prism, counterclockwise from outside."""
    corners, triangles = prism_mesh(prism)
    return corners[triangles]


def prism_mesh(prism: Prism) -> tuple[Array, Indices]:
    """The corners (n, 3) in m and the triangles (k, 3) of a prism; a wall has only its sides, seen from both."""
    outline, half = np.array(prism.corners), 0.5 * prism.height
    count = len(outline)
    corners = np.vstack([np.column_stack([outline, np.full(count, z)]) for z in (-half, half)])
    here = np.arange(count if prism.closed else count - 1)
    there = (here + 1) % count
    sides = np.vstack(
        [np.column_stack([here, there, there + count]), np.column_stack([here, there + count, here + count])]
    )
    if not prism.closed:
        return corners, np.vstack([sides, sides[:, ::-1]])
    face = polygon_triangles(outline)
    return corners, np.vstack([sides, face[:, ::-1], face + count])


def polygon_triangles(outline: Array) -> Indices:
    """The triangles (n - 2, 3) of a counterclockwise polygon (n, 2), by cutting off one ear after the other."""
    left, found = list(range(len(outline))), []
    while len(left) > 3:
        points = outline[left]
        before, after = np.roll(points, 1, axis=0), np.roll(points, -1, axis=0)
        turns = _cross(points - before, after - points)
        diagonals = np.hypot(*(after - before).T)
        order = [ear for ear in np.argsort(diagonals, kind="stable").tolist() if turns[ear] > 0.0]
        ear = next((ear for ear in order if _is_ear(points, ear)), int(np.argmax(turns)))
        found.append((left[ear - 1], left[ear], left[(ear + 1) % len(left)]))
        del left[ear]
    return np.array([*found, tuple(left)])


def _is_ear(points: Array, ear: int) -> bool:
    """Whether no other corner of a polygon (n, 2) is within the triangle of a corner and its neighbors."""
    a, b, c = points[ear - 1], points[ear], points[(ear + 1) % len(points)]
    others = np.delete(points, [ear - 1 if ear else len(points) - 1, ear, (ear + 1) % len(points)], axis=0)
    inside = [_cross(end - start, others - start) > 0.0 for start, end in ((a, b), (b, c), (c, a))]
    return not np.any(inside[0] & inside[1] & inside[2])


def _cross(one: Array, other: Array) -> Array:
    return np.asarray(one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0])


COIL_TURNS = 9
COIL_END = 0.08  # straight part at each end of a coil, relative to its length
ARC_POINTS = 25

# The segments of a dashpot, point pairs (along, across): along from 0 to 1, across in half widths.
_DASHPOT = np.array([
    [0.0, 0.0], [0.35, 0.0], [0.35, -1.0], [0.35, 1.0], [0.35, 1.0], [0.7, 1.0], [0.35, -1.0], [0.7, -1.0],
    [0.55, -0.8], [0.55, 0.8], [0.55, 0.0], [1.0, 0.0],
])  # fmt: skip


def circle(angles: Array) -> Array:
    """Points (n, 2) of the unit circle at angles (n,) in rad."""
    return np.column_stack([np.cos(angles), np.sin(angles)])


def spiral(inner: float, outer: float, turns: float, count: int = 120) -> Array:
    """Points (count, 2) of a spiral about the origin whose radius grows from `inner` to `outer`."""
    radius = np.linspace(inner, outer, count)
    return np.asarray(radius[:, None] * circle(np.linspace(0.0, 2.0 * np.pi * turns, count)))


def coil(radius: float) -> Array:
    """Points (n, 3) of a coil spring of a `radius` along z from 0 to 1, with straight ends."""
    angles = np.linspace(0.0, 2.0 * np.pi * COIL_TURNS, 24 * COIL_TURNS + 1)
    radii = radius * np.minimum(1.0, np.minimum(angles, angles[-1] - angles) / np.pi)  # from the axis and back to it
    height = COIL_END + (1.0 - 2.0 * COIL_END) * angles / angles[-1]
    return np.vstack([[0.0, 0.0, 0.0], np.column_stack([radii[:, None] * circle(angles), height]), [0.0, 0.0, 1.0]])


def flat_coil(length: float, end: float, turns: int, amplitude: float) -> Array:
    """Points (n, 2), forward and sideways, of a coil spring seen at a slant, between straight parts of length `end`.

    The windings run backward on the far side, as those of a helix do in an oblique view.
    """
    angles = np.linspace(0.0, 2.0 * np.pi * (turns + 0.5), 24 * turns + 13)
    loop = 0.26 * (length - 2.0 * end) / (turns + 0.5)
    forward = end + loop + (length - 2.0 * end - 2.0 * loop) * angles / angles[-1] - loop * np.cos(angles)
    return np.column_stack([forward, amplitude * np.sin(angles)])


def dashpot(half_width: float) -> Array:
    """The segments of a dashpot along z from 0 to 1, as pairs of consecutive points (n, 3) in the xz plane."""
    along, across = _DASHPOT.T
    return np.column_stack([half_width * across, np.zeros(len(across)), along])


def between(points: Array, start: Array, stop: Array) -> Array:
    """Points (n, 3) given along z from 0 to 1, moved so that they lead from `start` (3,) to `stop` (3,).

    z is stretched to the distance of the two; x and y keep their scale. Where the two coincide, x and y are ground's.
    """
    line = stop - start
    length = float(np.linalg.norm(line))
    rotation = aligning_z(line / length) if length > 1e-12 else np.eye(3)
    return np.asarray(start + np.outer(points[:, 2], line) + points[:, :2] @ rotation[:, :2].T)


def arc_arrow(center: Array, axis: Array, sweep: float, radius: float) -> Array:
    """Points (n, 3) of an arc of `sweep` rad about a unit `axis` (3,), right-handed, ending in an arrow head."""
    x = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    x /= np.linalg.norm(x)
    y = np.cross(axis, x)
    angles = np.linspace(0.0, sweep, ARC_POINTS)
    points = radius * (np.outer(np.cos(angles), x) + np.outer(np.sin(angles), y))
    base = sweep - min(0.35, 0.6 * sweep)
    outward = np.cos(base) * x + np.sin(base) * y
    barbs = [scale * radius * outward for scale in (1.18, 0.82)]
    return np.asarray(center + np.vstack([points, barbs[0], points[-1], barbs[1]]))


DISC_THICKNESS = 0.08  # relative to the radius
PLATE_THICKNESS = 0.02  # relative to the shorter side
RING_TUBE = 0.04  # radius of the tube, relative to that of the ring
POINT_MASS_RADIUS = 0.02  # of the ball at the mass center of a part without shapes, relative to the mechanism's size
LINE_WIDTH = 0.006  # relative to the mechanism's size


@dataclass(frozen=True)
class Rod:
    """A rod along z of a `length` in m between the centers of its rounded ends."""

    length: float
    radius: float


@dataclass(frozen=True)
class Cylinder:
    """A cylinder about z; a disc is a flat one."""

    length: float
    radius: float
    disc: bool = False

    @property
    def mark_height(self) -> float:
        """The height above the center at which lines lie visibly on its faces, m."""
        return 0.042 * self.radius if self.disc else 0.505 * self.length


@dataclass(frozen=True)
class Ring:
    """A ring about z, a torus whose tube has the radius `tube`."""

    radius: float
    tube: float


@dataclass(frozen=True)
class Box:
    """A box with edges of `size` (x, y, z) along the axes."""

    size: tuple[float, float, float]


@dataclass(frozen=True)
class Sphere:
    """A ball; a `particle` is a point mass, whose radius is only that of its picture."""

    radius: float
    particle: bool = False


@dataclass(frozen=True)
class Cone:
    """A cone about z, with its tip up; its center is at half of its height."""

    length: float
    radius: float


@dataclass(frozen=True)
class Ellipsoid:
    """An ellipsoid with `radii` along the axes."""

    radii: tuple[float, float, float]


Solid = Rod | Cylinder | Cone | Ring | Box | Sphere | Ellipsoid | Polyhedron | Prism


def solid_of(shape: Shape) -> Solid:
    """The solid of a shape, centered on the shape's pose."""
    size = shape.size
    match shape.kind:
        case "rod" | "capsule":
            return Rod(size[0], size[1])
        case "cylinder":
            return Cylinder(size[0], size[1])
        case "cone":
            return Cone(size[0], size[1])
        case "disc":
            return Cylinder(DISC_THICKNESS * size[0], size[0], disc=True)
        case "ring":
            return Ring(size[0], RING_TUBE * size[0])
        case "plate":
            return Box((size[0], size[1], PLATE_THICKNESS * min(size)))
        case "block":
            return Box((size[0], size[1], size[2]))
        case "sphere" | "particle":
            return Sphere(size[0], particle=shape.kind == "particle")
        case "ellipsoid":
            return Ellipsoid((size[0], size[1], size[2]))
        case "hull":
            assert shape.hull is not None
            return shape.hull
        case "outline":
            assert shape.outline is not None
            corners = tuple((x, y) for x, y in polyline(shape.outline).tolist())
            return Prism(corners, size[0] or PLATE_THICKNESS * shape.outline.size, shape.outline.closed)
        case _:
            assert_never(shape.kind)


def half_sizes(shape: Shape) -> Array:
    """Half the size (3,) in m of the box around a shape, along the shape's axes; plates, discs and rings are flat.

    The rounded ends of a rod do not count.
    """
    size = shape.size
    match shape.kind:
        case "rod" | "cylinder" | "cone":
            return np.array([size[1], size[1], size[0] / 2.0])
        case "capsule":
            return np.array([size[1], size[1], size[0] / 2.0 + size[1]])
        case "disc" | "ring":
            return np.array([size[0], size[0], 0.0])
        case "plate":
            return np.array([size[0], size[1], 0.0]) / 2.0
        case "block":
            return np.array(size) / 2.0
        case "sphere" | "particle":
            return np.full(3, size[0])
        case "ellipsoid":
            return np.array(size)
        case "hull":
            assert shape.hull is not None
            return np.asarray(np.max(np.array(shape.hull.corners), axis=0))
        case "outline":
            assert shape.outline is not None
            return np.array([*(0.5 * np.ptp(polyline(shape.outline), axis=0)), 0.5 * size[0]])
        case _:
            assert_never(shape.kind)


AROUND = 48  # corners of the base of a cone that is drawn as a polyhedron


def triangles_of(solid: Cone | Polyhedron | Prism) -> Array:
    """The surface (n, 3, 3) of a cone, a polyhedron or a prism, as triangles that are counterclockwise from outside."""
    if isinstance(solid, Prism):
        return prism_triangles(solid)
    if isinstance(solid, Polyhedron):
        return np.array(solid.corners)[fans(solid.faces)]
    base, half = solid.radius * circle(np.linspace(0.0, 2.0 * np.pi, AROUND + 1)), solid.length / 2.0
    rim = np.column_stack([base, np.full(len(base), -half)])
    center, tip = np.tile([0.0, 0.0, -half], (AROUND, 1)), np.tile([0.0, 0.0, half], (AROUND, 1))
    sides, floor = np.stack([rim[:-1], rim[1:], tip], axis=1), np.stack([rim[1:], rim[:-1], center], axis=1)
    return np.vstack([sides, floor])


def diameters(radius: float, heights: tuple[float, ...], *, crossed: bool = False) -> list[Array]:
    """Lines (2, 3) along x at heights z, and along y with `crossed`: they show how something round turns about z."""
    lines = [np.array([[-radius, 0.0, z], [radius, 0.0, z]]) for z in heights]
    if crossed:
        lines += [np.array([[0.0, -radius, z], [0.0, radius, z]]) for z in heights]
    return lines


def meridian(width: float, height: float) -> Array:
    """An ellipse (33, 3) about y, slightly outside a ball or an ellipsoid of these radii: it shows how this turns."""
    x, z = (1.005 * np.array([width, height]) * circle(np.linspace(0.0, 2.0 * np.pi, 33))).T
    return np.column_stack([x, 0.0 * x, z])


def skeleton(part: Part) -> list[Array]:
    """Lines (2, 3) that stand for a part without shapes: from its origin to its points, or else its mass center."""
    ends = [pose.position for pose in part.points.values()] or [part.center]
    return [np.array([np.zeros(3), end]) for end in ends if np.any(end)]


def is_invisible(part: Part) -> bool:
    """Whether a part has neither mass nor shape nor mesh: it only carries coordinates, and is not drawn."""
    return part.mass == 0.0 and not part.shapes and not part.meshes
