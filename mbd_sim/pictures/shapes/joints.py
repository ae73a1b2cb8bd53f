"""Sizes, frames and places of joints, motors and arrows that the renderers share.

They say where motors, efforts and bushings are shown, which elements between points are shown as cylinders, at which
scale forces are drawn, and where the arrows of contacts start. They also choose the points of a mechanism that leave a
trace where the user does not name others.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.base.geometry.rotation import aligning_z
from mbd_sim.mechanism.elements.actuators import CoordinatePort
from mbd_sim.mechanism.elements.constraints import Cable, Distance
from mbd_sim.mechanism.elements.forces import Bushing, Damper, Spring
from mbd_sim.mechanism.elements.joint_types import JointCoordinate
from mbd_sim.mechanism.elements.parts import GROUND, Attachment, Joint, Part
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.values.laws import Varying
from mbd_sim.mechanism.values.source import Location


def joint_radius(mechanism: Mechanism, joint: Joint, size: float) -> float:
    """The radius in m of a joint's marker, slightly larger than the rods it connects so that it is visible.

    :param size: the length in m of the mechanism, which limits the radius.
    """
    parts = [mechanism.parts[name] for name in (joint.parent, joint.child) if name != GROUND]
    rods = [shape.size[1] for part in parts for shape in part.shapes if shape.kind == "rod"]
    return min(max(1.25 * max(rods, default=0.0), 0.012 * size), 0.04 * size)


def axis_frame(joint: Joint) -> Pose:
    """The parent-side frame of a joint rotated so that z is its axis; unchanged for joints without an axis."""
    pose = joint.parent_pose
    return Pose(pose.position, pose.rotation @ aligning_z(joint.axis)) if np.any(joint.axis) else pose


BUSHING_RADIUS = 0.022  # relative to the mechanism's size


class Housing(NamedTuple):
    """A cylinder about z of `pose`, which is its center in the frame of a `part`; lengths in m."""

    part: str
    pose: Pose
    length: float
    radius: float


def has_cylinder(element: Spring | Damper) -> bool:
    """Whether an element between two points is shown as a cylinder: with damping, or a law that stores no energy."""
    return element.damping != 0.0 or (isinstance(element, Spring) and isinstance(element.law, Varying))


def driven_coordinates(mechanism: Mechanism) -> Iterator[tuple[str, Joint, JointCoordinate]]:
    """The name of each actuator and effort on a coordinate, its joint, and the coordinate."""
    owners = {
        name: (joint, coordinate)
        for joint in mechanism.joints.values()
        for name, coordinate in zip(joint.motion_names, joint.kind.coordinates, strict=True)
    }
    at = [(a.name, a.port.coordinate) for a in mechanism.actuators if isinstance(a.port, CoordinatePort)]
    at += [(effort.name, effort.coordinate) for effort in mechanism.efforts]
    for name, coordinate in at:
        yield name, *owners[coordinate]


def coordinate_frame(joint: Joint, coordinate: JointCoordinate) -> tuple[str, Pose]:
    """A frame of a joint whose z axis is the direction of a coordinate: its part, and its pose there."""
    side, part = (joint.child_pose, joint.child) if coordinate.on_child else (joint.parent_pose, joint.parent)
    return part, Pose(side.position, side.rotation @ aligning_z(joint.direction(coordinate)))


def motor_housing(mechanism: Mechanism, joint: Joint, coordinate: JointCoordinate, size: float) -> Housing:
    """The housing of a motor, beside a joint on the axis of a coordinate, on the part in whose axes that is fixed.

    :param size: the length in m of the mechanism.
    """
    (part, frame), radius = coordinate_frame(joint, coordinate), joint_radius(mechanism, joint, size)
    center = frame.position - 4.0 * radius * frame.rotation[:, 2]
    return Housing(part, Pose(center, frame.rotation), 4.0 * radius, 1.8 * radius)


def bushing_ring(bushing: Bushing, size: float) -> Housing:
    """A short cylinder about z of the first frame of a bushing.

    :param size: the length in m of the mechanism.
    """
    radius = BUSHING_RADIUS * size
    return Housing(bushing.first.part, Pose(bushing.first.point, bushing.first_axes), radius, radius)


def shown_bushings(mechanism: Mechanism) -> list[Bushing]:
    """The bushings, without the springs of joints, which are shown as joints."""
    return [bushing for bushing in mechanism.bushings if not bushing.in_joint]


def default_traces(mechanism: Mechanism) -> dict[str, Attachment]:
    """The tips of the parts at the ends of the kinematic chains, by the names of the parts."""
    inboard = {joint.inboard for joint in mechanism.tree_joints()}
    ends = [joint.outboard for joint in mechanism.tree_joints() if joint.outboard not in inboard and not joint.splits]
    return {name: Attachment(name, tip_of(mechanism.parts[name])) for name in ends}


def tip_of(part: Part) -> Array:
    """The point (3,) of a part that leaves a trace, in the part's frame: its point or rod end farthest from the origin.

    For a part with neither, a corner or a point on the rim, which is visible where the mass center would be hidden.
    """
    ends = [pose.position for pose in part.points.values()]
    for shape in part.shapes:
        if shape.kind == "rod":
            half = shape.pose.rotation[:, 2] * shape.size[0] / 2.0
            ends += [shape.pose.position - half, shape.pose.position + half]
    rims = {"block": (0.5, 0.5, 0.5), "plate": (0.5, 0.5), "disc": (1.0,), "ring": (1.0,)}
    if not ends and part.shapes and (factors := rims.get(part.shapes[0].kind)):
        pose, offset = part.shapes[0].pose, np.zeros(3)
        offset[: len(factors)] = np.multiply(factors, part.shapes[0].size)
        return np.asarray(pose.position + pose.rotation @ offset)
    ends.append(part.center)
    return max(ends, key=lambda point: float(np.linalg.norm(point)))


LONG, LONGEST = 0.25, 0.6  # full and largest length of an arrow, relative to the mechanism's size


def weight(mechanism: Mechanism, size: float) -> float:
    """The force in N that an arrow of full length stands for by default: the weight of all parts.

    Without gravity, the force that accelerates the mechanism by its own `size` in m each second squared.
    """
    return mechanism.mass * (float(np.linalg.norm(mechanism.gravity)) or size) or 1.0


def pulls(mechanism: Mechanism, owner: Location) -> bool:
    """Whether a contact is a rope, whose arrow starts at its end. All others push: their arrows end at the contact.

    Inside the body that it pushes, an arrow would be hidden.
    """
    ropes = [one for one in mechanism.constraints if isinstance(one, Distance | Cable) and one.bound == "at_most"]
    return any(owner == ("constraints", rope.name) for rope in ropes)
