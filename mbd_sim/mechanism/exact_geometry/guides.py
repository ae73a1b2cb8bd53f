"""Constraints that close loops, as two joints of a massless part each: then a loop that they close is one of joints.

A point on a line is a ball joint on a slider, one on a plane a ball joint on a planar joint, and a distance is a rod
between two ball joints.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import assert_never

import numpy as np

from mbd_sim.base.geometry import rotation as rot
from mbd_sim.base.geometry.pose import Array, Pose
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
)
from mbd_sim.mechanism.elements.joint_types import JOINT_KINDS, JointType
from mbd_sim.mechanism.elements.parts import Attachment, Joint, Move
from mbd_sim.mechanism.exact_geometry.loop_positions import Loops, Placement
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.values.expression import TimeExpression

NO_AXIS = np.zeros(3)


@dataclass(frozen=True, eq=False)
class Guide:
    """A constraint as a `carrier`, which leads from its first part to a massless one, and a `pin` from there."""

    constraint: Flat | Distance | Cable
    carrier: Joint
    pin: Joint

    def moved(self, carrier: Joint, pin: Joint, place: Placement, held: bool) -> tuple[Constraint, Move]:
        """The constraint after its joints are moved, and by how much it differs from the one before.

        :param held: whether the pin is on the common line, or at the common point, of its loop.
        """
        match self.constraint:
            case Flat():
                return self._moved_flat(self.constraint, carrier, pin, place)
            case Distance() | Cable():
                return self._moved_rod(self.constraint, carrier, pin, place, held)

    def refitted(self, carrier: Joint, pin: Joint) -> tuple[Constraint, Move]:
        """The constraint that new numbers of its joints stand for, and by how much it differs from the one before."""
        start, end = carrier.parent_pose.position, pin.child_pose.position
        shifts = [_distance(start, self.carrier.parent_pose.position), _distance(end, self.pin.child_pose.position)]
        if isinstance(self.constraint, Flat):
            flat, turn = self.constraint, _rotation_between(self.carrier, carrier)
            ends = Attachment(flat.point.part, end), Attachment(flat.base.part, start)
            normals = flat.normals @ turn.T
            angle = float(np.linalg.norm(normals - flat.normals))
            return dataclasses.replace(flat, point=ends[0], base=ends[1], normals=normals), Move(max(shifts), angle)
        rod, length = self.constraint, float(np.linalg.norm(pin.parent_pose.position))
        one, other = (Attachment(at.part, point) for at, point in zip(_ends(rod), (start, end), strict=True))
        move = Move(max(*shifts, abs(length - rod.length.at(0.0))), 0.0)
        exact = TimeExpression(repr(length), {})
        if isinstance(rod, Cable):
            return dataclasses.replace(rod, points=(one, other), length=exact), move
        return dataclasses.replace(rod, first=one, second=other, length=exact), move

    def _moved_flat(self, flat: Flat, carrier: Joint, pin: Joint, place: Placement) -> tuple[Constraint, Move]:
        turn = carrier.parent_pose.rotation
        normals = flat.normals @ turn.T
        center = (place.poses[pin.child] @ pin.child_pose).position
        on_base = (place.poses[carrier.parent].inverse() @ Pose(center, np.eye(3))).position
        base = flat.base.point + normals.T @ (normals @ (on_base - flat.base.point))
        point = pin.child_pose.position
        distance = max(_distance(point, flat.point.point), _distance(base, flat.base.point))
        angle = float(np.linalg.norm(rot.rotation_vector(rot.to_quaternion(turn))))
        changed = dataclasses.replace(
            flat,
            point=Attachment(flat.point.part, point),
            base=Attachment(flat.base.part, base),
            normals=normals,
        )
        return changed, Move(distance, angle)

    def _moved_rod(
        self, rod: Distance | Cable, carrier: Joint, pin: Joint, place: Placement, held: bool
    ) -> tuple[Constraint, Move]:
        """The length stays as it is written: one end moves along the rod, that of the carrier if the pin is held."""
        start, end = (place.poses[carrier.parent] @ carrier.parent_pose), (place.poses[pin.child] @ pin.child_pose)
        rest = (1.0 - rod.length.at(0.0) / _distance(end.position, start.position)) * (end.position - start.position)
        shifts = (rest, np.zeros(3)) if held else (np.zeros(3), -rest)
        parts = (place.poses[carrier.parent], place.poses[pin.child])
        local = (carrier.parent_pose.position, pin.child_pose.position)
        places = [at + part.rotation.T @ shift for at, part, shift in zip(local, parts, shifts, strict=True)]
        ends = _ends(rod)
        one, other = (Attachment(end.part, point) for end, point in zip(ends, places, strict=True))
        distance = max(_distance(point, end.point) for end, point in zip(ends, places, strict=True))
        if isinstance(rod, Cable):
            return dataclasses.replace(rod, points=(one, other)), Move(distance, 0.0)
        return dataclasses.replace(rod, first=one, second=other), Move(distance, 0.0)


def guides(mechanism: Mechanism) -> list[Guide]:
    """The guides of a mechanism: its bilateral constraints of points that do not depend on time."""
    constraints = [constraint for found in mechanism.constraints for constraint in _guiding(found)]
    if not constraints:
        return []
    poses = Loops(mechanism).at_start().poses
    return [_flat(one, poses) if isinstance(one, Flat) else _rod(one, poses) for one in constraints]


def with_guides(mechanism: Mechanism, found: list[Guide]) -> Mechanism:
    """The mechanism with the joints of guides."""
    carriers = {guide.carrier.name: guide.carrier for guide in found}
    pins = {guide.pin.name: guide.pin for guide in found}
    return dataclasses.replace(
        mechanism,
        joints={**mechanism.joints, **carriers},
        tree=(*mechanism.tree, *carriers),
        closing={**mechanism.closing, **pins},
    )


def _guiding(constraint: Constraint) -> Iterator[Flat | Distance | Cable]:
    match constraint:
        case Flat(law=None):
            yield constraint
        case Distance(law=None, length=length) if not length.variables:
            yield constraint
        case Cable(law=None, length=length, points=(_, _)) if not length.variables:
            yield constraint
        case Flat() | Distance() | Cable() | Surface() | Coupling() | Rolling() | KnifeEdge() | Clutch():
            pass
        case _:
            assert_never(constraint)


def _ends(rod: Distance | Cable) -> tuple[Attachment, Attachment]:
    return (rod.points[0], rod.points[1]) if isinstance(rod, Cable) else (rod.first, rod.second)


def _flat(flat: Flat, poses: Mapping[str, Pose]) -> Guide:
    foot = _relative(poses, flat.base.part, flat.point) - flat.base.point
    base = Pose(flat.base.point, np.eye(3))
    axis = rot.unit(flat.normals[0] if len(flat.normals) == 1 else np.cross(flat.normals[0], flat.normals[1]))
    body = f"constraints/{flat.name}"
    if len(flat.normals) == 1:
        second = rot.aligning_z(axis)[:, 0]
        start = np.array([second @ foot, np.cross(axis, second) @ foot, 0.0])
        carrier = _joint(f"{body}/plane", "planar", flat.base.part, body, base, axis, second, start)
    else:
        carrier = _joint(
            f"{body}/line", "prismatic", flat.base.part, body, base, axis, NO_AXIS, np.array([axis @ foot])
        )
    return Guide(flat, carrier, _ball(f"{body}/pin", body, np.zeros(3), flat.point))


def _rod(rod: Distance | Cable, poses: Mapping[str, Pose]) -> Guide:
    first, second = _ends(rod)
    along = _relative(poses, first.part, second) - first.point
    body = f"constraints/{rod.name}"
    direction = rot.unit(along) if along.any() else np.array([0.0, 0.0, 1.0])
    start = rot.to_quaternion(rot.aligning_z(direction))
    base = Pose(first.point, np.eye(3))
    carrier = _joint(f"{body}/start", "spherical", first.part, body, base, NO_AXIS, NO_AXIS, start)
    end = np.array([0.0, 0.0, rod.length.at(0.0)])
    return Guide(rod, carrier, _ball(f"{body}/end", body, end, second))


def _relative(poses: Mapping[str, Pose], part: str, attachment: Attachment) -> Array:
    """A point of another part in the frame of a part."""
    place = poses[attachment.part] @ Pose(attachment.point, np.eye(3))
    return (poses[part].inverse() @ place).position


def _ball(name: str, body: str, at: Array, end: Attachment) -> Joint:
    joint = _joint(name, "spherical", body, end.part, Pose(at, np.eye(3)), NO_AXIS, NO_AXIS, np.zeros(0))
    return dataclasses.replace(joint, child_pose=Pose(end.point, np.eye(3)))


def _joint(
    name: str, kind: JointType, parent: str, child: str, at: Pose, axis: Array, second: Array, start: Array
) -> Joint:
    none, free = np.zeros(0), (False,) * JOINT_KINDS[kind].nv
    own = Pose(np.zeros(3), np.eye(3))
    return Joint(
        name, kind, parent, child, at, own, axis, second, start, none, none, none, none, fixed_in_assembly=free
    )


def _rotation_between(before: Joint, after: Joint) -> Array:
    """The least rotation (3, 3) from the axis of a carrier to its axis on the same part after a change."""
    one, other = before.parent_pose.rotation @ before.axis, after.parent_pose.rotation @ after.axis
    axis = np.cross(one, other)
    sine = float(np.linalg.norm(axis))
    return rot.about(axis / sine, float(np.arctan2(sine, one @ other))) if sine else np.eye(3)


def _distance(one: Array, other: Array) -> float:
    return float(np.linalg.norm(one - other))
