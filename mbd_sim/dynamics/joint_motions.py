"""How each type of joint moves, as a function of its coordinates q and speeds u (Featherstone, table 4.1)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import casadi as ca

from mbd_sim.dynamics import motion as m
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.joint_types import JointType


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


JointMotion = Callable[[Axes, ca.SX, ca.SX], m.Motion]


def _universal(axes: Axes, q: ca.SX, u: ca.SX) -> m.Motion:
    return m.compose(m.turning(axes.axis, q[0], u[0]), m.turning(axes.second, q[1], u[1]))


def _cylindrical(axes: Axes, q: ca.SX, u: ca.SX) -> m.Motion:
    return m.compose(m.sliding(axes.axis, q[0], u[0]), m.turning(axes.axis, q[1], u[1]))


def _planar(axes: Axes, q: ca.SX, u: ca.SX) -> m.Motion:
    plane = m.compose(m.sliding(axes.second, q[0], u[0]), m.sliding(axes.third, q[1], u[1]))
    return m.compose(plane, m.turning(axes.axis, q[2], u[2]))


JOINT_MOTIONS: Mapping[JointType, JointMotion] = {
    "revolute": lambda axes, q, u: m.turning(axes.axis, q, u),
    "prismatic": lambda axes, q, u: m.sliding(axes.axis, q, u),
    "screw": lambda axes, q, u: m.screwing(axes.axis, axes.lead, q, u),
    "cylindrical": _cylindrical,
    "universal": _universal,
    "planar": _planar,
    "spherical": lambda axes, q, u: m.orienting(q, u),
    "free": lambda axes, q, u: m.flying(q, u),
    "fixed": lambda axes, q, u: m.at_rest(),
}
