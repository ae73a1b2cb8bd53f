"""The list of 3-D primitives of a mechanism: solids and lines that move with a part.

They are made of the shapes, sizes and colors that pictures, Rerun and RViz share.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbd_sim.base.geometry.pose import Array, Pose, identity_pose
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
from mbd_sim.pictures.shapes.meshes import part_triangles
from mbd_sim.pictures.shapes.palette import Color
from mbd_sim.pictures.shapes.solids import (
    LINE_WIDTH,
    POINT_MASS_RADIUS,
    Ball,
    Cylinder,
    Solid,
    diameters,
    is_invisible,
    meridian,
    skeleton,
    solid_of,
)

MARK: Color = (18, 20, 26)


@dataclass(frozen=True, eq=False)
class Lines:
    """Segments (n, 2, 3) in m in the frame of the primitive, `width` m wide."""

    segments: Array
    width: float


@dataclass(frozen=True, eq=False)
class Triangles:
    """Triangles (n, 3, 3) in m in the frame of the primitive."""

    corners: Array


@dataclass(frozen=True, eq=False)
class Primitive:
    """Something that moves with a part, or with ground, at a pose in its frame."""

    part: str
    pose: Pose
    form: Solid | Lines | Triangles
    color: Color


def primitives_of(mechanism: Mechanism, size: float) -> list[Primitive]:
    """All primitives of a mechanism, whose length is `size` m: its parts, joints, motors and bushings."""
    return [
        *(one for part in mechanism.parts.values() for one in _of_part(mechanism, part, size)),
        *(one for joint in mechanism.all_joints.values() for one in _of_joint(mechanism, joint, size)),
        *_housings(mechanism, size),
    ]


def _of_part(mechanism: Mechanism, part: Part, size: float) -> list[Primitive]:
    if is_invisible(part):
        return []
    color = palette.part_colors(mechanism)[part.name]
    if meshes := part_triangles(part, mechanism.source.file):
        return [
            Primitive(
                part.name,
                identity_pose(),
                Triangles(corners),
                palette.from_hex(mesh.color) if mesh.color else palette.lit(color),
            )
            for mesh, corners in meshes
        ]
    if part.shapes:
        return [one for shape in part.shapes if not shape.hole for one in _of_shape(part.name, shape, color)]
    center = Pose(part.center, np.eye(3))
    found = [Primitive(part.name, center, Ball(POINT_MASS_RADIUS * size), palette.lit(color))]
    if lines := skeleton(part):
        form = Lines(np.array(lines), 2.0 * LINE_WIDTH * size)
        found.append(Primitive(part.name, identity_pose(), form, color))
    return found


def _of_shape(part: str, shape: Shape, part_color: Color) -> list[Primitive]:
    color = palette.from_hex(shape.color) if shape.color else palette.lit(part_color)
    form = solid_of(shape)
    found = [Primitive(part, shape.pose, form, color)]
    marks: list[Array] = []
    match form:
        case Cylinder(radius=radius, disc=disc):
            marks = diameters(radius, (-form.mark_height, form.mark_height), crossed=disc)
        case Ball(radius, particle=False):
            circle = meridian(radius)
            marks = list(np.stack([circle[:-1], circle[1:]], axis=1))
        case _:
            return found
    if marks:
        found.append(Primitive(part, shape.pose, Lines(np.array(marks), 0.04 * radius), MARK))
    return found


def _of_joint(mechanism: Mechanism, joint: Joint, size: float) -> list[Primitive]:
    """A pin along a revolute axis, a rail along a prismatic one, a ball for other joints."""
    radius = joint_radius(mechanism, joint, size)
    color = palette.DRIVEN if joint.drive else palette.STEEL if joint.parent == GROUND else palette.JOINT
    match joint.type:
        case "fixed" | "free":
            return []
        case "revolute":
            form: Solid = Cylinder(4.4 * radius, radius)
        case "prismatic":
            form = Cylinder(0.5 * size, 0.3 * radius)
        case _:
            return [Primitive(joint.parent, joint.parent_pose, Ball(1.3 * radius), color)]
    return [Primitive(joint.parent, axis_frame(joint), form, color)]


def _housings(mechanism: Mechanism, size: float) -> list[Primitive]:
    housings = [
        *(
            (motor_housing(mechanism, joint, coordinate, size), palette.DRIVEN)
            for _, joint, coordinate in driven_coordinates(mechanism)
        ),
        *((bushing_ring(bushing, size), palette.DAMPER) for bushing in shown_bushings(mechanism)),
    ]
    return [Primitive(one.part, one.pose, Cylinder(one.length, one.radius), color) for one, color in housings]
