"""The links of a planar mechanism in one position: where they are, and how they move, in complex numbers.

Parts that are fixed to each other are one link. A point p of a link, in the plane of the mechanism, moves with the
velocity V + i ω p and the acceleration A + (i α - ω²) p, V and A being those of its point at the origin of the plane.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mbd_sim.base.errors import InputError
from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.base.short_repr import record
from mbd_sim.mechanism.elements.parts import GROUND, Joint
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.pictures.drawing.sheet import Projection, view_of
from mbd_sim.studies.kinematic_analysis.motion import DrivenMotion, PointFunctions

ROUND_OFF = 1e-9


@record
class RigidLink:
    """Parts that move together, named by the first of them, and their motion; in m, rad and s.

    `place` and `turn` are the origin and the unit number of the angle of the first part.
    """

    name: str
    parts: tuple[str, ...]
    place: complex
    turn: complex
    velocity: complex  # of the point at the origin of the plane
    omega: float
    acceleration: complex
    alpha: float

    def velocity_of(self, point: complex) -> complex:
        """The velocity of the link's point that is at a place."""
        return self.velocity + 1j * self.omega * point

    def acceleration_of(self, point: complex) -> complex:
        """Its acceleration."""
        return self.acceleration + (1j * self.alpha - self.omega**2) * point


@record
class PlaneJoint:
    """A joint of two links, at a `place`; a slider has a unit `direction`, other joints 0."""

    name: str
    links: tuple[str, str]
    place: complex
    direction: complex


@record
class PlaneSnapshot:
    """The links by name, ground first, and the revolute and prismatic joints between them; `size` of the mechanism."""

    links: Mapping[str, RigidLink]
    joints: tuple[PlaneJoint, ...]
    size: float
    speed: float


class PlanarDrive:
    """A driven motion of a planar mechanism, from which snapshots are taken."""

    def __init__(self, motion: DrivenMotion) -> None:
        """Find the plane and the links.

        :raises InputError: the mechanism does not move in a plane.
        """
        self.motion, mechanism = motion, motion.mechanism
        self._frames = {name: PointFunctions(motion.system, name) for name in mechanism.parts}
        poses = {name: frame.pose(motion.q[0]) for name, frame in self._frames.items()}
        self.view: Projection = view_of(mechanism, poses)
        if not self.view.planar:
            raise InputError(
                f"{mechanism.name} does not move in a plane", "Instant centers are defined for planar mechanisms."
            )
        self.groups = _rigid_groups(mechanism)

    def at(self, row: int) -> PlaneSnapshot:
        """The position and motion in a row.

        :raises InputError: the row is a dead point, where velocities are undefined.
        """
        motion = self.motion
        if not np.all(np.isfinite(motion.u[row])):
            raise InputError("velocities are undefined at a dead point", "Choose another position.")
        poses = {name: frame.pose(motion.q[row]) for name, frame in self._frames.items()}
        poses[GROUND] = Pose(np.zeros(3), np.eye(3))
        links = {group[0]: self._link(group, poses[group[0]], row) for group in self.groups}
        owners = {part: group[0] for group in self.groups for part in group}
        joints = []
        for joint in motion.mechanism.all_joints.values():
            ends = (owners[joint.parent], owners[joint.child])
            if joint.type in ("revolute", "prismatic") and ends[0] != ends[1]:
                joints.append(self._joint(joint, ends, poses))
        speed = motion.speed
        return PlaneSnapshot(links, tuple(joints), float(motion.system.constraints.size), speed)

    def _joint(self, joint: Joint, ends: tuple[str, str], poses: Mapping[str, Pose]) -> PlaneJoint:
        frame = poses[joint.parent] @ joint.parent_pose
        direction = 0j
        if joint.type == "prismatic":
            direction = self._flat(frame.rotation @ joint.axis)
            frame = poses[joint.child] @ joint.child_pose
        return PlaneJoint(joint.name, ends, self._flat(frame.position), direction)

    def _link(self, group: tuple[str, ...], pose: Pose, row: int) -> RigidLink:
        name = group[0]
        if name == GROUND:
            return RigidLink(name, group, 0j, 1.0 + 0j, 0j, 0.0, 0j, 0.0)
        motion = self.motion
        twist, rates = self._frames[name].twist(motion.q[row], motion.u[row], motion.u_rates[row])
        toward = self.view.toward
        omega, alpha = float(twist[3:] @ toward), float(rates[3:] @ toward)
        place = self._flat(pose.position)
        velocity = self._flat(twist[:3]) - 1j * omega * place
        acceleration = self._flat(rates[:3]) - (1j * alpha - omega**2) * place
        turn = self._flat(pose.rotation @ self.view.right)
        return RigidLink(name, group, place, turn, velocity, omega, acceleration, alpha)

    def _flat(self, vector: Array) -> complex:
        return complex(float(vector @ self.view.right), float(vector @ self.view.up))


def _rigid_groups(mechanism: Mechanism) -> list[tuple[str, ...]]:
    """The parts that are fixed to each other, ground's first."""
    groups = [[GROUND], *([name] for name in mechanism.parts)]
    for joint in mechanism.all_joints.values():
        if joint.type == "fixed":
            one, other = (next(g for g in groups if part in g) for part in (joint.parent, joint.child))
            if one is not other:
                one.extend(other)
                groups.remove(other)
    return [tuple(sorted(group, key=lambda name: name != GROUND)) for group in groups]
