"""The mechanism as links for the recursions: each part seen from the frame of its inboard joint."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbd_sim.dynamics.joint_motions import Axes
from mbd_sim.dynamics.spatial_algebra import inertia_matrix
from mbd_sim.geometry.pose import Array, Pose, identity_pose
from mbd_sim.geometry.rotation import aligning_z
from mbd_sim.mechanism.records import GROUND, Joint, Mechanism

ROUND_OFF = 1e-15  # relative to a component, or to the largest one where it stands for zero


@dataclass(frozen=True, eq=False)
class Link:
    """A part and its inboard joint.

    `parent` is the index of the inboard link (-1 for ground); `base` places the joint's inboard frame in that
    link's frame; `axes` are in the joint's frame; `part` places the part's frame in the link's; `inertia` (6, 6)
    is about the link's origin, with a third of each spring with a mass that runs from the part to ground. `q` and
    `u` are where the joint's coordinates and speeds stand, if it has any.
    """

    joint: Joint
    parent: int
    base: Pose
    axes: Axes
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
        more_q, more_v = (0, 0) if joint.drive else (joint.kind.nq, joint.kind.nv)
        q[joint.name], u[joint.name] = slice(nq, nq + more_q), slice(nv, nv + more_v)
        nq, nv = nq + more_q, nv + more_v
    return Layout(q, u, nq, nv)


def links(mechanism: Mechanism) -> list[Link]:
    """The links from ground outwards; the frame of each is turned so that the joint's axis is a coordinate axis."""
    places = layout(mechanism)
    result: list[Link] = []
    index = {GROUND: -1}
    part_in_link = {GROUND: identity_pose()}
    for joint in mechanism.tree_joints():
        inboard_pose, outboard_pose = joint.parent_pose, joint.child_pose
        if joint.reversed:
            inboard_pose, outboard_pose = outboard_pose, inboard_pose
        turn, axes = _aligned(joint)
        part = mechanism.parts[joint.outboard]
        placed = (outboard_pose @ turn).inverse()
        center = _cleaned(placed.position + placed.rotation @ part.center)
        inertia = _cleaned(placed.rotation @ part.inertia @ placed.rotation.T)
        base = part_in_link[joint.inboard] @ inboard_pose @ turn
        result.append(
            Link(
                joint=joint,
                parent=index[joint.inboard],
                base=Pose(_cleaned(base.position), _cleaned(base.rotation)),
                axes=axes,
                part=placed,
                inertia=inertia_matrix(part.mass, center, inertia) + _of_springs(mechanism, part.name, placed),
                q=places.q[joint.name],
                u=places.u[joint.name],
            )
        )
        index[part.name] = len(result) - 1
        part_in_link[part.name] = placed
    return result


def _of_springs(mechanism: Mechanism, part: str, placed: Pose) -> Array:
    """The inertia (6, 6) of springs with mass from a part to ground.

    With a velocity that grows evenly from ground to v at the end, T = ½ (m/3) v²: a particle of m/3 at the end.
    """
    total = np.zeros((6, 6))
    for spring in mechanism.springs:
        for end in (spring.first, spring.second):
            if spring.mass and end.part == part:
                point = _cleaned(placed.position + placed.rotation @ end.point)
                total += inertia_matrix(spring.mass / 3.0, point, np.zeros((3, 3)))
    return total


def _aligned(joint: Joint) -> tuple[Pose, Axes]:
    """A turn of the joint's frames after which its axes are coordinate axes, and the axes then."""
    axis = -joint.axis if joint.reversed and joint.kind.axial else joint.axis
    third = np.cross(axis, joint.second)
    if max(np.count_nonzero(axis), np.count_nonzero(joint.second)) <= 1:
        return identity_pose(), Axes(axis, joint.second, third, joint.lead)
    perpendicular = np.any(joint.second) and abs(float(axis @ joint.second)) < ROUND_OFF * 10
    rotation = np.column_stack([joint.second, third, axis]) if perpendicular else aligning_z(axis)
    second, third = (_cleaned(rotation.T @ vector) for vector in (joint.second, third))
    return Pose(np.zeros(3), rotation), Axes(np.array([0.0, 0.0, 1.0]), second, third, joint.lead)


def _cleaned(array: Array) -> Array:
    """The array with what is only round-off of zeros and ones removed: structural zeros are what saves instructions.

    A planar chain then costs the same in a plane of any direction.
    """
    size, whole = np.abs(array), np.round(array)
    array = np.where(np.abs(array - whole) <= ROUND_OFF * size, whole, array)
    return np.where(size <= ROUND_OFF * np.max(size), 0.0, array)
