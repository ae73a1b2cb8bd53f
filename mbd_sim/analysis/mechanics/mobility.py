"""Degrees of freedom, by Kutzbach's criterion and by rank (Huston & Liu, ch. 11; Lidström, ch. 1).

Whether velocity constraints are integrable is decided by the theorem of Frobenius (Géradin & Rixen, sec. 1.3).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import assert_never

import casadi as ca
import numpy as np

from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.dynamics.constraints.functions import scaled
from mbd_sim.dynamics.constraints.rows import ConstraintRow
from mbd_sim.dynamics.constraints.start import AssembledStart
from mbd_sim.dynamics.equations import Equations
from mbd_sim.dynamics.math.rank import null_space
from mbd_sim.mechanism.elements import constraints as c
from mbd_sim.mechanism.elements.constraints import two_sided
from mbd_sim.mechanism.elements.parts import GROUND, Attachment
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.natural_units import natural_units

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
    removed = sum(6 - (0 if joint.drive else joint.kind.nv) for joint in joints)
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


VANISHING = 1e-9  # the skew-symmetric part that counts as zero, relative to the derivatives


def integrable_rows(equations: Equations) -> dict[int, bool]:
    """For each velocity constraint, by the index of its row, whether it is the derivative of a position constraint.

    A row is a form ω = a(x) dx, where x is the coordinates and the time. A set of rows is integrable if and only if
    each dω vanishes on all pairs of directions that these rows and the holonomic ones allow. Rows for which it does
    not vanish are removed from the set, which allows more directions, until no row has to be removed (the derived
    flag). The test is made in configurations around the start.
    """
    rows = [index for index, row in enumerate(equations.rows) if row.position is None]
    if not rows:
        return {}
    nq, nv = equations.layout.nq, equations.layout.nv
    t, q, u = ca.SX.sym("t"), ca.SX.sym("q", nq), ca.SX.sym("u", nv)
    y = ca.vertcat(q, u, ca.SX.zeros(equations.start_state.size - nq - nv))
    velocity = equations.violation(t, y)[:, 1]
    q_rates = equations.rates.call([t, y, ca.SX.zeros(equations.inputs.size)])[0][:nq]
    to_rates = ca.jacobian(q_rates, u)
    gradient = ca.jacobian(velocity, u)
    drift = ca.substitute([velocity], [u], [ca.SX.zeros(nv)])[0]
    inverse = ca.solve(to_rates.T @ to_rates, to_rates.T)
    forms = ca.horzcat(gradient @ inverse, drift)
    x = ca.vertcat(q, t)
    derivatives = [ca.jacobian(forms[index, :].T, x) for index in rows]
    function = ca.Function("forms", [t, q], [gradient, drift, to_rates, *derivatives])
    values = [
        [np.array(value) for value in function(time, configuration)] for time, configuration in equations.start.nearby
    ]
    scales, rate = equations.constraints.scales, natural_units(equations.mechanism, equations.step).rate
    row_sizes = [equations.constraints.row_sizes(time, configuration) for time, configuration in equations.start.nearby]
    left, removed = set(rows), set(rows)
    while removed:
        kept = [index for index in range(len(equations.rows)) if index not in rows or index in left]
        removed = {
            index
            for sizes, (g, b, n, *jacobians) in zip(row_sizes, values, strict=True)
            for index, jacobian in zip(rows, jacobians, strict=True)
            if index in left
            and not _closed(jacobian, _directions(g[kept], b[kept], n, sizes[kept], scales, rate), sizes[index])
        }
        left -= removed
    return {index: index in left for index in rows}


def _closed(jacobian: Array, allowed: Array, size: float) -> bool:
    """Whether dω, the skew-symmetric part of the form's Jacobian, vanishes on the allowed directions.

    :param size: the natural size of the row.
    """
    skew = allowed.T @ (jacobian - jacobian.T) @ allowed
    terms = np.abs(allowed.T) @ np.abs(jacobian) @ np.abs(allowed)
    return _largest(skew) <= VANISHING * max(_largest(terms), size)


def _largest(values: Array) -> float:
    return float(np.max(np.abs(values), initial=0.0))


def _directions(gradient: Array, drift: Array, to_rates: Array, row_sizes: Array, scales: Array, rate: float) -> Array:
    """A basis (nq + 1, k) of the directions in coordinates and time that the constraints allow."""
    both, units = np.hstack([gradient, drift.reshape(-1, 1)]), np.append(scales, 1.0 / rate)
    basis = units[:, None] * null_space(scaled(both, row_sizes, units))
    return np.vstack([to_rates @ basis[:-1], basis[-1:]])
