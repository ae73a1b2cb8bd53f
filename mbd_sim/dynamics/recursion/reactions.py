"""The wrenches across the joints, from the accelerations by recursion toward ground."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from mbd_sim.base.geometry.pose import Pose
from mbd_sim.dynamics.constraints.equations import ConstraintEquations
from mbd_sim.dynamics.forces.bushings import bushing_in_ground
from mbd_sim.dynamics.kinematics.links import Link
from mbd_sim.dynamics.kinematics.poses import LinkMotion, rotation_of_link
from mbd_sim.dynamics.kinematics.tracing import TracedMechanism
from mbd_sim.dynamics.kinematics.wrenches import AppliedWrenches
from mbd_sim.dynamics.math.spatial import constant
from mbd_sim.dynamics.recursion.articulated_body import bias_force
from mbd_sim.mechanism.elements.parts import GROUND


def transmitted_wrenches(
    links: Sequence[Link], motions: Sequence[LinkMotion], accelerations: Sequence[ca.SX], wrenches: Sequence[ca.SX]
) -> list[ca.SX]:
    """The wrench F_L (6,) = [moment; force] on each link through its inboard joint (Featherstone, sec. 5.3).

    :param accelerations: spatial acceleration (6,) of each link in L, less that of gravity.
    :param wrenches: F_L (6,) of everything else on each link: force elements and constraints.
    """
    transmitted = [
        ca.sparsify(constant(link.inertia) @ acceleration + bias_force(link, motion) - wrench)
        for link, motion, acceleration, wrench in zip(links, motions, accelerations, wrenches, strict=True)
    ]
    for index in reversed(range(len(links))):
        if (parent := links[index].parent) >= 0:
            transmitted[parent] = ca.sparsify(transmitted[parent] + motions[index].transform.T @ transmitted[index])
    return transmitted


def wrenches_of_multipliers(
    traced: TracedMechanism, constraints: ConstraintEquations, multipliers: ca.SX
) -> list[ca.SX]:
    """What multipliers λ (m,) that change no acceleration add to `transmitted_wrenches`: F_L (6,) of each link."""
    transmitted = [ca.sparsify(-unit @ multipliers) for unit in constraints.wrenches]
    for index in reversed(range(len(traced.links))):
        if (parent := traced.links[index].parent) >= 0:
            carried = traced.motions[index].transform.T @ transmitted[index]
            transmitted[parent] = ca.sparsify(transmitted[parent] + carried)
    return transmitted


def joint_reactions(
    traced: TracedMechanism, transmitted: Sequence[ca.SX], constraints: ConstraintEquations, multipliers: ca.SX
) -> ca.SX:
    """Force (3,) in N and moment (3,) in N·m on each joint's second part by its first, in ground's axes: (6, joints).

    The moment is about the origin of the joint's frame on the second part. The joints of the tree come first, each with
    everything that it transmits: its constraint forces, springs and effort. Those that close loops come after them.

    Springs of joints whose orientation has no coordinates are not among them: see `joint_springs`.

    :param transmitted: F_L (6,) of each link, from `transmitted_wrenches`.
    :param multipliers: λ (m,) of all rows of the constraints.
    """
    mechanism, links, poses = traced.mechanism, traced.links, traced.poses
    link_of_part = {link.joint.outboard: index for index, link in enumerate(links)}
    link_of_joint = {link.joint.name: index for index, link in enumerate(links)}

    def origin_in_ground(part: str, frame: Pose) -> ca.SX:
        if part == GROUND:
            return constant(frame.position)
        X_WB = poses[link_of_part[part]]
        return X_WB.position + X_WB.rotation @ constant(frame.position)

    def in_ground(index: int, F_L: ca.SX, about: ca.SX) -> ca.SX:
        """A wrench on a link as force and moment about a point, in ground's axes."""
        link, R_WL = links[index], rotation_of_link(links[index], poses[index])
        p_WL = poses[index].position - R_WL @ constant(link.X_LB.position)
        force = R_WL @ F_L[3:]
        return ca.vertcat(force, R_WL @ F_L[:3] + ca.cross(p_WL - about, force))

    columns = []
    for joint in mechanism.joints.values():
        index = link_of_joint[joint.name]
        wrench = in_ground(index, transmitted[index], origin_in_ground(joint.child, joint.child_pose))
        columns.append(-wrench if joint.reversed else wrench)
    for joint in mechanism.closing.values():
        own = [number for number, row in enumerate(constraints.rows) if row.owner == ("joints", joint.name)]
        part, sign = (joint.parent, -1.0) if joint.child == GROUND else (joint.child, 1.0)
        index = link_of_part[part]
        F_L = constraints.wrenches[index][:, own] @ multipliers[own]
        columns.append(sign * in_ground(index, F_L, origin_in_ground(joint.child, joint.child_pose)))
    return ca.horzcat(ca.SX(6, 0), *columns)


def joint_springs(traced: TracedMechanism) -> ca.SX:
    """What the springs of spherical and free joints, which act as bushings, add to `joint_reactions`: (6, joints)."""
    mechanism = traced.mechanism
    columns = {name: ca.SX(6, 1) for name in mechanism.all_joints}
    applied = AppliedWrenches(traced.links, traced.motions, traced.poses)
    for bushing in mechanism.bushings:
        if bushing.in_joint:
            found, _ = bushing_in_ground(applied, bushing)
            columns[bushing.name] = ca.vertcat(found.force, found.couple)
    return ca.horzcat(ca.SX(6, 0), *columns.values())
