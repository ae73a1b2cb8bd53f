"""Degrees of freedom, by Kutzbach's criterion and by rank (Huston & Liu, ch. 11; Lidström, ch. 1)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import assert_never

import numpy as np

from mbd_sim.dynamics.constraint_rows import ConstraintRow
from mbd_sim.dynamics.initial_conditions import AssembledStart
from mbd_sim.geometry.pose import Array, Pose
from mbd_sim.mechanism import constraints as c
from mbd_sim.mechanism.one_sided import two_sided
from mbd_sim.mechanism.records import (
    GROUND,
    Attachment,
    Joint,
    Mechanism,
)

PARALLEL = 1e-9  # the difference of two unit vectors that count as parallel


@dataclass(frozen=True)
class Mobility:
    """The degrees of freedom of a mechanism.

    `gross` is 6 N for N parts. Joints and drives remove `joint_equations` of them, and the other constraints
    `other_equations`; `kutzbach` is the difference. `planar_kutzbach` is the same count with 3 N, or None if the
    mechanism does not move in one plane.

    `coordinates` is the number of speeds of the spanning tree, and `equations` the number of rows of the constraint
    matrix G. `rank` is the largest rank of G along a short run, and `rank_at_start` that at the start.
    `degrees_of_freedom` is coordinates - rank; `redundant` names the equations that the others imply, and
    `static_indeterminacy` is their number: that of the load components that equilibrium does not determine.
    """

    gross: int
    joint_equations: int
    other_equations: int
    kutzbach: int
    planar_kutzbach: int | None
    coordinates: int
    equations: int
    rank: int
    rank_at_start: int
    degrees_of_freedom: int
    redundant: tuple[str, ...]
    static_indeterminacy: int


def mobility(
    mechanism: Mechanism, rows: Sequence[ConstraintRow], start: AssembledStart, poses: Mapping[str, Pose]
) -> Mobility:
    """Count the degrees of freedom.

    :param rows: the equations of loops and constraints, and `start` a configuration that satisfies them.
    :param poses: of the parts at the start, in ground's frame.
    """
    joints = list(mechanism.all_joints.values())
    removed = sum(6 - _freedoms(joint) for joint in joints)
    others = sum(row.owner[0] == "constraints" for row in rows)
    size = len(start.u)
    return Mobility(
        gross=6 * len(mechanism.parts),
        joint_equations=removed,
        other_equations=others,
        kutzbach=6 * len(mechanism.parts) - removed - others,
        planar_kutzbach=_planar(mechanism, {**poses, GROUND: Pose(np.zeros(3), np.eye(3))}),
        coordinates=size,
        equations=len(rows),
        rank=start.rank,
        rank_at_start=start.ranks[0],
        degrees_of_freedom=size - start.rank,
        redundant=tuple(row.name for index, row in enumerate(rows) if index not in start.independent),
        static_indeterminacy=len(rows) - start.rank,
    )


def _freedoms(joint: Joint) -> int:
    return 0 if joint.drive else joint.kind.nv


def _planar(mechanism: Mechanism, poses: Mapping[str, Pose]) -> int | None:
    """Kutzbach's count in the plane, or None if the mechanism can also move out of one plane."""
    joints = list(mechanism.all_joints.values())
    if any(joint.kind.planar_freedoms is None for joint in joints):
        return None
    axes = {j.name: poses[j.parent].rotation @ j.parent_pose.rotation @ j.axis for j in joints if j.axis.any()}
    slides = [axes[j.name] for j in joints if j.name in axes and not j.kind.rotates]
    normals = [axes[j.name] for j in joints if j.kind.rotates]
    normals += [np.cross(slides[0], slide) for slide in slides if not _parallel(slides[0], slide)]
    if not normals:
        return None
    normal = normals[0] / np.linalg.norm(normals[0])
    if not all(_parallel(other, normal) for other in normals) or not all(
        _perpendicular(slide, normal) for slide in slides
    ):
        return None
    equations = 0
    for constraint in two_sided(mechanism.constraints):
        if (count := _planar_equations(constraint, poses, normal)) is None:
            return None
        equations += count
    removed = sum(3 - (0 if joint.drive else joint.kind.planar_freedoms or 0) for joint in joints)
    return 3 * len(mechanism.parts) - removed - equations


def _planar_equations(constraint: c.Constraint, poses: Mapping[str, Pose], normal: Array) -> int | None:
    """The number of equations of a constraint in a plane, or None if it does not lie in the plane."""

    def world(at: Attachment, direction: Array) -> Array:
        return poses[at.part].rotation @ direction

    def position(at: Attachment) -> Array:
        return poses[at.part].position + poses[at.part].rotation @ at.point

    match constraint:
        case c.Coupling() | c.Clutch():
            return 1
        case c.Distance(first=first, second=second):
            return 1 if _perpendicular(position(second) - position(first), normal) else None
        case c.Cable(points=points):
            return 1 if all(_perpendicular(position(point) - position(points[0]), normal) for point in points) else None
        case c.Flat(base=base, normals=normals):
            directions = [world(base, direction) for direction in normals]
            inside = [direction for direction in directions if not _parallel(direction, normal)]
            return len(inside) if all(_perpendicular(direction, normal) for direction in inside) else None
        case c.Rolling(axis=axis, center=center, plane=plane, normal=up) if axis is not None:
            upright = _parallel(world(center, axis), normal) and _perpendicular(world(plane, up), normal)
            return 2 if upright else None
        case c.Rolling() | c.Surface():
            return None
        case c.KnifeEdge(plane=plane, normal=up):
            return 1 if _parallel(world(plane, up), normal) else None
        case _:
            assert_never(constraint)


def _parallel(direction: Array, normal: Array) -> bool:
    return bool(np.linalg.norm(np.cross(direction, normal)) < PARALLEL)


def _perpendicular(direction: Array, normal: Array) -> bool:
    return bool(abs(float(direction @ normal)) < PARALLEL * max(1.0, float(np.linalg.norm(direction))))
