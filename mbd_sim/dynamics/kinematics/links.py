"""The mechanism as links for the recursions: each part expressed in the frame of its inboard joint.

Branches of the spanning tree that have the same joints, such as four legs, are computed in vectors by a kernel.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import casadi as ca
import numpy as np

from mbd_sim.base.geometry.pose import Array, Pose, identity_pose
from mbd_sim.base.geometry.rotation import aligning_z
from mbd_sim.base.linear_algebra import product
from mbd_sim.dynamics.kinematics.joint_motions import JointAxes
from mbd_sim.dynamics.layouts.vectors import coordinate_layout
from mbd_sim.dynamics.math.spatial import inertia_matrix, is_absent
from mbd_sim.mechanism.elements.actuators import Actuator, CoordinatePort
from mbd_sim.mechanism.elements.parts import GROUND, Joint
from mbd_sim.mechanism.mechanism import Mechanism

COMPONENT_ROUND_OFF = 1e-15  # relative to a component, or to the largest component if the component stands for zero


@dataclass(frozen=True, eq=False)
class Disturbance:
    """Changes of position, velocity and acceleration (n,) of a joint that is driven by time, at a time `at` in s."""

    position: ca.SX
    velocity: ca.SX
    acceleration: ca.SX
    at: ca.SX


@dataclass(frozen=True, eq=False)
class Link:
    """A part and its inboard joint.

    `parent` is the index of the inboard link, -1 for ground. `X_PF` places the joint's inboard frame in that link's
    frame, and `axes` are expressed in the joint's frame. `X_LB` places the part's frame in the link's frame.
    `inertia` (6, 6) is about the link's origin; it includes a third of the mass of each spring with mass between the
    part and ground. `q` and `u` are the slices of the joint's coordinates and speeds, and `drive` is that of the states
    of a commanded drive in q. Links of disturbed equations have a `disturbance` of their drive.
    """

    joint: Joint
    parent: int
    X_PF: Pose
    axes: JointAxes
    X_LB: Pose
    inertia: Array
    q: slice
    u: slice
    drive: slice
    disturbance: Disturbance | None = None


def build_links(mechanism: Mechanism) -> list[Link]:
    """The links from ground outward, each frame rotated so that its joint's axis is a coordinate axis."""
    layout = coordinate_layout(mechanism)
    result: list[Link] = []
    index = {GROUND: -1}
    X_LB = {GROUND: identity_pose()}
    bodies = mechanism.bodies
    for joint in mechanism.tree_joints():
        inboard_pose, outboard_pose = joint.parent_pose, joint.child_pose
        if joint.reversed:
            inboard_pose, outboard_pose = outboard_pose, inboard_pose
        alignment, axes = _aligned(joint)
        part = bodies[joint.outboard]
        X_LB[part.name] = own = (outboard_pose @ alignment).inverse()
        center = _cleaned(own.position + product(own.rotation, part.center))
        inertia = _cleaned(product(product(own.rotation, part.inertia), own.rotation.T))
        X_PF = X_LB[joint.inboard] @ inboard_pose @ alignment
        result.append(
            Link(
                joint=joint,
                parent=index[joint.inboard],
                X_PF=Pose(_cleaned(X_PF.position), _cleaned(X_PF.rotation)),
                axes=axes,
                X_LB=own,
                inertia=inertia_matrix(part.mass, center, inertia) + _inertia_of_springs(mechanism, part.name, own),
                q=layout.q[joint.name],
                u=layout.u[joint.name],
                drive=layout.drives.get(joint.name, slice(0, 0)),
            )
        )
        index[part.name] = len(result) - 1
    return result


def _inertia_of_springs(mechanism: Mechanism, part: str, X_LB: Pose) -> Array:
    """The inertia (6, 6) of springs with mass between a part and ground, about the link's origin.

    The velocity is linear along the spring, zero at ground and v at the other end. Then T = ½ (m/3) v², which is that
    of a particle of mass m/3 at the end.
    """
    total = np.zeros((6, 6))
    for spring in mechanism.springs:
        for end in (spring.first, spring.second):
            if spring.mass and end.part == part:
                point = _cleaned(X_LB.position + product(X_LB.rotation, end.point))
                total = total + inertia_matrix(spring.mass / 3.0, point, np.zeros((3, 3)))
    return total


def _aligned(joint: Joint) -> tuple[Pose, JointAxes]:
    """The rotation of the joint's frames that makes its axes coordinate axes, and the axes after it."""
    axis = -joint.axis if joint.reversed and joint.kind.axial else joint.axis
    third = np.cross(axis, joint.second)
    if max(np.count_nonzero(axis), np.count_nonzero(joint.second)) <= 1:
        return identity_pose(), JointAxes(axis, joint.second, third, joint.lead)
    perpendicular = np.any(joint.second) and abs(float(product(axis, joint.second))) < COMPONENT_ROUND_OFF * 10
    rotation = np.column_stack([joint.second, third, axis]) if perpendicular else aligning_z(axis)
    second, third = (_cleaned(product(rotation.T, vector)) for vector in (joint.second, third))
    return Pose(np.zeros(3), rotation), JointAxes(np.array([0.0, 0.0, 1.0]), second, third, joint.lead)


def _cleaned(array: Array) -> Array:
    """The array with the round-off of zeros and ones removed, because structural zeros save instructions.

    A planar chain then costs the same in a plane of any orientation.
    """
    size, whole = np.abs(array), np.round(array)
    array = np.where(np.abs(array - whole) <= COMPONENT_ROUND_OFF * size, whole, array)
    return np.where(size <= COMPONENT_ROUND_OFF * np.max(size), 0.0, array)


def speed_rows(links: Sequence[Link]) -> dict[str, int]:
    """The index in u of each coordinate."""
    return {name: link.u.start + offset for link in links for offset, name in enumerate(link.joint.coordinate_names)}


def rotor_inertias(actuators: Sequence[Actuator], links: Sequence[Link], nv: int) -> ca.SX | None:
    """The inertias (nv,) of rotors as their coordinates feel them, N² J in kg·m² or kg; None without any.

    A rotor that turns N times as fast as its coordinate adds N² J to the diagonal of the mass matrix: its kinetic
    energy is ½ J (N q')². Its mass is that of the part that carries it, whose rotation changes this energy only by
    terms of the order of 1/N, which are left out (Featherstone, sec. 9.6).
    """
    rows, added, present = speed_rows(links), ca.SX(nv, 1), False
    for actuator in actuators:
        motor = actuator.motor
        if isinstance(actuator.port, CoordinatePort) and not is_absent(motor.rotor_inertia):
            added[rows[actuator.port.coordinate]] += motor.gear**2 * motor.rotor_inertia
            present = True
    return added if present else None


STATE, INPUTS = 1, 2  # the arguments of the rates
Shape: TypeAlias = tuple[object, ...]


def like_branches(links: Sequence[Link], nq: int) -> list[list[list[tuple[int, int]]]]:
    """Groups of branches that start at the same link and have joints of the same types in the same places.

    Joints without coordinates are passed over. A branch within a branch of a group belongs to that group.

    :param nq: the number of coordinates in the state.
    :return: for each group its branches, and of these the coordinates, speeds and efforts of their joints, each as the
        argument of the rates and the component, in the same order in all branches of a group.
    """
    outboard: dict[int, list[int]] = {}
    for index, link in enumerate(links):
        inboard = link.parent
        while inboard >= 0 and not _moves(links[inboard]):
            inboard = links[inboard].parent
        if _moves(link):
            outboard.setdefault(inboard, []).append(index)
    shapes: dict[int, Shape] = {}
    for index in reversed(range(len(links))):  # links are in order from ground outward
        shapes[index] = (links[index].joint.type, *(shapes[child] for child in outboard.get(index, ())))
    groups, waiting = [], [-1]
    while waiting:
        children = outboard.get(waiting.pop(), ())
        alike: dict[Shape, list[int]] = {}
        for child in children:
            alike.setdefault(shapes[child], []).append(child)
        for branches in alike.values():
            if len(branches) > 1:
                groups.append([_components(links, outboard, root, nq) for root in branches])
            else:
                waiting += branches
    return groups


def _moves(link: Link) -> bool:
    """Whether a link's joint has coordinates."""
    return link.joint.kind.nv > 0 and not link.joint.drive


def _components(links: Sequence[Link], outboard: dict[int, list[int]], root: int, nq: int) -> list[tuple[int, int]]:
    """The arguments and components that belong to the branch from a link outward: see `like_branches`."""
    found, waiting = [], [root]
    while waiting:
        index = waiting.pop()
        q, u = (range(span.start, span.stop) for span in (links[index].q, links[index].u))
        found += [*((STATE, i) for i in q), *((STATE, nq + i) for i in u), *((INPUTS, i) for i in u)]
        waiting += outboard.get(index, ())
    return found
