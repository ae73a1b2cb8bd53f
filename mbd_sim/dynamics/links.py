"""The mechanism as links for the recursions: each part seen from the frame of its inboard joint."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbd_sim.dynamics.joints import JOINT_TYPES, JointType
from mbd_sim.dynamics.spatial import inertia_matrix
from mbd_sim.mechanism.model import GROUND, Array, Joint, Mechanism, Pose, identity_pose
from mbd_sim.mechanism.rotation import aligning_z

ROUND_OFF = 1e-15  # relative to a component, or to the largest one where it stands for zero


@dataclass(frozen=True, eq=False)
class Link:
    """A part and its inboard joint.

    `parent` is the index of the inboard link (-1 for ground); `base` places the joint's inboard frame in that
    link's frame; `axis` is in the joint's frame; `part` places the part's frame in the link's; `inertia` (6, 6)
    is about the link's origin. `q` and `u` are where the joint's coordinates and speeds stand.
    """

    joint: Joint
    type: JointType
    parent: int
    base: Pose
    axis: Array
    part: Pose
    inertia: Array
    q: slice
    u: slice


@dataclass(frozen=True, eq=False)
class Layout:
    """Where each joint's coordinates stand in q (nq,) and its speeds in u (nv,): in declared order."""

    q: dict[str, slice]
    u: dict[str, slice]
    nq: int
    nv: int


def layout(mechanism: Mechanism) -> Layout:
    """The places of all coordinates and speeds."""
    q: dict[str, slice] = {}
    u: dict[str, slice] = {}
    nq = nv = 0
    for joint in mechanism.joints.values():
        type_ = JOINT_TYPES[joint.type]
        q[joint.name], u[joint.name] = slice(nq, nq + type_.nq), slice(nv, nv + type_.nv)
        nq, nv = nq + type_.nq, nv + type_.nv
    return Layout(q, u, nq, nv)


def links(mechanism: Mechanism) -> list[Link]:
    """The links from ground outwards; the frame of each is turned so that the joint's axis is a coordinate axis."""
    places = layout(mechanism)
    result: list[Link] = []
    index = {GROUND: -1}
    part_in_link = {GROUND: identity_pose()}
    for joint in mechanism.tree_joints():
        inboard_pose, outboard_pose = joint.parent_pose, joint.child_pose
        axis = joint.axis
        if joint.reversed:
            inboard_pose, outboard_pose, axis = outboard_pose, inboard_pose, -axis
        turn = identity_pose()
        if np.count_nonzero(axis) > 1:
            turn, axis = Pose(np.zeros(3), aligning_z(axis)), np.array([0.0, 0.0, 1.0])
        part = mechanism.parts[joint.outboard]
        placed = (outboard_pose @ turn).inverse()
        center = _cleaned(placed.position + placed.rotation @ part.center)
        inertia = _cleaned(placed.rotation @ part.inertia @ placed.rotation.T)
        base = part_in_link[joint.inboard] @ inboard_pose @ turn
        result.append(
            Link(
                joint=joint,
                type=JOINT_TYPES[joint.type],
                parent=index[joint.inboard],
                base=Pose(_cleaned(base.position), _cleaned(base.rotation)),
                axis=axis,
                part=placed,
                inertia=inertia_matrix(part.mass, center, inertia),
                q=places.q[joint.name],
                u=places.u[joint.name],
            )
        )
        index[part.name] = len(result) - 1
        part_in_link[part.name] = placed
    return result


def _cleaned(array: Array) -> Array:
    """The array with what is only round-off of zeros and ones removed: structural zeros are what saves instructions.

    A planar chain then costs the same in a plane of any direction.
    """
    size, whole = np.abs(array), np.round(array)
    array = np.where(np.abs(array - whole) <= ROUND_OFF * size, whole, array)
    return np.where(size <= ROUND_OFF * np.max(size), 0.0, array)
