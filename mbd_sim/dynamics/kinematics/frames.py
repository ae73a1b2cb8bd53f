"""Velocities and accelerations of frames that are fixed in parts, and their Jacobians.

With the speeds u of the tree, a point and the part that carries it move with [v; ω] = J u + the motion by drives, in
ground's axes. The columns of J are the partial velocities of the joints between ground and the part. Jacobians,
velocities and bias accelerations of points are functions that are traced on request.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, assert_never

import casadi as ca

from mbd_sim.base.geometry.pose import Pose, identity_pose
from mbd_sim.dynamics.kinematics.drives import driven_motion
from mbd_sim.dynamics.kinematics.poses import SymbolicPose, rotation_of_link
from mbd_sim.dynamics.kinematics.tracing import TracedMechanism
from mbd_sim.dynamics.math.spatial import constant, skew
from mbd_sim.mechanism.elements.parts import GROUND


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


FrameQuantity = Literal["pose", "velocity", "jacobian", "jacobian_rate", "bias_acceleration"]


def frame_function(traced: TracedMechanism, part: str, quantity: FrameQuantity) -> ca.Function:
    """(t, y, inputs, point) -> a quantity of a point (3,) in m in the frame of a part, in ground's axes.

    - `pose` (12,): the position of the point, then the rotation of the part column by column.
    - `velocity` (6,): [v; ω].
    - `jacobian` (6, nv) and its rate `jacobian_rate`, row by row.
    - `bias_acceleration` (6,): [v'; ω'] at u' = 0.
    """
    point = ca.SX.sym("point", 3)
    pose, jacobian, velocity = _point_motion(traced, part, point)
    position = pose.position + pose.rotation @ point
    return _function(traced, quantity, ca.vertcat(position, ca.vec(pose.rotation)), jacobian, velocity, point)


def center_function(traced: TracedMechanism, quantity: FrameQuantity) -> ca.Function:
    """A quantity of the center of mass of all parts, with three components instead of six; its `pose` is (3,)."""
    point, parts = ca.SX.sym("point", 3), traced.mechanism.bodies
    links = [parts[link.joint.outboard] for link in traced.links]
    total = sum((part.mass for part in links), ca.SX(0))
    position, velocity, jacobian = ca.SX(3, 1), ca.SX(3, 1), ca.SX(3, traced.layout.nv)
    for part in links:
        center, share = constant(part.center), part.mass / total
        pose, columns, motion = _point_motion(traced, part.name, center)
        position += share * (pose.position + pose.rotation @ center)
        velocity += share * motion[:3]
        jacobian += share * columns[:3, :]
    return _function(traced, quantity, position, jacobian, velocity, point)


def momentum_function(traced: TracedMechanism) -> ca.Function:
    """(t, y, inputs) -> linear momentum (3,) and angular momentum (3,) about ground's origin, in ground's axes."""
    linear, angular = ca.SX(3, 1), ca.SX(3, 1)
    for pose, link, motion in zip(link_poses(traced), traced.links, traced.motions, strict=True):
        momentum = constant(link.inertia) @ motion.V_WL  # [angular; linear] about the link's origin, in its axes
        force = pose.rotation @ momentum[3:]
        linear += force
        angular += pose.rotation @ momentum[:3] + ca.cross(pose.position, force)
    inputs = [traced.state.t, traced.y, traced.inputs]
    return ca.Function("momentum", inputs, [ca.densify(ca.vertcat(linear, angular))], {"cse": True})


def link_poses(traced: TracedMechanism) -> list[SymbolicPose]:
    """The frames L of the links in ground's frame."""
    found = []
    for link, X_WB in zip(traced.links, traced.poses, strict=True):
        rotation = rotation_of_link(link, X_WB)
        found.append(SymbolicPose(ca.sparsify(X_WB.position - rotation @ constant(link.X_LB.position)), rotation))
    return found


def _point_motion(traced: TracedMechanism, part: str, point: ca.SX) -> tuple[SymbolicPose, ca.SX, ca.SX]:
    """The pose of a part, and of a point in its frame the Jacobian (6, nv) and the velocity [v; ω]."""
    links, nv, frames = traced.links, traced.layout.nv, link_poses(traced)
    own = next(number for number, link in enumerate(links) if link.joint.outboard == part)
    pose = traced.poses[own]
    position = pose.position + pose.rotation @ point
    jacobian, driven = ca.SX(6, nv), ca.SX(6, 1)
    for index in _carriers(traced, own):
        joint, frame = traced.motions[index].joint, frames[index]
        arm = position - frame.position
        jacobian[:, links[index].u] = _moved(joint.partial_velocities, frame, arm)
        if joint.prescribed is not None:
            driven += _moved(joint.prescribed.partial_velocities @ joint.prescribed.speeds, frame, arm)
    jacobian = ca.sparsify(jacobian)
    return pose, jacobian, ca.sparsify(jacobian @ traced.state.u + driven)


def _moved(vectors: ca.SX, frame: SymbolicPose, arm: ca.SX) -> ca.SX:
    """Motion vectors [ω; v] (6, n) of a frame at its origin, as [v; ω] in ground's axes at an arm (3,) from it."""
    angular = ca.sparsify(frame.rotation @ vectors[:3, :])
    return ca.sparsify(ca.vertcat(frame.rotation @ vectors[3:, :] - skew(arm) @ angular, angular))


def _carriers(traced: TracedMechanism, own: int) -> Sequence[int]:
    """A link and those between it and ground."""
    found = [own]
    while (parent := traced.links[found[-1]].parent) >= 0:
        found.append(parent)
    return found


def _function(
    traced: TracedMechanism, quantity: FrameQuantity, pose: ca.SX, jacobian: ca.SX, velocity: ca.SX, point: ca.SX
) -> ca.Function:
    rate = traced.state.rate
    match quantity:
        case "pose":
            output = pose
        case "velocity":
            output = velocity
        case "jacobian":
            output = jacobian.T
        case "jacobian_rate":
            output = ca.reshape(rate(ca.vec(ca.densify(jacobian.T))), jacobian.shape[1], jacobian.shape[0])
        case "bias_acceleration":
            output = rate(velocity)
        case _:
            assert_never(quantity)
    inputs = [traced.state.t, traced.y, traced.inputs, point]
    return ca.Function(quantity, inputs, [ca.densify(output)], {"cse": True})
