"""Poses and velocities of the links, by recursion from ground outward."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca

from mbd_sim.base.geometry.pose import Pose, identity_pose
from mbd_sim.dynamics.kinematics.drives import driven_motion
from mbd_sim.dynamics.kinematics.joint_motions import JOINT_MOTIONS, JointMotion, inverse_motion, prescribed_motion
from mbd_sim.dynamics.kinematics.links import Link
from mbd_sim.dynamics.math.spatial import constant, inlined, inlined_results, motion_transform


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
