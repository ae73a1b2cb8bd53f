"""Poses and velocities of the links, by recursion from ground outward, and symbols for those of parts.

Constraints are written on the symbols, and then hold for any motion.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from mbd_sim.base.geometry.pose import Array, Pose, identity_pose
from mbd_sim.dynamics.kinematics.drives import driven_motion
from mbd_sim.dynamics.kinematics.joint_motions import JOINT_MOTIONS, JointMotion, inverse_motion, prescribed_motion
from mbd_sim.dynamics.kinematics.links import Link
from mbd_sim.dynamics.math.spatial import constant, inlined, inlined_results, motion_transform, skew
from mbd_sim.mechanism.elements.parts import GROUND


@dataclass(frozen=True, eq=False)
class LinkMotion:
    """The motion of a link.

    `joint` is that of its inboard joint. The link's frame L is placed in the inboard link's frame P by `R_PL` (3, 3)
    and `p_PL` (3,) in m; `cross` (3, 3) is such that cross @ r = p_PL × r. `V_WL` (6,) = [ω; v] is the link's velocity,
    expressed in L at its origin.
    """

    joint: JointMotion
    R_PL: ca.SX
    p_PL: ca.SX
    cross: ca.SX
    V_WL: ca.SX

    @cached_property
    def transform(self) -> ca.SX:
        """The matrix (6, 6) that takes motion vectors from the inboard link's frame P to the link's frame L."""
        return motion_transform(self.R_PL, self.p_PL)


@dataclass(frozen=True, eq=False)
class SymbolicPose:
    """A frame in ground's frame: `position` (3,) in m and `rotation` (3, 3)."""

    position: ca.SX
    rotation: ca.SX


@inlined
def carried_outward(R_PL: ca.SX, cross: ca.SX, vector: ca.SX, added: ca.SX) -> ca.SX:
    """A motion vector (6,) of the inboard link as one about the link's origin, in its axes, and what is added there."""
    return ca.vertcat(R_PL.T @ vector[:3], R_PL.T @ (vector[3:] - cross @ vector[:3])) + added


def joint_motion(link: Link, t: ca.SX, q: ca.SX, u: ca.SX) -> JointMotion:
    """The motion of a link's inboard joint, from its coordinates and speeds or from its drive."""
    motion_of = JOINT_MOTIONS[link.joint.type]
    reverse = link.joint.reversed and not link.joint.kind.axial
    if link.joint.drive:
        coordinates, speeds, speed_rates = driven_motion(link, t, q)
        motion = motion_of(link.axes, coordinates, speeds)
        return prescribed_motion(inverse_motion(motion) if reverse else motion, speeds, speed_rates)
    motion = motion_of(link.axes, q[link.q, :], u[link.u, :])
    return inverse_motion(motion) if reverse else motion


def link_motions(links: Sequence[Link], t: ca.SX, q: ca.SX, u: ca.SX) -> list[LinkMotion]:
    """The motion of every link, from ground outward (Featherstone, table 5.1)."""
    motions: list[LinkMotion] = []
    for link in links:
        joint = joint_motion(link, t, q, u)
        R_PF, p_PF = constant(link.X_PF.rotation), constant(link.X_PF.position)
        R_PL, p_PL, cross = _link_in_inboard_link(R_PF, p_PF, joint.R_FM, joint.p_FM)
        V_WL = joint.V_FM if link.parent < 0 else carried_outward(R_PL, cross, motions[link.parent].V_WL, joint.V_FM)
        motions.append(LinkMotion(joint, R_PL, p_PL, cross, V_WL))
    return motions


@inlined_results
def _link_in_inboard_link(R_PF: ca.SX, p_PF: ca.SX, R_FL: ca.SX, p_FL: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """R_PL, p_PL, and the matrix (3, 3) of the cross product with p_PL."""
    p_PL = p_PF + R_PF @ p_FL
    return R_PF @ R_FL, p_PL, ca.skew(p_PL)


def part_poses(links: Sequence[Link], joints: Iterable[JointMotion]) -> list[SymbolicPose]:
    """The pose X_WB of every link's part in ground's frame, from the motions of the inboard joints."""
    X_WL: list[tuple[ca.SX, ca.SX]] = []
    X_WB: list[SymbolicPose] = []
    for link, joint in zip(links, joints, strict=True):
        X_WP = X_WL[link.parent] if link.parent >= 0 else _pose(identity_pose())
        p_WL, R_WL, p_WB, R_WB = _link_and_part(*X_WP, *_pose(link.X_PF), joint.p_FM, joint.R_FM, *_pose(link.X_LB))
        X_WL.append((p_WL, R_WL))
        X_WB.append(SymbolicPose(p_WB, R_WB))
    return X_WB


@inlined_results
def _link_and_part(
    p_WP: ca.SX, R_WP: ca.SX, p_PF: ca.SX, R_PF: ca.SX, p_FL: ca.SX, R_FL: ca.SX, p_LB: ca.SX, R_LB: ca.SX
) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
    """The poses X_WL and X_WB, as positions and rotations."""
    p_WF, R_WF = p_WP + R_WP @ p_PF, R_WP @ R_PF
    p_WL, R_WL = p_WF + R_WF @ p_FL, R_WF @ R_FL
    return p_WL, R_WL, p_WL + R_WL @ p_LB, R_WL @ R_LB


def _pose(pose: Pose) -> tuple[ca.SX, ca.SX]:
    """A pose of numbers, or of numbers and symbols, as its position (3,) and its rotation (3, 3)."""
    return constant(pose.position), constant(pose.rotation)


def coordinate_rates(links: Sequence[Link], motions: Sequence[LinkMotion], nq: int) -> ca.SX:
    """q' (nq,) = N(q) u."""
    rates = ca.SX(nq, 1)
    for link, motion in zip(links, motions, strict=True):
        rates[link.q] = motion.joint.q_rates
    return rates


def normalized_quaternions(links: Sequence[Link], q: ca.SX) -> ca.SX:
    """The coordinates q (nq,) with every quaternion scaled to unit length."""
    normalized = ca.SX(q)
    for link in links:
        if (offset := link.joint.kind.quaternion) is not None and not link.joint.drive:
            first = link.q.start + offset
            p = q[first : first + 4]
            normalized[first : first + 4] = p / ca.sqrt(ca.dot(p, p))
    return normalized


@dataclass(frozen=True, eq=False)
class BodyFrame(SymbolicPose):
    """A frame fixed in a part, with the `velocity` (3,) of its origin and `omega` (3,) of its axes in ground's axes."""

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

    def moving(self, *parts: str) -> list[int]:
        """The indices of those of some parts that are not ground."""
        return [self._index[part] for part in parts if part != GROUND]

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
        rates = [pose_rate(pose, twist) for pose, twist in zip(self.poses, self.twists, strict=True)]
        return ca.sparsify(ca.jacobian(expressions, ca.vertcat(*self.poses)) @ ca.vertcat(ca.SX(0, 1), *rates))


def pose_rate(pose: ca.SX, twist: ca.SX) -> ca.SX:
    """The time derivative (12,) of a pose, see `flat_pose`, of a part with the velocity [ω; v] in ground's axes."""
    return ca.vertcat(twist[3:], ca.vec(skew(twist[:3]) @ ca.reshape(pose[3:], 3, 3)))


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
