"""Where the links are and how fast they move."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from mbd_sim.dynamics.joint_motions import JOINT_MOTIONS
from mbd_sim.dynamics.links import Link
from mbd_sim.dynamics.motion import Motion, prescribed, turned_round
from mbd_sim.dynamics.spatial_algebra import constant, motion_transform
from mbd_sim.dynamics.time_functions import time_functions


@dataclass(frozen=True, eq=False)
class LinkMotion:
    """A link's joint motion, the transform from its inboard link, and its spatial velocity [ω; v], own frame."""

    joint: Motion
    transform: ca.SX
    velocity: ca.SX


def joint_motion(link: Link, t: ca.SX, q: ca.SX, u: ca.SX) -> Motion:
    """The motion of a link's joint, from its coordinates and speeds or from its drive."""
    move = JOINT_MOTIONS[link.joint.type]
    if link.joint.drive:
        position, speeds, speed_rates = time_functions(link.joint.drive, t)
        motion = move(link.axes, position, speeds)
        if link.joint.reversed and not link.joint.kind.axial:
            motion = turned_round(motion)
        return prescribed(motion, speeds, speed_rates)
    motion = move(link.axes, q[link.q, :], u[link.u, :])
    return turned_round(motion) if link.joint.reversed and not link.joint.kind.axial else motion


def link_motions(links: Sequence[Link], t: ca.SX, q: ca.SX, u: ca.SX) -> list[LinkMotion]:
    """The motion of every link, from ground outwards (Featherstone, table 5.1)."""
    motions: list[LinkMotion] = []
    for link in links:
        joint = joint_motion(link, t, q, u)
        rotation = constant(link.base.rotation) @ joint.rotation
        position = constant(link.base.position) + constant(link.base.rotation) @ joint.position
        transform = motion_transform(rotation, position)
        inboard = transform @ motions[link.parent].velocity if link.parent >= 0 else ca.SX(6, 1)
        motions.append(LinkMotion(joint, transform, ca.sparsify(inboard + joint.velocity)))
    return motions


@dataclass(frozen=True, eq=False)
class WorldPose:
    """A frame in ground's frame: `position` (3,) and `rotation` (3, 3)."""

    position: ca.SX
    rotation: ca.SX


def part_poses(links: Sequence[Link], t: ca.SX, q: ca.SX) -> list[WorldPose]:
    """The pose of every link's part in ground's frame."""
    still = ca.SX(max((link.u.stop for link in links), default=0), 1)
    frames: list[WorldPose] = []
    parts: list[WorldPose] = []
    for link in links:
        joint = joint_motion(link, t, q, still)
        base_position, base_rotation = constant(link.base.position), constant(link.base.rotation)
        if link.parent >= 0:
            outer = frames[link.parent]
            base_position = outer.position + outer.rotation @ base_position
            base_rotation = outer.rotation @ base_rotation
        position = ca.sparsify(base_position + base_rotation @ joint.position)
        rotation = ca.sparsify(base_rotation @ joint.rotation)
        frames.append(WorldPose(position, rotation))
        parts.append(
            WorldPose(
                ca.sparsify(position + rotation @ constant(link.part.position)),
                ca.sparsify(rotation @ constant(link.part.rotation)),
            )
        )
    return parts
