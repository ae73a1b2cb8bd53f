"""Jacobians, velocities and bias accelerations of points, as functions that are traced on request.

With the speeds u of the tree, a point and the part that carries it move with [v; ω] = J u + the motion by drives, in
ground's axes. The columns of J are the partial velocities of the joints between ground and the part.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, assert_never

import casadi as ca

from mbd_sim.dynamics.body_symbols import rotation_of_link
from mbd_sim.dynamics.kinematics import SymbolicPose
from mbd_sim.dynamics.spatial_algebra import constant, skew
from mbd_sim.dynamics.tracing import TracedMechanism

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
