"""Shapes as paths: bars with round ends, shaded blocks and cylinders, and rings around other parts."""

from __future__ import annotations

from dataclasses import replace
from typing import assert_never

import numpy as np

from mbd_sim.base.geometry.convex_hull import face_normals
from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.base.geometry.rotation import unit_or_zero
from mbd_sim.mechanism.elements.parts import Polyhedron, Shape
from mbd_sim.pictures.drawing.sheet import (
    BODIES,
    INK,
    LINE,
    WHITE,
    ScaledView,
    SheetPath,
    arc,
    fill_color,
    outline_color,
)
from mbd_sim.pictures.shapes.palette import Color, mixed
from mbd_sim.pictures.shapes.solids import (
    Box,
    Cone,
    Cylinder,
    Ellipsoid,
    Prism,
    Ring,
    Rod,
    Sphere,
    solid_of,
)

BAR, MAX_BAR, TUBE = 3.6, 5.5, 9.5  # pt, half widths: of rods, from and to; and of rods on which something slides
DOT, MAX_DOT = 5.0, 11.0  # pt
ROUNDING = 3.0  # pt


def shape_paths(page: ScaledView, shape: Shape, pose: Pose, color: Color, tube: bool = False) -> list[SheetPath]:
    """The paths of a shape of a part whose frame is at `pose` in ground's.

    :param tube: draw a rod wide, because something slides in it.
    """
    placed = pose @ shape.pose
    depth = page.depth(placed.position)
    match solid_of(shape):
        case Rod(length, radius):
            half, widest = 0.5 * length * placed.rotation[:, 2], np.inf if shape.kind == "capsule" else MAX_BAR
            ends = page.project(np.array([placed.position - half, placed.position + half]))
            half_width = TUBE if tube else float(np.clip(radius * page.scale, BAR, widest))
            return [_bar(ends, half_width, color, depth, tube)]
        case Sphere(radius, particle=True):
            return [dot(page.project(placed.position), color, depth, radius * page.scale)]
        case Sphere(radius):
            return _sphere(page, placed, radius, color, depth)
        case Ring(radius):
            return _ring(page, placed, radius, color)
        case Cylinder(length, radius, disc):
            return cylinder(page, placed, length, radius, color, shape.hole, spoke=disc)
        case Prism() as prism:
            return _prism(page, placed, prism, color, shape.hole)
        case Box(size):
            return _block(page, placed, np.array(size) / 2.0, color, shape.hole)
        case Cone(length, radius):
            return _cone(page, placed, length, radius, color, shape.hole)
        case Ellipsoid(radii):
            return _ellipsoid(page, placed, np.array(radii), color, shape.hole)
        case Polyhedron() as solid:
            return _polyhedron(page, placed, solid, color, shape.hole)
        case _ as unknown:
            assert_never(unknown)


def dot(at: Array, color: Color, depth: float, radius: float = DOT) -> SheetPath:
    """A particle."""
    fill = mixed(color, INK, 0.25)
    circle = arc(at, float(np.clip(radius, DOT, MAX_DOT)))
    return SheetPath(circle, edge=outline_color(color), fill=fill, closed=True, depth=depth, particle=True)


def cylinder(
    page: ScaledView, pose: Pose, length: float, radius: float, color: Color, hole: bool = False, spoke: bool = False
) -> list[SheetPath]:
    """A cylinder about z of `pose`, which is its center; a `spoke` makes its rotation visible."""
    axis, depth = pose.rotation[:, 2], page.depth(pose.position)
    sign = 1.0 if axis @ page.view.toward >= 0.0 else -1.0
    circle = pose.rotation[:, :2] @ arc(np.zeros(2), radius, count=73).T
    half = sign * 0.5 * length * axis
    near, far = (page.project((pose.position + side * half)[:, None].T + circle.T) for side in (1, -1))
    outline = _outline(page, pose, hull(np.vstack([near, far])), color, hole)
    paths = [outline]
    if abs(float(axis @ page.view.toward)) > 1e-3 and not page.view.planar:
        paths.append(replace(outline, points=near, fill=None if hole else _lit(page, color, sign * axis)))
    if spoke and abs(float(axis @ page.view.toward)) > 0.2:
        hub = pose.position + half
        rim = hub + radius * pose.rotation[:, 0]
        paths.append(SheetPath(page.project(np.array([hub, rim])), edge=mixed(color, INK, 0.3), width=0.8, depth=depth))
    return paths


def _cone(page: ScaledView, pose: Pose, length: float, radius: float, color: Color, hole: bool) -> list[SheetPath]:
    """A cone about z of `pose`, which is half of its height above its base."""
    axis = pose.rotation[:, 2]
    circle = pose.rotation[:, :2] @ arc(np.zeros(2), radius, count=73).T
    base = page.project((pose.position - 0.5 * length * axis)[:, None].T + circle.T)
    tip = page.project(pose.position + 0.5 * length * axis)
    outline = _outline(page, pose, hull(np.vstack([base, tip])), color, hole)
    if axis @ page.view.toward < -1e-3 and not page.view.planar:
        return [outline, replace(outline, points=base, fill=None if hole else _lit(page, color, -axis))]
    return [outline]


def _ellipsoid(page: ScaledView, pose: Pose, radii: Array, color: Color, hole: bool) -> list[SheetPath]:
    """Its outline is an ellipse: the farthest points in all directions of the sheet."""
    axes = page.project((pose.rotation * radii).T)
    directions = arc(np.zeros(2), 1.0, count=73)
    reach = directions @ axes.T
    points = page.project(pose.position) + reach @ axes / np.linalg.norm(reach, axis=1)[:, None]
    outline = _outline(page, pose, points, color, hole)
    if page.view.planar or hole:
        return [outline]
    center = page.project(pose.position)
    shine = center + 0.32 * (points - center) + 0.3 * (points[np.argmax(points @ [-0.8, 1.0])] - center)
    return [outline, replace(outline, points=shine, edge=None, fill=mixed(color, WHITE, 0.78))]


def _polyhedron(page: ScaledView, pose: Pose, solid: Polyhedron, color: Color, hole: bool) -> list[SheetPath]:
    """In the plane its outline, in space the faces toward the eye."""
    corners = np.array(solid.corners)
    points = page.project(pose.position + corners @ pose.rotation.T)
    if page.view.planar:
        return [_outline(page, pose, hull(points), color, hole)]
    normals = face_normals(corners, solid.faces) @ pose.rotation.T
    return [
        replace(
            _outline(page, pose, points[list(face)], color, hole), fill=WHITE if hole else _lit(page, color, normal)
        )
        for face, normal in zip(solid.faces, normals, strict=True)
        if normal @ page.view.toward > 1e-6
    ]


def _outline(page: ScaledView, pose: Pose, points: Array, color: Color, hole: bool) -> SheetPath:
    """The outline of a solid at `pose`, or of a hole."""
    fill, dash = (WHITE, (3.0, 2.0)) if hole else (fill_color(color), ())
    return SheetPath(
        points, edge=outline_color(color), fill=fill, closed=True, dash=dash, depth=page.depth(pose.position)
    )


def hull(points: Array) -> Array:
    """The convex hull (k, 2) of points (n, 2), counterclockwise."""
    ordered = sorted({(round(float(x), 6), round(float(y), 6)) for x, y in points})
    chains: list[list[tuple[float, float]]] = []
    for line in (ordered, ordered[::-1]):
        chain: list[tuple[float, float]] = []
        for p in line:
            while len(chain) > 1 and _turn(chain[-2], chain[-1], p) <= 0.0:
                chain.pop()
            chain.append(p)
        chains.append(chain[:-1])
    return np.array(chains[0] + chains[1] or ordered)


def rounded(corners: Array, radius: float) -> Array:
    """A convex polygon (n, 2), counterclockwise, with rounded corners."""
    points: list[Array] = []
    for before, corner, after in zip(np.roll(corners, 1, axis=0), corners, np.roll(corners, -1, axis=0), strict=True):
        cut = min(radius, 0.45 * float(np.hypot(*(before - corner))), 0.45 * float(np.hypot(*(after - corner))))
        start, stop = corner + cut * unit_or_zero(before - corner), corner + cut * unit_or_zero(after - corner)
        s = np.linspace(0.0, 1.0, 6)[:, None]
        points.append((1 - s) ** 2 * start + 2 * s * (1 - s) * corner + s**2 * stop)
    return np.vstack(points)


def capsule(ends: Array, half: float) -> Array:
    """The outline (n, 2) of a bar with round ends between two points (2, 2)."""
    along = unit_or_zero(ends[1] - ends[0])
    angle = float(np.arctan2(along[1], along[0])) if along.any() else 0.0
    quarter = 0.5 * np.pi
    head = arc(ends[1], half, angle - quarter, angle + quarter, 25)
    tail = arc(ends[0], half, angle + quarter, angle + 3.0 * quarter, 25)
    return np.vstack([head, tail])


def _bar(ends: Array, half: float, color: Color, depth: float, tube: bool) -> SheetPath:
    fill = mixed(color, WHITE, 0.78) if tube else fill_color(color)
    return SheetPath(capsule(ends, half), edge=outline_color(color), fill=fill, closed=True, depth=depth)


def _sphere(page: ScaledView, pose: Pose, radius: float, color: Color, depth: float) -> list[SheetPath]:
    at, projected = page.project(pose.position), max(radius * page.scale, DOT)
    paths = [SheetPath(arc(at, projected), edge=outline_color(color), fill=fill_color(color), closed=True, depth=depth)]
    if not page.view.planar:
        shine = arc(at + 0.3 * projected * np.array([-0.8, 1.0]), 0.32 * projected)
        paths.append(SheetPath(shine, edge=None, fill=mixed(color, WHITE, 0.78), closed=True, depth=depth))
    return paths


def _ring(page: ScaledView, pose: Pose, radius: float, color: Color) -> list[SheetPath]:
    """Two halves, the far one behind the parts inside the ring."""
    circle = arc(np.zeros(2), radius, count=97)
    points = pose.position + circle @ pose.rotation[:, :2].T
    heights = (points - pose.position) @ page.view.toward
    start = int(np.argmin(heights[:-1] ** 2 - 1e-9 * np.arange(96))) if np.ptp(heights) > 1e-9 * radius else 0
    points, heights = np.roll(points[:-1], -start, axis=0), np.roll(heights[:-1], -start)
    points, heights = np.vstack([points, points[:1]]), np.append(heights, heights[0])
    depth, width = page.depth(pose.position), float(np.clip(0.035 * radius * page.scale, 3.5, 6.0))
    rims, fills = [], []
    for half in (slice(0, 49), slice(48, 97)):
        offset = 0.0 if page.view.planar else float(np.mean(heights[half]))
        line = page.project(points[half])
        rims.append(SheetPath(line, edge=outline_color(color), width=width, depth=depth + offset))
        fills.append(SheetPath(line, edge=fill_color(color), width=width - 2.0 * LINE, depth=depth + offset))
    if page.view.planar:
        return rims + fills
    return sorted([*rims, *fills], key=lambda path: (path.depth, -path.width))


def _block(page: ScaledView, pose: Pose, half: Array, color: Color, hole: bool) -> list[SheetPath]:
    depth = page.depth(pose.position)
    paths = []
    for axis in range(3):
        for sign in (1.0, -1.0):
            normal = sign * pose.rotation[:, axis]
            if normal @ page.view.toward < 1e-6:
                continue
            a, b = (np.eye(3)[other] * half[other] for other in ((axis + 1) % 3, (axis + 2) % 3))
            face = sign * np.eye(3)[axis] * half[axis]
            corners = np.array([face + a + b, face - a + b, face - a - b, face + a - b])
            projected = hull(page.project(pose.position + corners @ pose.rotation.T))
            if len(projected) < 3:
                continue
            fill = WHITE if hole else fill_color(color) if page.view.planar else _lit(page, color, normal)
            points = rounded(projected, ROUNDING) if page.view.planar else projected
            paths.append(
                SheetPath(points, edge=outline_color(color), fill=fill, closed=True, depth=depth, layer=BODIES)
            )
    return paths


def _prism(page: ScaledView, pose: Pose, prism: Prism, color: Color, hole: bool) -> list[SheetPath]:
    """The face toward the eye; seen at a slant also the other one, and the sides between them."""
    corners, axis, depth = np.array(prism.corners), pose.rotation[:, 2], page.depth(pose.position)
    facing = float(axis @ page.view.toward)
    half = (0.5 if facing >= 0.0 else -0.5) * prism.height * axis
    near, far = (page.project(pose.position + side * half + corners @ pose.rotation[:, :2].T) for side in (1, -1))
    fill = WHITE if hole else fill_color(color)
    face = SheetPath(near, edge=outline_color(color), fill=fill, closed=True, depth=depth, layer=BODIES)
    if not prism.closed:
        return [SheetPath(near, edge=outline_color(color), width=2.0 * LINE, depth=depth, layer=BODIES)]
    if page.view.planar and abs(facing) > 0.5:
        return [face]
    sides = []
    for one, other in zip(range(len(near)), (*range(1, len(near)), 0), strict=True):
        quad = np.array([near[one], near[other], far[other], far[one]])
        sides.append(replace(face, points=quad, edge=fill, fill=fill))
    return [replace(face, points=far), *sides, replace(face, fill=WHITE if hole else _lit(page, color, half))]


def _lit(page: ScaledView, color: Color, normal: Array) -> Color:
    """The color of a face, lit from the upper left."""
    light = 0.9 * page.view.up + 0.55 * page.view.toward - 0.35 * page.view.right
    share = 0.5 + 0.5 * float(normal @ light) / float(np.linalg.norm(light))
    return mixed(mixed(color, INK, 0.06), WHITE, 0.18 + 0.52 * share)


def _turn(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
