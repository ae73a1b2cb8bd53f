"""Velocities and accelerations of frames that are fixed in parts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from mbd_sim.dynamics.commanded_drives import driven_motion
from mbd_sim.dynamics.spatial_algebra import constant, skew
from mbd_sim.dynamics.tracing import TracedMechanism
from mbd_sim.geometry.pose import Pose, identity_pose
from mbd_sim.mechanism.records import GROUND


@dataclass(frozen=True, eq=False)
class FrameMotion:
    """The motion of a frame C in ground's frame W.

    `position` (3,) and `rotation` (3, 3) are in ground's axes; all others (3,) in the axes of C: the `velocity` of its
    origin, `omega`, `omega_rate`, and the `specific_force`: the acceleration of the origin less that of gravity.
    """

    position: ca.SX
    rotation: ca.SX
    velocity: ca.SX
    omega: ca.SX
    omega_rate: ca.SX
    specific_force: ca.SX


def frame_motion(
    traced: TracedMechanism, accelerations: Sequence[ca.SX], part: str, pose: Pose | None = None
) -> FrameMotion:
    """The motion of the frame at a `pose` in a part, by default of the part's own, or of ground.

    A spatial acceleration a has the linear part v' - ω × v (Featherstone, eq. 2.48), so that the acceleration of the
    point p of a link is a + ω × v + ω' × p + ω × (ω × p).

    :param accelerations: spatial acceleration (6,) of each link in L, less that of gravity.
    """
    pose = pose or identity_pose()
    position, rotation = constant(pose.position), constant(pose.rotation)
    if part == GROUND:
        weight = ca.sparsify(-rotation.T @ constant(traced.mechanism.gravity))
        return FrameMotion(position, rotation, ca.SX(3, 1), ca.SX(3, 1), ca.SX(3, 1), weight)
    index = next(number for number, link in enumerate(traced.links) if link.joint.outboard == part)
    link, X_WB, V_WL = traced.links[index], traced.poses[index], traced.motions[index].V_WL
    R_CL = ca.sparsify(rotation.T @ constant(link.X_LB.rotation).T)
    p_LC = ca.sparsify(constant(link.X_LB.position) + constant(link.X_LB.rotation) @ position)
    omega, velocity = V_WL[:3], V_WL[3:]
    omega_rate, acceleration = accelerations[index][:3], accelerations[index][3:]
    at_point = velocity - skew(p_LC) @ omega
    specific_force = acceleration - skew(p_LC) @ omega_rate + skew(omega) @ at_point
    return FrameMotion(
        position=X_WB.position + X_WB.rotation @ position,
        rotation=ca.sparsify(X_WB.rotation @ rotation),
        velocity=ca.sparsify(R_CL @ at_point),
        omega=ca.sparsify(R_CL @ omega),
        omega_rate=ca.sparsify(R_CL @ omega_rate),
        specific_force=ca.sparsify(R_CL @ specific_force),
    )


def coordinate_accelerations(traced: TracedMechanism, u_rates: ca.SX) -> ca.SX:
    """u' (nv,), then the accelerations of the driven coordinates, in declared order."""
    links = {link.joint.name: link for link in traced.links}
    driven = [
        driven_motion(links[name], traced.state.t, traced.state.q)[2]
        for name, joint in traced.mechanism.joints.items()
        if joint.drive
    ]
    return ca.vertcat(u_rates, *driven)


def part_motions(traced: TracedMechanism, accelerations: Sequence[ca.SX]) -> ca.SX:
    """(12, parts) in ground's axes: the velocity of each part's origin, ω, the acceleration of the origin, and ω'."""
    columns = []
    for name, X_WB in zip(traced.part_names, traced.poses, strict=False):
        motion = frame_motion(traced, accelerations, name)
        to_ground = X_WB.rotation
        acceleration = to_ground @ motion.specific_force + constant(traced.mechanism.gravity)
        vectors = (to_ground @ motion.velocity, to_ground @ motion.omega, acceleration, to_ground @ motion.omega_rate)
        columns.append(ca.vertcat(*vectors))
    return ca.horzcat(ca.SX(12, 0), *columns)
