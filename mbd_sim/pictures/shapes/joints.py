"""Sizes, frames and places of joints, motors, arrows and traces that all pictures share."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.base.geometry.rotation import aligning_z
from mbd_sim.mechanism.elements.actuators import CoordinatePort
from mbd_sim.mechanism.elements.constraints import Cable, Distance
from mbd_sim.mechanism.elements.forces import Damper, Spring
from mbd_sim.mechanism.elements.joint_types import JointCoordinate
from mbd_sim.mechanism.elements.parts import GROUND, Attachment, Joint, Part
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.spanning_tree import split_reference
from mbd_sim.mechanism.values.laws import Varying
from mbd_sim.mechanism.values.source import Location


def joint_radius(mechanism: Mechanism, joint: Joint, size: float) -> float:
    """The radius in m of a joint's marker, slightly larger than the rods it connects so that it is visible.

    :param size: the length in m of the mechanism, which limits the radius.
    """
    parts = [mechanism.parts[name] for name in (joint.parent, joint.child) if name != GROUND]
    rods = [shape.size[1] for part in parts for shape in part.shapes if shape.kind == "rod"]
    return min(max(1.25 * max(rods, default=0.0), 0.012 * size), 0.04 * size)


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


def traced_points(mechanism: Mechanism, names: Sequence[str]) -> list[tuple[str, Array]]:
    """The part and the point (3,) in its frame in m for each of some names: `part.point`, or a part for its end.

    :raises InputError: there is no such part or point.
    """
    points, found = {name: part.points for name, part in mechanism.parts.items()}, []
    for name in names:
        part, point = split_reference(name, points)
        found.append((part, points[part][point].position if point else np.array(tip_of(mechanism.parts[part]))))
    return found


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
