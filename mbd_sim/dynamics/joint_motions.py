"""The types of joints: how many coordinates each has, and how it moves (Featherstone, table 4.1)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca

from mbd_sim.dynamics import motion as m
from mbd_sim.geometry.pose import Array


@dataclass(frozen=True, eq=False)
class Axes:
    """What a joint's motion is along or about: unit vectors (3,) in its inboard frame, and a screw's lead in m a turn.

    `axis` is the axis of axial joints, the first of a universal joint, the normal of a planar one. `second` is the
    second axis of a universal joint, carried by the first, and the x direction of a planar one; `third` its y.
    """

    axis: Array
    second: Array
    third: Array
    lead: float = 0.0


@dataclass(frozen=True)
class JointType:
    """The sizes of a joint type and its motion.

    `quaternion` is where in q a unit quaternion starts; `turns` tells for each pivot of the joint's elimination
    whether it is a moment of inertia or a mass. `axial` joints are turned round by turning their axis round.
    """

    nq: int
    nv: int
    motion: Callable[[Axes, ca.SX, ca.SX], m.Motion]
    turns: tuple[bool, ...]
    quaternion: int | None = None
    axial: bool = False


def _universal(axes: Axes, q: ca.SX, u: ca.SX) -> m.Motion:
    return m.compose(m.turning(axes.axis, q[0], u[0]), m.turning(axes.second, q[1], u[1]))


def _cylindrical(axes: Axes, q: ca.SX, u: ca.SX) -> m.Motion:
    return m.compose(m.sliding(axes.axis, q[0], u[0]), m.turning(axes.axis, q[1], u[1]))


def _planar(axes: Axes, q: ca.SX, u: ca.SX) -> m.Motion:
    plane = m.compose(m.sliding(axes.second, q[0], u[0]), m.sliding(axes.third, q[1], u[1]))
    return m.compose(plane, m.turning(axes.axis, q[2], u[2]))


TURN, SLIDE = (True,), (False,)

JOINT_TYPES: dict[str, JointType] = {
    "revolute": JointType(1, 1, lambda axes, q, u: m.turning(axes.axis, q, u), TURN, axial=True),
    "prismatic": JointType(1, 1, lambda axes, q, u: m.sliding(axes.axis, q, u), SLIDE, axial=True),
    "screw": JointType(1, 1, lambda axes, q, u: m.screwing(axes.axis, axes.lead, q, u), TURN, axial=True),
    "cylindrical": JointType(2, 2, _cylindrical, SLIDE + TURN, axial=True),
    "universal": JointType(2, 2, _universal, TURN * 2),
    "planar": JointType(3, 3, _planar, SLIDE * 2 + TURN),
    "spherical": JointType(4, 3, lambda axes, q, u: m.orienting(q, u), TURN * 3, quaternion=0),
    "free": JointType(7, 6, lambda axes, q, u: m.flying(q, u), TURN * 3 + SLIDE * 3, quaternion=3),
    "fixed": JointType(0, 0, lambda axes, q, u: m.at_rest(), (), axial=True),
}
