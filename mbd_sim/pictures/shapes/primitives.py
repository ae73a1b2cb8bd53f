"""What a mechanism looks like in space: the list of primitives that Rerun, RViz and other viewers draw.

A `Primitive` is a solid, lines or a mesh, fixed in a part or in ground: `primitives` gives those of parts, joints,
motors and bushings, `wires` those of the curves and surfaces on which points lie. A `Connector` leads from point to
point of parts, which a viewer places anew for each state: `connectors` gives springs, dampers, cylinders, rods and
ropes. Each has its size in m, its color, and the element to which it belongs. A viewer translates the forms; it decides
nothing about a mechanism. What depends on the state, such as forces, contacts and traces, is not in the lists.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, assert_never

import numpy as np

from mbd_sim.base.geometry.pose import Array, Pose, identity_pose
from mbd_sim.base.geometry.rotation import aligning_z
from mbd_sim.mechanism.contents import line_ports
from mbd_sim.mechanism.elements.constraints import (
    Cable,
    Clutch,
    Constraint,
    Coupling,
    Distance,
    Flat,
    KnifeEdge,
    Rolling,
    Surface,
    is_one_sided,
)
from mbd_sim.mechanism.elements.forces import (
    AppliedEffort,
    AppliedForce,
    AppliedPotential,
    Bushing,
    Damper,
    ForceElement,
    Spring,
)
from mbd_sim.mechanism.elements.parts import GROUND, Attachment, Joint, Mesh, Part, Polyhedron
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.values.laws import Linear
from mbd_sim.pictures.shapes import palette
from mbd_sim.pictures.shapes.extent import Extent
from mbd_sim.pictures.shapes.joints import coordinate_frame, driven_coordinates, has_cylinder, joint_radius
from mbd_sim.pictures.shapes.palette import Color
from mbd_sim.pictures.shapes.solids import (
    LINE_WIDTH,
    POINT_MASS_RADIUS,
    Box,
    Cone,
    Cylinder,
    Ellipsoid,
    Prism,
    Ring,
    Rod,
    Solid,
    Sphere,
    circle,
    diameters,
    is_invisible,
    meridian,
    skeleton,
    solid_of,
    spiral,
)

if TYPE_CHECKING:
    from mbd_sim.simulation.model.model import Model

MARK_COLOR: Color = (18, 20, 26)
AXIS_HALF_LENGTH = 9.0  # relative to the joint's radius
BUSHING_RADIUS, COIL_RADIUS, CYLINDER_RADIUS = 0.022, 0.032, 0.02  # relative to the mechanism's size
SLENDER_COIL, SLENDER_CYLINDER = 0.16, 0.05  # largest radius, relative to the length at the start
HALF_LENGTH = 0.7  # of the line on which a point is constrained to lie, relative to the mechanism's size
ANCHOR_DISTANCE = 0.35  # from the range of a slide to the far end of its spring, relative to the mechanism's size
TOWARD_EYE = np.array([0.55, -1.0, 0.5])  # the direction from which the outline of a surface is found


@dataclass(frozen=True, eq=False)
class Lines:
    """Lines through points (n, 3) in m, of a `radius` in m, or as thin as they can be seen where it is 0."""

    strips: tuple[Array, ...]
    radius: float = 0.0


Form = Solid | Lines | Mesh
Kind = Literal["springs", "dampers", "actuators", "constraints"]


@dataclass(frozen=True, eq=False)
class Primitive:
    """A form in the frame of `part`, or of ground, that moves with it.

    Solids are centered on `pose` and about its z axis, lines and meshes are in its frame. `kind` is the kind of the
    element that it shows, and `path` is unique among those of the part and kind: the element's name and that of the
    piece, for the shapes of a part the latter. A `hole` is a solid that is taken away.
    """

    kind: Literal["parts", "joints", "actuators", "bushings", "wires"]
    path: tuple[str, ...]
    part: str
    pose: Pose
    form: Form
    color: Color
    hole: bool = False


@dataclass(frozen=True, eq=False)
class Connector:
    """A coil, a cylinder with its rod, or straight lines, through `points` of parts, of a `radius` in m.

    `kind` is the kind of the element that it shows. Lines with `slackens` belong to a one-sided constraint, which need
    not be taut.
    """

    kind: Kind
    name: str
    points: tuple[Attachment, ...]
    form: Literal["coil", "cylinder", "line"]
    radius: float
    color: Color
    slackens: bool = False


def primitives(mechanism: Mechanism, extent: Extent, draws_mesh: Callable[[Mesh], bool]) -> list[Primitive]:
    """All primitives of a mechanism, without `wires`.

    :param draws_mesh: whether the viewer can draw a mesh; a part without any such mesh is drawn by its shapes.
    """
    found: list[Primitive] = []
    colors = palette.part_colors(mechanism)
    for part in mechanism.parts.values():
        found += _part_primitives(part, colors[part.name], extent.size, draws_mesh)
    for joint in mechanism.all_joints.values():
        parts = [mechanism.parts[name] for name in (joint.parent, joint.child) if name != GROUND]
        if joint.kind.connects and not (joint.kind.slides and any(is_invisible(part) for part in parts)):
            found += _JointPieces(mechanism, joint, extent).all()
    for name, joint, coordinate in driven_coordinates(mechanism):
        (carrier, frame), radius = coordinate_frame(joint, coordinate), joint_radius(mechanism, joint, extent.size)
        beside = Pose(frame.position - 4.0 * radius * frame.rotation[:, 2], frame.rotation)
        motor = Cylinder(4.0 * radius, 1.8 * radius)
        found.append(Primitive("actuators", (name,), carrier, beside, motor, palette.DRIVEN))
    for element in mechanism.force_elements:
        found += _force_primitives(element, extent.size)
    return found


def _part_primitives(part: Part, color: Color, size: float, draws_mesh: Callable[[Mesh], bool]) -> Iterator[Primitive]:
    """Its meshes, or else its shapes; without either, a ball at its mass center and lines to its points."""
    meshes = [mesh for mesh in part.meshes if draws_mesh(mesh)]
    for number, mesh in enumerate(meshes):
        own = palette.from_hex(mesh.color) if mesh.color else palette.lit(color)
        yield Primitive("parts", (f"mesh_{number}",), part.name, mesh.pose, mesh, own)
    for number, shape in enumerate(() if meshes else part.shapes):
        own, name = palette.from_hex(shape.color) if shape.color else palette.lit(color), f"{number}_{shape.kind}"
        solid = solid_of(shape)
        yield Primitive("parts", (name,), part.name, shape.pose, solid, own, shape.hole)
        if not shape.hole and (marks := _marks(solid)) is not None:
            ink = palette.mixed(own, MARK_COLOR, 0.55)
            yield Primitive("parts", (name, "mark"), part.name, shape.pose, marks, ink)
    if not meshes and not part.shapes and part.mass:
        center, ball = Pose(part.center, np.eye(3)), Sphere(POINT_MASS_RADIUS * size)
        yield Primitive("parts", ("center",), part.name, center, ball, palette.lit(color))
        if lines := skeleton(part):
            bars = Lines(tuple(lines), LINE_WIDTH * size)
            yield Primitive("parts", ("points",), part.name, identity_pose(), bars, color)


def _marks(solid: Solid) -> Lines | None:
    """Lines on something round that make its rotation visible; None where they are not needed."""
    match solid:
        case Cylinder(radius=radius, disc=disc):
            height = solid.mark_height
            return Lines(tuple(diameters(radius, (-height, height), crossed=disc)), 0.015 * radius)
        case Ring(radius):
            return Lines(tuple(diameters(radius, (0.0,))), 0.015 * radius)
        case Sphere(radius, particle=False):
            return Lines((meridian(radius, radius),), 0.015 * radius)
        case Ellipsoid(radii):
            return Lines((meridian(radii[0], radii[2]),), 0.015 * min(radii))
        case Cone(length, radius):
            sides = 1.005 * np.array(
                [[-radius, 0.0, -length / 2.0], [0.0, 0.0, length / 2.0], [radius, 0.0, -length / 2.0]]
            )
            return Lines((sides[:2], sides[1:], sides[::2]), 0.015 * radius)
        case Sphere() | Rod() | Box() | Polyhedron() | Prism():
            return None
        case _:
            assert_never(solid)


class _JointPieces:
    """The primitives of a joint in the frame of its parent, which carries it along; z of `frame` is its axis."""

    def __init__(self, mechanism: Mechanism, joint: Joint, extent: Extent) -> None:
        self._joint, self._extent, frame = joint, extent, joint.parent_pose
        if np.any(joint.axis):
            frame = Pose(frame.position, frame.rotation @ aligning_z(joint.axis))
        self._frame, self._radius = frame, joint_radius(mechanism, joint, extent.size)
        if joint.drive:
            self._color = palette.DRIVEN
        elif joint.name in mechanism.closures:
            self._color = palette.CLOSING
        else:
            self._color = palette.STEEL if joint.parent == GROUND else palette.JOINT

    def all(self) -> Iterator[Primitive]:
        """What stands for a joint of its type."""
        joint, radius, size = self._joint, self._radius, self._extent.size
        match joint.type:
            case "revolute":
                yield from self._pin()
            case "screw":
                yield from self._pin()
                around = radius * circle(np.linspace(0.0, 20.0 * np.pi, 400))
                thread = np.column_stack([around, np.linspace(-6.0, 6.0, 400) * radius])
                yield self._piece(Lines((thread,)), "thread")
            case "prismatic" | "cylindrical":
                yield from self._rail()
            case "universal":
                second = Pose(self._frame.position, joint.parent_pose.rotation @ aligning_z(joint.second))
                yield self._piece(Cylinder(4.0 * radius, 0.8 * radius))
                yield self._piece(Cylinder(4.0 * radius, 0.8 * radius), "second", at=second)
            case "planar":
                if self._extent.normal is None:  # else all moves in that plane, and the frame would be in front of it
                    corners = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0), (-1, -1, 0)], dtype=float)
                    yield self._piece(Lines((0.3 * size * corners,)))
            case "spherical":
                yield self._piece(Sphere(1.4 * radius))
                dark = palette.mixed(self._color, (0, 0, 0), 0.4)
                yield self._piece(Ring(1.5 * radius, 0.25 * radius), "socket", own=dark)
            case "fixed" | "free":
                return
            case _:
                assert_never(joint.type)

    def _pin(self) -> Iterator[Primitive]:
        """A pin with its axis; on ground with a bearing on both sides, and with a collar where it is driven."""
        radius, half = self._radius, AXIS_HALF_LENGTH * self._radius
        yield self._piece(Cylinder(4.4 * radius, radius))
        pale = palette.mixed(self._color, palette.BACKGROUND, 0.35)
        yield self._piece(Lines((np.array([[0.0, 0.0, -half], [0.0, 0.0, half]]),)), "axis", own=pale)
        if self._joint.parent == GROUND:
            for name, side in (("near", -1.9), ("far", 1.9)):
                yield self._piece(Cylinder(0.6 * radius, 2.1 * radius), "bearing", name, at=self._along(side * radius))
        if self._joint.drive:
            yield self._piece(Ring(2.0 * radius, 0.55 * radius), "motor")
        if np.any(self._joint.stiffness) or self._joint.spring is not None:
            windings = radius * spiral(1.6, 4.0, 2.5)
            line = np.column_stack([windings, np.full(len(windings), 2.4 * radius)])
            yield self._piece(Lines((line,)), "spring", own=palette.SPRING)

    def _rail(self) -> Iterator[Primitive]:
        """A rail as long as the travel, with stops at its ends."""
        size, radius = self._extent.size, 0.35 * self._radius
        low, high = self._extent.travel.get(self._joint.name, (-0.25 * size, 0.25 * size))
        low, high = low - 0.12 * size, high + 0.12 * size
        yield self._piece(Cylinder(high - low, radius), at=self._along(0.5 * (low + high)))
        for name, end in (("near", low), ("far", high)):
            yield self._piece(Cylinder(radius, 2.5 * radius), "ends", name, at=self._along(end))

    def _along(self, distance: float) -> Pose:
        return Pose(self._frame.position + distance * self._frame.rotation[:, 2], self._frame.rotation)

    def _piece(self, form: Form, *name: str, at: Pose | None = None, own: Color | None = None) -> Primitive:
        joint = self._joint
        return Primitive("joints", (joint.name, *name), joint.parent, at or self._frame, form, own or self._color)


def _force_primitives(element: ForceElement, size: float) -> Iterator[Primitive]:
    match element:
        case Bushing(first=first, in_joint=False):
            ring = Cylinder(BUSHING_RADIUS * size, BUSHING_RADIUS * size)
            pose = Pose(first.point, element.first_axes)
            yield Primitive("bushings", (element.name,), first.part, pose, ring, palette.DAMPER)
        case Bushing():
            return  # the spring of a joint, which is drawn
        case Spring() | Damper():
            return  # a connector
        case AppliedForce():
            return  # an arrow, which depends on the state
        case AppliedEffort():
            return  # drawn like a motor, at its coordinate
        case AppliedPotential():
            return  # has no place
        case _:
            assert_never(element)


def connectors(mechanism: Mechanism, extent: Extent, start: Mapping[str, Pose]) -> list[Connector]:
    """Everything that leads from point to point of parts.

    :param start: the poses of the parts and of ground at the start, where coils and cylinders are slender.
    """
    found: list[Connector] = []

    def coil(kind: Kind, name: str, first: Attachment, second: Attachment) -> Connector:
        radius = min(COIL_RADIUS * extent.size, SLENDER_COIL * length(first, second))
        return Connector(kind, name, (first, second), "coil", radius, palette.SPRING)

    def cylinder(kind: Kind, name: str, first: Attachment, second: Attachment) -> Connector:
        radius = min(CYLINDER_RADIUS * extent.size, SLENDER_CYLINDER * length(first, second))
        return Connector(kind, name, (first, second), "cylinder", radius, palette.DAMPER)

    def length(*ends: Attachment) -> float:
        first, second = (start[end.part].position + start[end.part].rotation @ end.point for end in ends)
        return float(np.linalg.norm(second - first)) or math.inf

    for element in mechanism.two_point_elements:
        if element.elastic:
            found.append(coil("springs", element.name, element.first, element.second))
        if has_cylinder(element):
            found.append(cylinder("dampers", element.name, element.first, element.second))
    for name, port in line_ports(mechanism).items():
        found.append(cylinder("actuators", name, port.first, port.second))
    found += [
        coil("springs", joint.name, *_joint_spring_ends(joint, extent))
        for joint in mechanism.joints.values()
        if joint.type == "prismatic" and (np.any(joint.stiffness) or joint.spring not in (None, Linear(0.0)))
    ]
    for constraint in mechanism.constraints:
        found += _constraint_lines(constraint, extent.size)
    return found


def _joint_spring_ends(joint: Joint, extent: Extent) -> tuple[Attachment, Attachment]:
    """The ends of a prismatic joint's spring: a point beyond the lower end of its travel, and the joint's child."""
    lowest = extent.travel.get(joint.name, (0.0, 0.0))[0]
    axis = joint.parent_pose.rotation @ joint.axis
    anchor = joint.parent_pose.position + (lowest - ANCHOR_DISTANCE * extent.size) * axis
    return Attachment(joint.parent, anchor), Attachment(joint.child, joint.child_pose.position)


def _constraint_lines(constraint: Constraint, size: float) -> Iterator[Connector]:
    """A rod or rope; other constraints show in the motion, or are points that touch something."""
    match constraint:
        case Distance(first=first, second=second):
            points, radius = (first, second), 0.007 * size
            color = palette.ROPE if constraint.bound == "at_most" else palette.CLOSING
        case Cable(points=points):
            radius, color = 0.005 * size, palette.ROPE
        case Flat() | Surface() | Coupling() | Rolling() | KnifeEdge() | Clutch():
            return
        case _:
            assert_never(constraint)
    slackens = constraint.law is not None
    yield Connector("constraints", constraint.name, points, "line", radius, color, slackens)


def wires(model: Model, extent: Extent) -> list[Primitive]:
    """The curves and surfaces on which points lie, as they are at the start, and the straight lines.

    In a plane mechanism, surfaces that are touched from one side are outlines in its plane.
    """
    found: list[Primitive] = []
    start = {GROUND: identity_pose(), **model.poses(0.0, model.start)}
    for constraint in model.mechanism.constraints:
        if isinstance(constraint, Flat) and len(constraint.normals) == 2:
            half = HALF_LENGTH * extent.size * np.cross(*constraint.normals)
            lines = Lines((np.array([constraint.base.point - half, constraint.base.point + half]),))
            found.append(_wire(constraint, lines, palette.CURVE))
        if not isinstance(constraint, Surface):
            continue
        from mbd_sim.pictures.shapes.curves import curve_lines, section_lines, surface_lines

        carrier, base = start[constraint.base.part], Pose(constraint.base.point, constraint.axes)
        point = (carrier.inverse() @ start[constraint.point.part] @ Pose(constraint.point.point, np.eye(3))).position
        is_surface = len(constraint.equations) == 1
        if is_one_sided(constraint) and extent.normal is not None:
            drawn = section_lines(constraint, point, base, carrier.rotation.T @ extent.normal)
        elif is_surface:
            drawn = surface_lines(constraint, point, base, TOWARD_EYE)
        else:
            drawn = curve_lines(constraint, point, base)
        strips = tuple(line.points for line in drawn if line.kind != "outline" and len(line.points) > 1)
        if strips:
            radius, color = (0.0, palette.CURVE) if is_surface else (LINE_WIDTH * extent.size, palette.CLOSING)
            found.append(_wire(constraint, Lines(strips, radius), color))
    return found


def _wire(constraint: Flat | Surface, lines: Lines, color: Color) -> Primitive:
    return Primitive("wires", (constraint.name,), constraint.base.part, identity_pose(), lines, color)
