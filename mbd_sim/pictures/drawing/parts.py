"""The parts of a mechanism as paths: their shapes, bars to points without shapes, centers of mass; and their extent."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.mechanism.elements.constraints import Surface
from mbd_sim.mechanism.elements.parts import Joint, Part, Shape
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.pictures.drawing.mesh_outlines import mesh_paths
from mbd_sim.pictures.drawing.outlines import BAR, capsule, dot, shape_paths
from mbd_sim.pictures.drawing.sheet import (
    INK,
    MARKS,
    WHITE,
    ScaledView,
    SheetPath,
    arc,
    fill_color,
    outline_color,
)
from mbd_sim.pictures.shapes.meshes import part_triangles
from mbd_sim.pictures.shapes.palette import Color, from_hex
from mbd_sim.pictures.shapes.solids import (
    half_sizes,
)

POINTER = 0.4  # width of the bar to a traced point, relative to that of other bars
PIN_BAR = 0.7  # the same for a pin beside the shapes
POINTER_TOLERANCE = 1e-6  # relative distance up to which a point lies on a shape
ROD_TOLERANCE = 1e-6  # relative; largest deviation of a slide from the rod that guides it


def part_paths(page: ScaledView, mechanism: Mechanism, part: Part, pose: Pose, color: Color) -> list[SheetPath]:
    """The meshes of a part, or else its shapes, or else bars from its origin to its points and a dot at its center."""
    if meshes := mesh_paths(page, part, mechanism.source.file, pose, color):
        return meshes
    paths: list[SheetPath] = []
    for shape in sorted(part.shapes, key=lambda shape: shape.hole):
        own_color = from_hex(shape.color) if shape.color else color
        tube = shape.kind == "rod" and is_tube(mechanism, part, shape)
        paths += shape_paths(page, shape, pose, own_color, tube)
    if part.shapes or not part.mass:
        return paths
    center = pose.position + pose.rotation @ part.center
    for point in sorted({tuple(point.position) for point in part.points.values()} | {tuple(part.center)}):
        if np.any(point) and _has_pin(mechanism, part):
            ends = page.project(np.array([pose.position, pose.position + pose.rotation @ np.array(point)]))
            paths.append(
                SheetPath(
                    capsule(ends, 0.7 * BAR),
                    edge=outline_color(color),
                    fill=fill_color(color),
                    closed=True,
                    depth=page.depth(center),
                )
            )
    return [*paths, dot(page.project(center), color, page.depth(center))]


def pin_bar_paths(
    page: ScaledView, mechanism: Mechanism, poses: Mapping[str, Pose], colors: Mapping[str, Color]
) -> list[SheetPath]:
    """Bars from the shapes of parts to their pins beside these, such as the third pin of a coupler that is a rod."""
    paths = []
    for joint in mechanism.all_joints.values():
        ends = ((joint.parent, joint.parent_pose), (joint.child, joint.child_pose))
        for name, at in ends if joint.kind.keeps_point and joint.kind.connects else ():
            if name in mechanism.parts and any(shape.kind == "rod" for shape in mechanism.parts[name].shapes):
                part = mechanism.parts[name]
                paths += pointer_paths(page, part, at.position, poses[name], colors[name], PIN_BAR)
    return paths


def pointer_paths(
    page: ScaledView, part: Part, point: Array, pose: Pose, color: Color, width: float = POINTER
) -> list[SheetPath]:
    """A bar from the nearest shape of a part to a point (3,) in its frame, unless that lies on a shape.

    :param width: relative to that of other bars.
    """
    shapes = [shape for shape in part.shapes if not shape.hole]
    if not shapes or part.meshes:
        return []
    at, gap = min((_nearest(shape, point) for shape in shapes), key=lambda found: found[1])
    if gap <= POINTER_TOLERANCE * float(np.linalg.norm(point - at) + np.linalg.norm(point)):
        return []
    ends = page.project(pose.position + np.array([at, point]) @ pose.rotation.T)
    depth = 0.0 if page.view.planar else page.depth(pose.position + pose.rotation @ at)
    edge, fill = outline_color(color), fill_color(color)
    return [SheetPath(capsule(ends, width * BAR), edge=edge, fill=fill, closed=True, depth=depth)]


def _nearest(shape: Shape, point: Array) -> tuple[Array, float]:
    """The point (3,) of a shape, or of the axis of a rod, next to another point, and the distance of the shape in m."""
    half, radius = half_sizes(shape), 0.0
    if shape.kind == "rod":
        half, radius = np.array([0.0, 0.0, half[2]]), float(shape.size[1])
    local = shape.pose.rotation.T @ (point - shape.pose.position)
    inside = np.clip(local, -half, half)
    return shape.pose.position + shape.pose.rotation @ inside, float(np.linalg.norm(local - inside)) - radius


def mass_center(page: ScaledView, part: Part, pose: Pose, occupied: list[Array]) -> list[SheetPath]:
    """The quartered circle at a part's mass center, unless a dot or another symbol is there.

    :param occupied: points (2,) on the sheet at which there are other symbols.
    """
    at = page.project(pose.position + pose.rotation @ part.center)
    dots = [shape for shape in part.shapes if shape.kind in ("particle", "sphere")]
    hidden = any(np.allclose(shape.pose.position, part.center, atol=1e-9) for shape in dots)
    if part.mass == 0.0 or hidden or not part.shapes or any(np.hypot(*(at - other)) < 11.0 for other in occupied):
        return []
    quarters = [np.vstack([at, arc(at, 4.6, start, start + 0.5 * np.pi, 13)]) for start in (0.0, np.pi)]
    return [
        SheetPath(arc(at, 4.6), edge=INK, fill=WHITE, width=0.9, closed=True, layer=MARKS),
        *(SheetPath(points, edge=None, fill=INK, closed=True, layer=MARKS) for points in quarters),
    ]


def corners(part: Part) -> Array:
    """Points (n, 3) in the part's frame that bound it; the drawn radii of particles and rods do not count."""
    points = [np.array(part.center), *(pose.position for pose in part.points.values())] if part.mass else []
    points += [pose.position for pose in part.points.values()]
    signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
    for shape in part.shapes:
        half = half_sizes(shape)
        if shape.kind == "particle":
            half = np.zeros(3)
        elif shape.kind == "rod":
            half = np.array([0.0, 0.0, half[2]])
        points += list(shape.pose.position + (signs * half) @ shape.pose.rotation.T)
    return np.array(points or [np.zeros(3)])


def span_along(part: Part, into: Pose, axis: Array, kinds: tuple[str, ...] = ()) -> tuple[float, float] | None:
    """The smallest and largest coordinate in m of a part's shapes along `axis` (3,), in the frame `into` of the part.

    :param kinds: the kinds of shapes that count, all if empty. Returns None where there is no such shape.
    """
    shapes = tuple(shape for shape in part.shapes if not kinds or shape.kind in kinds)
    if not shapes:
        return None
    only = Part(part.name, 0.0, part.center, part.inertia, {}, shapes)
    values = (corners(only) - into.position) @ into.rotation @ axis
    return float(values.min()), float(values.max())


def is_tube(mechanism: Mechanism, part: Part, rod: Shape) -> bool:
    """Whether particles slide along a rod of a part: then it is drawn wide."""
    return any(
        joint.child in mechanism.parts and along_rod(joint, rod) and is_point(mechanism.parts[joint.child])
        for joint in mechanism.all_joints.values()
        if joint.parent == part.name and joint.type == "prismatic"
    )


def along_rod(joint: Joint, rod: Shape) -> bool:
    """Whether a sliding joint of a part runs along one of its rods."""
    axis, direction = joint.parent_pose.rotation @ joint.axis, rod.pose.rotation[:, 2]
    aside = np.cross(joint.parent_pose.position - rod.pose.position, direction)
    length = rod.size[0]
    return bool(
        np.linalg.norm(np.cross(axis, direction)) < ROD_TOLERANCE and np.linalg.norm(aside) < ROD_TOLERANCE * length
    )


def is_point(part: Part) -> bool:
    """Whether a part is drawn as a dot."""
    return all(shape.kind == "particle" for shape in part.shapes)


def bounding_points(mechanism: Mechanism, poses: Mapping[str, Pose]) -> Array:
    """Points (n, 3) in ground's frame that bound the mechanism."""
    points = []
    for name, part in mechanism.parts.items():
        meshes = [triangles.reshape(-1, 3) for _, triangles in part_triangles(part, mechanism.source.file)]
        points += [poses[name].position + at @ poses[name].rotation.T for at in (corners(part), *map(_box, meshes))]
    used = [pose.position[None] for pose in mechanism.ground_points.values()]
    used += [joint.parent_pose.position[None] for joint in mechanism.all_joints.values() if joint.parent not in poses]
    bases = [constraint.base for constraint in mechanism.constraints if isinstance(constraint, Surface)]
    used += [(at.point if at.part not in poses else poses[at.part].position)[None] for at in bases]
    return np.vstack([*points, *used] or [np.zeros((1, 3))])


def _box(points: Array) -> Array:
    """The corners (8, 3) of the box around points (n, 3)."""
    low, high = points.min(axis=0), points.max(axis=0)
    return np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1).T


def _has_pin(mechanism: Mechanism, part: Part) -> bool:
    """Whether a joint holds a point of the part at a point of another."""
    return any(
        part.name in (joint.parent, joint.child) and joint.kind.keeps_point for joint in mechanism.all_joints.values()
    )
