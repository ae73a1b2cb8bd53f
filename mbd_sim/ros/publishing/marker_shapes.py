"""How parts and joints look as markers of RViz; springs, dampers and traces are drawn in `markers`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import assert_never

import numpy as np
from visualization_msgs.msg import Marker

from mbd_sim.base.geometry.pose import Array, Pose, identity_pose
from mbd_sim.files.meshes.mesh_files import resource_uri
from mbd_sim.mechanism.elements.parts import GROUND, Joint, Part, Shape
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.pictures.shapes import palette
from mbd_sim.pictures.shapes.joints import (
    axis_frame,
    bushing_ring,
    driven_coordinates,
    joint_radius,
    motor_housing,
    shown_bushings,
)
from mbd_sim.pictures.shapes.solids import (
    LINE_WIDTH,
    POINT_MASS_RADIUS,
    Ball,
    Box,
    Cylinder,
    Ring,
    Rod,
    circle,
    diameters,
    skeleton,
    solid_of,
)

MARK_COLOR: palette.Color = (18, 20, 26)

Points = tuple[tuple[float, float, float], ...]


@dataclass(frozen=True, eq=False)
class PartMarker:
    """A marker that moves with a part: its namespace and type, pose in the part's frame, scale in m, and color.

    `points`, in m in the marker's frame, are those of a line; `mesh` is the URI of a mesh.
    """

    part: str
    namespace: str
    type: int
    pose: Pose
    scale: tuple[float, float, float]
    color: palette.Color
    points: Points = ()
    mesh: str = ""


def part_markers(mechanism: Mechanism, part: Part, size: float) -> list[PartMarker]:
    """The meshes of a part, or else its shapes; without either, a ball at its mass center and lines to its points.

    :param size: the length in m of the mechanism.
    """
    color = palette.part_colors(mechanism)[part.name]
    if meshes := _mesh_markers(part, mechanism.source.file, color):
        return meshes
    if part.shapes:
        return [marker for shape in part.shapes if not shape.hole for marker in _shape_markers(part.name, shape, color)]
    diameter = 2.0 * POINT_MASS_RADIUS * size
    center = Pose(part.center, np.eye(3))
    markers = [PartMarker(part.name, "parts", Marker.SPHERE, center, (diameter,) * 3, palette.lit(color))]
    if lines := skeleton(part):
        width = (2.0 * LINE_WIDTH * size, 0.0, 0.0)
        markers.append(
            PartMarker(part.name, "parts", Marker.LINE_LIST, identity_pose(), width, color, _points(np.vstack(lines)))
        )
    return markers


def _mesh_markers(part: Part, source: str, part_color: palette.Color) -> list[PartMarker]:
    """The meshes whose files are on this machine. RViz takes the colors of their own materials, which STL has not."""
    markers = []
    for mesh in part.meshes:
        if uri := resource_uri(mesh.file, source):
            color = palette.from_hex(mesh.color) if mesh.color else palette.lit(part_color)
            markers.append(PartMarker(part.name, "parts", Marker.MESH_RESOURCE, mesh.pose, mesh.scale, color, mesh=uri))
    return markers


def _shape_markers(part: str, shape: Shape, part_color: palette.Color) -> list[PartMarker]:
    color = palette.from_hex(shape.color) if shape.color else palette.lit(part_color)

    def marker(
        type_: int, scale: tuple[float, float, float], pose: Pose = shape.pose, points: Points = ()
    ) -> PartMarker:
        return PartMarker(part, "parts", type_, pose, scale, color, points)

    def marks(lines: Sequence[Array], width: float) -> PartMarker:
        points = _points(np.vstack(lines))
        return PartMarker(part, "parts", Marker.LINE_LIST, shape.pose, (width, 0.0, 0.0), MARK_COLOR, points)

    match solid_of(shape):
        case Rod(length, radius):
            axis = shape.pose.rotation[:, 2]
            ends = [Pose(shape.pose.position + sign * length / 2.0 * axis, np.eye(3)) for sign in (-1, 1)]
            balls = [marker(Marker.SPHERE, (2.0 * radius,) * 3, end) for end in ends]
            return [marker(Marker.CYLINDER, (2.0 * radius, 2.0 * radius, length)), *balls]
        case Cylinder(length, radius, disc) as cylinder:
            height = cylinder.mark_height
            lines = diameters(radius, (-height, height), crossed=True)
            body = marker(Marker.CYLINDER, (2.0 * radius, 2.0 * radius, length))
            return [body, marks(lines, (0.04 if disc else 0.06) * radius)]
        case Ring(radius, tube):
            rim = np.column_stack([radius * circle(np.linspace(0.0, 2.0 * np.pi, 49)), np.zeros(49)])
            ring = marker(Marker.LINE_STRIP, (2.0 * tube, 0.0, 0.0), points=_points(rim))
            return [ring, marks(diameters(radius, (0.0,)), 0.04 * radius)]
        case Box(size):
            return [marker(Marker.CUBE, size)]
        case Ball(radius):
            return [marker(Marker.SPHERE, (2.0 * radius,) * 3)]
        case _ as unknown:
            assert_never(unknown)


def joint_markers(mechanism: Mechanism, joint: Joint, size: float) -> list[PartMarker]:
    """A pin along a revolute axis, a rail along a prismatic one, a ball for other joints; none for fixed and free ones.

    :param size: the length in m of the mechanism.
    """
    radius = joint_radius(mechanism, joint, size)
    color = palette.STEEL if joint.parent == GROUND else palette.JOINT
    match joint.type:
        case "fixed" | "free":
            return []
        case "revolute":
            scale = (2.0 * radius, 2.0 * radius, 4.0 * radius)
        case "prismatic":
            scale = (0.6 * radius, 0.6 * radius, 0.5 * size)
        case "screw" | "cylindrical" | "universal" | "planar" | "spherical":
            return [PartMarker(joint.parent, "joints", Marker.SPHERE, joint.parent_pose, (2.6 * radius,) * 3, color)]
        case _:
            assert_never(joint.type)
    return [PartMarker(joint.parent, "joints", Marker.CYLINDER, axis_frame(joint), scale, color)]


def drive_markers(mechanism: Mechanism, size: float) -> list[PartMarker]:
    """A housing on the axis of each coordinate with a motor or an effort, and a ring for each bushing.

    :param size: the length in m of the mechanism.
    """
    housings = [
        ("actuators", motor_housing(mechanism, joint, coordinate, size))
        for _, joint, coordinate in driven_coordinates(mechanism)
    ]
    housings += [("bushings", bushing_ring(bushing, size)) for bushing in shown_bushings(mechanism)]
    markers = []
    for namespace, (part, pose, length, radius) in housings:
        scale, color = (2.0 * radius, 2.0 * radius, length), palette.STEEL
        markers.append(PartMarker(part, namespace, Marker.CYLINDER, pose, scale, color))
    return markers


def _points(points: Array) -> Points:
    return tuple((x, y, z) for x, y, z in points.tolist())
