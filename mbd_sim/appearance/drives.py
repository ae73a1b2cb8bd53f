"""Where motors, efforts and bushings are shown, and which elements between points are shown as cylinders."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from mbd_sim.appearance.joint_geometry import joint_radius
from mbd_sim.geometry.pose import Pose
from mbd_sim.geometry.rotation import aligning_z
from mbd_sim.mechanism.actuators import CoordinatePort
from mbd_sim.mechanism.force_elements import Bushing, Damper, Spring
from mbd_sim.mechanism.joint_types import JointCoordinate
from mbd_sim.mechanism.laws import Varying
from mbd_sim.mechanism.records import Joint, Mechanism

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
