"""How each type of joint moves: relative pose, velocity and its partial velocities (Featherstone, table 4.1).

The outboard frame moves relative to the inboard frame. Motion vectors are [ω; v] of the outboard frame relative
to the inboard one, in outboard axes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np

from mbd_sim.dynamics.spatial import constant, skew, zeros
from mbd_sim.mechanism.model import Array


@dataclass(frozen=True, eq=False)
class Motion:
    """The motion of a joint at coordinates q and speeds u.

    `partial_velocities` (6, nv) multiply u to give `velocity` (6,); `bias` (6,) is their derivative in outboard
    axes times u; `q_rates` (nq,) is N(q) u. `inverse`, where the joint constrains nothing, is the inverse of
    `partial_velocities` (6, 6), which then need not be eliminated by the recursion.
    """

    rotation: ca.SX
    position: ca.SX
    partial_velocities: ca.SX
    velocity: ca.SX
    bias: ca.SX
    q_rates: ca.SX
    inverse: ca.SX | None = None


def _turn(axis: Array, angle: ca.SX) -> ca.SX:
    k = constant(np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]]))
    along = constant(np.outer(axis, axis))
    return ca.sparsify(along + ca.sin(angle) * k + ca.cos(angle) * (constant(np.eye(3)) - along))


def revolute(axis: Array, q: ca.SX, u: ca.SX) -> Motion:
    """Rotation by q about `axis`."""
    s = constant(np.concatenate([axis, np.zeros(3)]))
    return Motion(_turn(axis, q), zeros(3), s, s * u, zeros(6), u)


def prismatic(axis: Array, q: ca.SX, u: ca.SX) -> Motion:
    """Translation by q along `axis`."""
    s = constant(np.concatenate([np.zeros(3), axis]))
    return Motion(constant(np.eye(3)), constant(axis) * q, s, s * u, zeros(6), u)


def fixed(axis: Array, q: ca.SX, u: ca.SX) -> Motion:
    """No motion."""
    return Motion(constant(np.eye(3)), zeros(3), zeros(6, 0), zeros(6), zeros(6), zeros(0))


def free(axis: Array, q: ca.SX, u: ca.SX) -> Motion:
    """Q = position (3,) and quaternion (w, x, y, z); u = velocity (3,) in inboard axes and ω (3,) in outboard axes.

    With the velocity in inboard axes, linear momentum is integrated without error; with ω in outboard axes, the
    inertia is constant.
    """
    rotation, q_rates = quaternion_rotation(q[3:]), quaternion_rates(q[3:], u[3:])
    eye, gap = constant(np.eye(3)), zeros(3, 3)
    s = ca.sparsify(ca.vertcat(ca.horzcat(gap, eye), ca.horzcat(rotation.T, gap)))
    inverse = ca.sparsify(ca.vertcat(ca.horzcat(gap, rotation), ca.horzcat(eye, gap)))
    linear = rotation.T @ u[:3]
    velocity = ca.vertcat(u[3:], linear)
    bias = ca.vertcat(zeros(3), -skew(u[3:]) @ linear)
    return Motion(rotation, q[:3], s, velocity, ca.sparsify(bias), ca.vertcat(u[:3], q_rates), inverse)


def quaternion_rotation(p: ca.SX) -> ca.SX:
    """The rotation matrix (3, 3) of a unit quaternion (w, x, y, z)."""
    k = skew(p[1:])
    return constant(np.eye(3)) + 2.0 * (p[0] * k + k @ k)


def quaternion_rates(p: ca.SX, omega: ca.SX) -> ca.SX:
    """P' (4,) of a unit quaternion for ω (3,) in rotated axes: p' = ½ p ∘ (0, ω)."""
    w, v = p[0], p[1:]
    return 0.5 * ca.vertcat(-ca.dot(v, omega), w * omega + skew(v) @ omega)


@dataclass(frozen=True)
class JointType:
    """The sizes of a joint type and its motion.

    `quaternion` is where in q a unit quaternion starts; `turns` tells for each pivot of the joint's elimination
    whether it is a moment of inertia or a mass.
    """

    nq: int
    nv: int
    motion: Callable[[Array, ca.SX, ca.SX], Motion]
    turns: tuple[bool, ...]
    quaternion: int | None = None


JOINT_TYPES: dict[str, JointType] = {
    "revolute": JointType(1, 1, revolute, turns=(True,)),
    "prismatic": JointType(1, 1, prismatic, turns=(False,)),
    "fixed": JointType(0, 0, fixed, turns=()),
    "free": JointType(7, 6, free, turns=(True, True, True, False, False, False), quaternion=3),
}
