"""The parts as symbols of their own: constraints are written on them and then follow any motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from mbd_sim.dynamics.kinematics import LinkMotion, WorldPose
from mbd_sim.dynamics.links import Link
from mbd_sim.dynamics.spatial_algebra import constant, skew
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.records import GROUND


@dataclass(frozen=True, eq=False)
class Frame:
    """A frame of a part, all in ground's axes: its origin, axes, velocity of the origin, and angular velocity."""

    position: ca.SX
    rotation: ca.SX
    velocity: ca.SX
    omega: ca.SX


class Bodies:
    """Symbols for the pose (12,) and the twist (6,) = [ω; v] at the part's origin, in ground's axes, of each link."""

    def __init__(self, links: Sequence[Link]) -> None:
        self._index = {link.joint.outboard: index for index, link in enumerate(links)}
        self._inboard = {link.joint.outboard: link.joint.inboard for link in links if link.joint.type != "free"}
        self.poses = [ca.SX.sym(f"pose{index}", 12) for index in range(len(links))]
        self.twists = [ca.SX.sym(f"twist{index}", 6) for index in range(len(links))]

    def frame(self, part: str, point: Array, axes: Array | None = None) -> Frame:
        """The frame at a point (3,) of a part, with axes (3, 3) in the part's."""
        turn = constant(np.eye(3) if axes is None else axes)
        if part == GROUND:
            return Frame(constant(point), turn, ca.SX(3, 1), ca.SX(3, 1))
        pose, twist = self.poses[self._index[part]], self.twists[self._index[part]]
        rotation = ca.reshape(pose[3:], 3, 3)
        arm = rotation @ constant(point)
        return Frame(pose[:3] + arm, ca.sparsify(rotation @ turn), twist[3:] - skew(arm) @ twist[:3], twist[:3])

    def base(self, one: str, other: str) -> str:
        """The part farthest from ground that carries both of two parts in the tree.

        What flies freely is carried by nothing; where the two have no carrier in common, it is the last of the first.
        """
        carriers = [one]
        while carriers[-1] in self._inboard:
            carriers.append(self._inboard[carriers[-1]])
        while other not in carriers and other in self._inboard:
            other = self._inboard[other]
        return other if other in carriers else carriers[-1]

    def rate(self, expressions: ca.SX) -> ca.SX:
        """The time derivatives (m,) of expressions of the poses."""
        rates = [
            ca.vertcat(twist[3:], ca.vec(skew(twist[:3]) @ ca.reshape(pose[3:], 3, 3)))
            for pose, twist in zip(self.poses, self.twists, strict=True)
        ]
        return ca.sparsify(ca.jacobian(expressions, ca.vertcat(*self.poses)) @ ca.vertcat(ca.SX(0, 1), *rates))


def flat_pose(pose: WorldPose) -> ca.SX:
    """(12,): position and rotation, column by column."""
    return ca.vertcat(pose.position, ca.vec(pose.rotation))


def world_twist(link: Link, motion: LinkMotion, pose: WorldPose) -> ca.SX:
    """The twist (6,) of a link's part at the part's origin, in ground's axes."""
    to_world = to_ground(link, pose)
    angular, linear = motion.velocity[:3], motion.velocity[3:]
    return ca.vertcat(to_world @ angular, to_world @ (linear - skew(constant(link.part.position)) @ angular))


def own_wrench(link: Link, pose: WorldPose, wrench: ca.SX) -> ca.SX:
    """A wrench (6, k) at a part's origin in ground's axes, as one at the link's origin in its own axes."""
    turn = to_ground(link, pose).T
    force = turn @ wrench[3:, :]
    return ca.vertcat(turn @ wrench[:3, :] + skew(constant(link.part.position)) @ force, force)


def to_ground(link: Link, pose: WorldPose) -> ca.SX:
    """The rotation (3, 3) from a link's axes to ground's."""
    return ca.sparsify(pose.rotation @ constant(link.part.rotation.T))
