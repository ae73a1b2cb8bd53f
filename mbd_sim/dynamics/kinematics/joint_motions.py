"""The relative motion of the two frames of a joint, for each joint type and for motions that are composed.

The outboard frame M moves relative to the inboard frame F. Motion vectors are [ω; v] of M relative to F, expressed in
M at M's origin. See `mbd_sim.dynamics` for the notation. Motions can be composed, inverted and prescribed; that of each
joint type is a function of its coordinates q and speeds u (Featherstone, table 4.1).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.dynamics.math.spatial import constant, motion_cross, motion_transform, skew, sparse, zeros
from mbd_sim.mechanism.elements.joint_types import JointType


@dataclass(frozen=True, eq=False)
class PrescribedMotion:
    """The directions along which a drive exerts its generalized forces.

    `partial_velocities` (6, n) times the prescribed `speeds` (n,), in rad/s or m/s, give V_FM.
    """

    partial_velocities: ca.SX
    speeds: ca.SX


@dataclass(frozen=True, eq=False)
class AxisRotation:
    """A right-handed rotation about coordinate axis 0, 1 or 2, by its sine and cosine."""

    axis: int
    sine: ca.SX
    cosine: ca.SX


@dataclass(frozen=True, eq=False)
class JointMotion:
    """The motion of a joint at coordinates q and speeds u.

    `R_FM` (3, 3) and `p_FM` (3,) place the outboard frame in the inboard one. `partial_velocities` (6, nv) times u
    give `V_FM` (6,); `bias` (6,) is the derivative of V_FM in outboard axes at u' = 0; `q_rates` (nq,) is N(q) u.
    For a joint that constrains nothing `inverse` (6, 6) is the inverse of `partial_velocities`, and the recursion need
    not eliminate the joint. A `prescribed` motion has neither coordinates nor speeds. `turn` is R_FM where it is a
    rotation about a coordinate axis. `known_origin_bias` (3,) is `origin_bias` where that is known to be simple.
    """

    R_FM: ca.SX
    p_FM: ca.SX
    partial_velocities: ca.SX
    V_FM: ca.SX
    bias: ca.SX
    q_rates: ca.SX
    inverse: ca.SX | None = None
    prescribed: PrescribedMotion | None = None
    turn: AxisRotation | None = None
    known_origin_bias: ca.SX | None = None

    @property
    def origin_bias(self) -> ca.SX:
        """The acceleration (3,) of M's origin relative to F at u' = 0, in outboard axes."""
        if self.known_origin_bias is not None:
            return self.known_origin_bias
        return sparse(self.bias[3:] + skew(self.V_FM[:3]) @ self.V_FM[3:])


def fixed() -> JointMotion:
    """Frames that coincide."""
    R_FM, still = constant(np.eye(3)), zeros(3)
    return JointMotion(R_FM, still, zeros(6, 0), zeros(6), zeros(6), zeros(0), known_origin_bias=still)


def revolute(axis: Array, q: ca.SX, u: ca.SX) -> JointMotion:
    """Right-handed rotation by q in rad about a unit `axis`."""
    k = constant(np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]]))
    projection = constant(np.outer(axis, axis))
    sine, cosine = ca.sin(q), ca.cos(q)
    R_FM = sparse(projection + sine * k + cosine * (constant(np.eye(3)) - projection))
    s = constant(np.concatenate([axis, np.zeros(3)]))
    turn = _axis_rotation(axis, sine, cosine)
    return JointMotion(R_FM, zeros(3), s, s * u, zeros(6), u, turn=turn, known_origin_bias=zeros(3))


def _axis_rotation(axis: Array, sine: ca.SX, cosine: ca.SX) -> AxisRotation | None:
    """The rotation about a unit vector, if that is a coordinate axis or its opposite."""
    if np.count_nonzero(axis) != 1:
        return None
    index = int(np.argmax(np.abs(axis)))
    return AxisRotation(index, float(axis[index]) * sine, cosine)


def prismatic(axis: Array, q: ca.SX, u: ca.SX) -> JointMotion:
    """Translation by q in m along a unit `axis`."""
    s = constant(np.concatenate([np.zeros(3), axis]))
    return JointMotion(constant(np.eye(3)), constant(axis) * q, s, s * u, zeros(6), u, known_origin_bias=zeros(3))


def helical(axis: Array, lead: float, q: ca.SX, u: ca.SX) -> JointMotion:
    """Rotation by q in rad about a unit `axis`, with a displacement of `lead` m per turn along it."""
    rotation, pitch = revolute(axis, q, u), lead / (2.0 * np.pi)
    s = constant(np.concatenate([axis, pitch * axis]))
    return JointMotion(rotation.R_FM, constant(pitch * axis) * q, s, s * u, zeros(6), u, turn=rotation.turn)


def spherical(q: ca.SX, u: ca.SX) -> JointMotion:
    """Any rotation: q (4,) is a unit quaternion (w, x, y, z), and u (3,) the angular velocity in outboard axes."""
    s = constant(np.vstack([np.eye(3), np.zeros((3, 3))]))
    return JointMotion(quaternion_rotation(q), zeros(3), s, s @ u, zeros(6), quaternion_rates(q, u))


def free(q: ca.SX, u: ca.SX) -> JointMotion:
    """Any motion: q is the position (3,) and a quaternion (4,), and u the velocity (3,) and ω (3,).

    The velocity is in inboard axes, so that linear momentum is integrated without error. ω is in outboard axes, where
    the inertia is constant.
    """
    R_FM, quaternion_rate = quaternion_rotation(q[3:]), quaternion_rates(q[3:], u[3:])
    eye, gap = constant(np.eye(3)), zeros(3, 3)
    s = sparse(ca.vertcat(ca.horzcat(gap, eye), ca.horzcat(R_FM.T, gap)))
    inverse = sparse(ca.vertcat(ca.horzcat(gap, R_FM), ca.horzcat(eye, gap)))
    linear = R_FM.T @ u[:3]
    bias = ca.vertcat(zeros(3), -skew(u[3:]) @ linear)
    V_FM = ca.vertcat(u[3:], linear)
    q_rates = ca.vertcat(u[:3], quaternion_rate)
    return JointMotion(R_FM, q[:3], s, V_FM, sparse(bias), q_rates, inverse, known_origin_bias=zeros(3))


def compose(first: JointMotion, second: JointMotion) -> JointMotion:
    """The second motion on top of the first; q and u of the first come first."""
    transform = motion_transform(second.R_FM, second.p_FM)
    carried = transform @ first.V_FM
    bias = transform @ first.bias + second.bias - motion_cross(second.V_FM) @ carried
    return JointMotion(
        R_FM=sparse(first.R_FM @ second.R_FM),
        p_FM=sparse(first.p_FM + first.R_FM @ second.p_FM),
        partial_velocities=sparse(ca.horzcat(transform @ first.partial_velocities, second.partial_velocities)),
        V_FM=sparse(carried + second.V_FM),
        bias=sparse(bias),
        q_rates=ca.vertcat(first.q_rates, second.q_rates),
    )


def inverse_motion(motion: JointMotion) -> JointMotion:
    """The motion of the inboard frame relative to the outboard one, with the same q and u."""
    R_MF = motion.R_FM.T
    p_MF = -R_MF @ motion.p_FM
    transform = motion_transform(R_MF, p_MF)
    inverse = None
    if motion.inverse is not None:
        inverse = sparse(-motion.inverse @ motion_transform(motion.R_FM, motion.p_FM))
    return JointMotion(
        R_FM=R_MF,
        p_FM=sparse(p_MF),
        partial_velocities=sparse(-transform @ motion.partial_velocities),
        V_FM=sparse(-transform @ motion.V_FM),
        bias=sparse(-transform @ motion.bias),
        q_rates=motion.q_rates,
        inverse=inverse,
    )


def prescribed_motion(motion: JointMotion, speeds: ca.SX, speed_rates: ca.SX) -> JointMotion:
    """A motion whose coordinates are functions of time; `speeds` and `speed_rates` (n,) are q' and q''."""
    s = motion.partial_velocities
    return JointMotion(
        R_FM=motion.R_FM,
        p_FM=motion.p_FM,
        partial_velocities=zeros(6, 0),
        V_FM=motion.V_FM,
        bias=sparse(motion.bias + s @ speed_rates),
        q_rates=zeros(0),
        prescribed=PrescribedMotion(s, speeds),
        turn=motion.turn,
    )


def quaternion_rotation(p: ca.SX) -> ca.SX:
    """The rotation matrix (3, 3) of a unit quaternion (w, x, y, z)."""
    k = skew(p[1:])
    return constant(np.eye(3)) + 2.0 * (p[0] * k + k @ k)


def quaternion_rates(p: ca.SX, omega: ca.SX) -> ca.SX:
    """p' (4,) of a unit quaternion for ω (3,) in rotated axes: p' = ½ p ∘ (0, ω)."""
    w, v = p[0], p[1:]
    return 0.5 * ca.vertcat(-ca.dot(v, omega), w * omega + skew(v) @ omega)


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


MotionFunction = Callable[[JointAxes, ca.SX, ca.SX], JointMotion]


def _universal(axes: JointAxes, q: ca.SX, u: ca.SX) -> JointMotion:
    return compose(revolute(axes.axis, q[0], u[0]), revolute(axes.second, q[1], u[1]))


def _cylindrical(axes: JointAxes, q: ca.SX, u: ca.SX) -> JointMotion:
    return compose(prismatic(axes.axis, q[0], u[0]), revolute(axes.axis, q[1], u[1]))


def _planar(axes: JointAxes, q: ca.SX, u: ca.SX) -> JointMotion:
    translation = compose(prismatic(axes.second, q[0], u[0]), prismatic(axes.third, q[1], u[1]))
    return compose(translation, revolute(axes.axis, q[2], u[2]))


JOINT_MOTIONS: Mapping[JointType, MotionFunction] = {
    "revolute": lambda axes, q, u: revolute(axes.axis, q, u),
    "prismatic": lambda axes, q, u: prismatic(axes.axis, q, u),
    "screw": lambda axes, q, u: helical(axes.axis, axes.lead, q, u),
    "cylindrical": _cylindrical,
    "universal": _universal,
    "planar": _planar,
    "spherical": lambda axes, q, u: spherical(q, u),
    "free": lambda axes, q, u: free(q, u),
    "fixed": lambda axes, q, u: fixed(),
}
