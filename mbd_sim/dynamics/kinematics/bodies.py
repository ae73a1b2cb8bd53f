"""Symbols for the pose and velocity of each part: constraints are written on them and then hold for any motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.dynamics.kinematics.links import Link
from mbd_sim.dynamics.kinematics.poses import LinkMotion, SymbolicPose
from mbd_sim.dynamics.math.spatial import constant, skew
from mbd_sim.mechanism.elements.parts import GROUND


@dataclass(frozen=True, eq=False)
class BodyFrame:
    """A frame fixed in a part, in ground's axes: its origin, its axes, the velocity of its origin, and ω."""

    position: ca.SX
    rotation: ca.SX
    velocity: ca.SX
    omega: ca.SX


class BodySymbols:
    """Symbols for the pose X_WB (12,) and the velocity V_WB_W (6,) = [ω; v] of each link's part."""

    def __init__(self, links: Sequence[Link]) -> None:
        self._index = {link.joint.outboard: index for index, link in enumerate(links)}
        self._inboard = {link.joint.outboard: link.joint.inboard for link in links if link.joint.type != "free"}
        self.poses = [ca.SX.sym(f"pose{index}", 12) for index in range(len(links))]
        self.twists = [ca.SX.sym(f"twist{index}", 6) for index in range(len(links))]

    def frame(self, part: str, point: Array, axes: Array | None = None) -> BodyFrame:
        """The frame at a `point` (3,) in m of a part, with `axes` (3, 3); both are in the part's frame."""
        R_BC = constant(np.eye(3) if axes is None else axes)
        if part == GROUND:
            return BodyFrame(constant(point), R_BC, ca.SX(3, 1), ca.SX(3, 1))
        pose, twist = self.poses[self._index[part]], self.twists[self._index[part]]
        R_WB = ca.reshape(pose[3:], 3, 3)
        p_BC_W = R_WB @ constant(point)
        velocity = twist[3:] - skew(p_BC_W) @ twist[:3]
        return BodyFrame(pose[:3] + p_BC_W, ca.sparsify(R_WB @ R_BC), velocity, twist[:3])

    def common_carrier(self, one: str, other: str) -> str:
        """The part farthest from ground that carries both of two parts in the tree.

        Nothing carries a part on a free joint. Where the two have no carrier in common, the result is the last carrier
        of the first.
        """
        carriers = [one]
        while carriers[-1] in self._inboard:
            carriers.append(self._inboard[carriers[-1]])
        while other not in carriers and other in self._inboard:
            other = self._inboard[other]
        return other if other in carriers else carriers[-1]

    def rate(self, expressions: ca.SX) -> ca.SX:
        """The time derivatives (m,) of expressions (m,) of the poses."""
        rates = [
            ca.vertcat(twist[3:], ca.vec(skew(twist[:3]) @ ca.reshape(pose[3:], 3, 3)))
            for pose, twist in zip(self.poses, self.twists, strict=True)
        ]
        return ca.sparsify(ca.jacobian(expressions, ca.vertcat(*self.poses)) @ ca.vertcat(ca.SX(0, 1), *rates))


def flat_pose(pose: SymbolicPose) -> ca.SX:
    """A pose as (12,): the position, then the rotation matrix column by column."""
    return ca.vertcat(pose.position, ca.vec(pose.rotation))


def world_twist(link: Link, motion: LinkMotion, X_WB: SymbolicPose) -> ca.SX:
    """V_WB_W (6,) of a link's part."""
    R_WL = rotation_of_link(link, X_WB)
    omega, velocity = motion.V_WL[:3], motion.V_WL[3:]
    return ca.vertcat(R_WL @ omega, R_WL @ (velocity - skew(constant(link.X_LB.position)) @ omega))


def link_wrench(link: Link, X_WB: SymbolicPose, wrench: ca.SX) -> ca.SX:
    """A wrench (6, k) about the part's origin in ground's axes, as F_L (6, k)."""
    R_LW = rotation_of_link(link, X_WB).T
    force = R_LW @ wrench[3:, :]
    return ca.vertcat(R_LW @ wrench[:3, :] + skew(constant(link.X_LB.position)) @ force, force)


def rotation_of_link(link: Link, X_WB: SymbolicPose) -> ca.SX:
    """R_WL (3, 3)."""
    return ca.sparsify(X_WB.rotation @ constant(link.X_LB.rotation.T))
