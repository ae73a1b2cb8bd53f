"""The motion of each joint type as a function of its coordinates q and speeds u (Featherstone, table 4.1)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import casadi as ca

from mbd_sim.dynamics import motion as m
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.joint_types import JointType


@dataclass(frozen=True, eq=False)
class JointAxes:
    """The directions of a joint's motion: unit vectors (3,) in its inboard frame, and the lead of a screw in m/turn.

    `axis` is the axis of an axial joint, the first axis of a universal joint, or the normal of a planar joint.
    `second` is the second axis of a universal joint, carried by the first, or the x direction of a planar joint.
    `third` is the y direction of a planar joint.
    """

    axis: Array
    second: Array
    third: Array
    lead: float = 0.0


MotionFunction = Callable[[JointAxes, ca.SX, ca.SX], m.JointMotion]


def _universal(axes: JointAxes, q: ca.SX, u: ca.SX) -> m.JointMotion:
    return m.compose(m.revolute(axes.axis, q[0], u[0]), m.revolute(axes.second, q[1], u[1]))


def _cylindrical(axes: JointAxes, q: ca.SX, u: ca.SX) -> m.JointMotion:
    return m.compose(m.prismatic(axes.axis, q[0], u[0]), m.revolute(axes.axis, q[1], u[1]))


def _planar(axes: JointAxes, q: ca.SX, u: ca.SX) -> m.JointMotion:
    translation = m.compose(m.prismatic(axes.second, q[0], u[0]), m.prismatic(axes.third, q[1], u[1]))
    return m.compose(translation, m.revolute(axes.axis, q[2], u[2]))


JOINT_MOTIONS: Mapping[JointType, MotionFunction] = {
    "revolute": lambda axes, q, u: m.revolute(axes.axis, q, u),
    "prismatic": lambda axes, q, u: m.prismatic(axes.axis, q, u),
    "screw": lambda axes, q, u: m.helical(axes.axis, axes.lead, q, u),
    "cylindrical": _cylindrical,
    "universal": _universal,
    "planar": _planar,
    "spherical": lambda axes, q, u: m.spherical(q, u),
    "free": lambda axes, q, u: m.free(q, u),
    "fixed": lambda axes, q, u: m.fixed(),
}
