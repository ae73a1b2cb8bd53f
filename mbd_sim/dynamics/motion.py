"""The relative motion of two frames, and how motions are put together, turned round and prescribed.

The outboard frame moves relative to the inboard frame. Motion vectors are [ω; v] of the outboard frame relative
to the inboard one, in outboard axes at the outboard origin.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from mbd_sim.dynamics.spatial_algebra import (
    constant,
    motion_cross,
    motion_transform,
    skew,
    zeros,
)
from mbd_sim.geometry.pose import Array


@dataclass(frozen=True, eq=False)
class Drive:
    """A prescribed motion: what its generalized force is taken along.

    `partial_velocities` (6, n) multiply the prescribed `speeds` (n,) to give the velocity.
    """

    partial_velocities: ca.SX
    speeds: ca.SX


@dataclass(frozen=True, eq=False)
class Motion:
    """A motion at coordinates q and speeds u.

    `rotation` (3, 3) and `position` (3,) place the outboard frame in the inboard one. `partial_velocities` (6, nv)
    multiply u to give `velocity` (6,); `bias` (6,) is the derivative of the velocity in outboard axes at u' = 0;
    `q_rates` (nq,) is N(q) u. `inverse`, where the joint constrains nothing, is the inverse of
    `partial_velocities` (6, 6), which then need not be eliminated by the recursion. A motion with a `drive` is
    prescribed in time and has neither coordinates nor speeds.
    """

    rotation: ca.SX
    position: ca.SX
    partial_velocities: ca.SX
    velocity: ca.SX
    bias: ca.SX
    q_rates: ca.SX
    inverse: ca.SX | None = None
    drive: Drive | None = None


def at_rest() -> Motion:
    """Frames that coincide."""
    return Motion(constant(np.eye(3)), zeros(3), zeros(6, 0), zeros(6), zeros(6), zeros(0))


def turning(axis: Array, q: ca.SX, u: ca.SX) -> Motion:
    """Rotation by q in rad about a unit `axis`, right-handed."""
    k = constant(np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]]))
    along = constant(np.outer(axis, axis))
    rotation = ca.sparsify(along + ca.sin(q) * k + ca.cos(q) * (constant(np.eye(3)) - along))
    s = constant(np.concatenate([axis, np.zeros(3)]))
    return Motion(rotation, zeros(3), s, s * u, zeros(6), u)


def sliding(axis: Array, q: ca.SX, u: ca.SX) -> Motion:
    """Translation by q in m along a unit `axis`."""
    s = constant(np.concatenate([np.zeros(3), axis]))
    return Motion(constant(np.eye(3)), constant(axis) * q, s, s * u, zeros(6), u)


def screwing(axis: Array, lead: float, q: ca.SX, u: ca.SX) -> Motion:
    """Rotation by q in rad about a unit `axis` with a displacement of `lead` m a turn along it."""
    turn, pitch = turning(axis, q, u), lead / (2.0 * np.pi)
    s = constant(np.concatenate([axis, pitch * axis]))
    return Motion(turn.rotation, constant(pitch * axis) * q, s, s * u, zeros(6), u)


def orienting(q: ca.SX, u: ca.SX) -> Motion:
    """Any rotation: q (4,) is a unit quaternion (w, x, y, z), u (3,) the angular velocity in outboard axes."""
    s = constant(np.vstack([np.eye(3), np.zeros((3, 3))]))
    return Motion(quaternion_rotation(q), zeros(3), s, s @ u, zeros(6), quaternion_rates(q, u))


def flying(q: ca.SX, u: ca.SX) -> Motion:
    """Any motion: q is the position (3,) and a quaternion (4,), u the velocity (3,) and ω (3,).

    The velocity is in inboard axes, so that linear momentum is integrated without error; ω is in outboard axes, where
    the inertia is constant.
    """
    rotation, q_rates = quaternion_rotation(q[3:]), quaternion_rates(q[3:], u[3:])
    eye, gap = constant(np.eye(3)), zeros(3, 3)
    s = ca.sparsify(ca.vertcat(ca.horzcat(gap, eye), ca.horzcat(rotation.T, gap)))
    inverse = ca.sparsify(ca.vertcat(ca.horzcat(gap, rotation), ca.horzcat(eye, gap)))
    linear = rotation.T @ u[:3]
    bias = ca.vertcat(zeros(3), -skew(u[3:]) @ linear)
    velocity = ca.vertcat(u[3:], linear)
    return Motion(rotation, q[:3], s, velocity, ca.sparsify(bias), ca.vertcat(u[:3], q_rates), inverse)


def compose(first: Motion, second: Motion) -> Motion:
    """The second motion on top of the first; q and u of the first come first."""
    carry = motion_transform(second.rotation, second.position)
    carried = carry @ first.velocity
    bias = carry @ first.bias + second.bias - motion_cross(second.velocity) @ carried
    return Motion(
        rotation=ca.sparsify(first.rotation @ second.rotation),
        position=ca.sparsify(first.position + first.rotation @ second.position),
        partial_velocities=ca.sparsify(ca.horzcat(carry @ first.partial_velocities, second.partial_velocities)),
        velocity=ca.sparsify(carried + second.velocity),
        bias=ca.sparsify(bias),
        q_rates=ca.vertcat(first.q_rates, second.q_rates),
    )


def turned_round(motion: Motion) -> Motion:
    """The motion of the inboard frame seen from the outboard one, with the same q and u."""
    rotation = motion.rotation.T
    position = -rotation @ motion.position
    carry = motion_transform(rotation, position)
    inverse = None
    if motion.inverse is not None:
        inverse = ca.sparsify(-motion.inverse @ motion_transform(motion.rotation, motion.position))
    return Motion(
        rotation=rotation,
        position=ca.sparsify(position),
        partial_velocities=ca.sparsify(-carry @ motion.partial_velocities),
        velocity=ca.sparsify(-carry @ motion.velocity),
        bias=ca.sparsify(-carry @ motion.bias),
        q_rates=motion.q_rates,
        inverse=inverse,
    )


def prescribed(motion: Motion, speeds: ca.SX, speed_rates: ca.SX) -> Motion:
    """A motion whose coordinates are functions of time: `speeds` and `speed_rates` (n,) are q' and q''."""
    s = motion.partial_velocities
    return Motion(
        rotation=motion.rotation,
        position=motion.position,
        partial_velocities=zeros(6, 0),
        velocity=motion.velocity,
        bias=ca.sparsify(motion.bias + s @ speed_rates),
        q_rates=zeros(0),
        drive=Drive(s, speeds),
    )


def quaternion_rotation(p: ca.SX) -> ca.SX:
    """The rotation matrix (3, 3) of a unit quaternion (w, x, y, z)."""
    k = skew(p[1:])
    return constant(np.eye(3)) + 2.0 * (p[0] * k + k @ k)


def quaternion_rates(p: ca.SX, omega: ca.SX) -> ca.SX:
    """p' (4,) of a unit quaternion for ω (3,) in rotated axes: p' = ½ p ∘ (0, ω)."""
    w, v = p[0], p[1:]
    return 0.5 * ca.vertcat(-ca.dot(v, omega), w * omega + skew(v) @ omega)
