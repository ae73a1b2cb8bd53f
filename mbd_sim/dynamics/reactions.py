"""What acts across the joints: the wrenches that links exert on each other, from the accelerations outside in."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from mbd_sim.dynamics.articulated_body import bias_force
from mbd_sim.dynamics.body_symbols import to_ground
from mbd_sim.dynamics.constraint_equations import Constraints
from mbd_sim.dynamics.kinematics import LinkMotion, WorldPose
from mbd_sim.dynamics.links import Link
from mbd_sim.dynamics.spatial_algebra import constant
from mbd_sim.geometry.pose import Pose
from mbd_sim.mechanism.records import GROUND, Mechanism


def transmitted_wrenches(
    links: Sequence[Link], motions: Sequence[LinkMotion], accelerations: Sequence[ca.SX], wrenches: Sequence[ca.SX]
) -> list[ca.SX]:
    """The wrench (6,) = [moment; force] on each link through its joint, own frame at its origin (Featherstone 5.3).

    :param accelerations: (6,) spatial acceleration of each link, less that of gravity.
    :param wrenches: (6,) what else acts on each link: force elements and constraints.
    """
    found = [
        ca.sparsify(constant(link.inertia) @ acceleration + bias_force(link, motion) - wrench)
        for link, motion, acceleration, wrench in zip(links, motions, accelerations, wrenches, strict=True)
    ]
    for index in reversed(range(len(links))):
        if (parent := links[index].parent) >= 0:
            found[parent] = ca.sparsify(found[parent] + motions[index].transform.T @ found[index])
    return found


def joint_reactions(
    mechanism: Mechanism,
    links: Sequence[Link],
    motions: Sequence[LinkMotion],
    poses: Sequence[WorldPose],
    transmitted: Sequence[ca.SX],
    constraints: Constraints,
    multipliers: ca.SX,
) -> ca.SX:
    """(6, joints): force (3,) and moment (3,) on each joint's second part by its first, in ground's axes.

    The moment is about the joint's frame on the second part. The joints of the tree come first, each with all that
    goes through it: what it constrains, its springs and its effort; then those that close loops.
    """
    at = {link.joint.outboard: index for index, link in enumerate(links)}
    by_joint = {link.joint.name: index for index, link in enumerate(links)}

    def point(part: str, frame: Pose) -> ca.SX:
        if part == GROUND:
            return constant(frame.position)
        pose = poses[at[part]]
        return pose.position + pose.rotation @ constant(frame.position)

    def on_part(index: int, wrench: ca.SX, about: ca.SX) -> ca.SX:
        """A wrench in a link's frame as force and moment about a point, in ground's axes."""
        link, turn = links[index], to_ground(links[index], poses[index])
        origin = poses[index].position - turn @ constant(link.part.position)
        force = turn @ wrench[3:]
        return ca.vertcat(force, turn @ wrench[:3] + ca.cross(origin - about, force))

    columns = []
    for joint in mechanism.joints.values():
        index = by_joint[joint.name]
        wrench = on_part(index, transmitted[index], point(joint.child, joint.child_pose))
        columns.append(-wrench if joint.reversed else wrench)
    for joint in mechanism.closing.values():
        own = [number for number, row in enumerate(constraints.rows) if row.owner == ("joints", joint.name)]
        part, sign = (joint.parent, -1.0) if joint.child == GROUND else (joint.child, 1.0)
        wrench = constraints.wrenches[at[part]][:, own] @ multipliers[own]
        columns.append(sign * on_part(at[part], wrench, point(joint.child, joint.child_pose)))
    return ca.horzcat(ca.SX(6, 0), *columns)
