"""Convex bodies that may be round, as the hull of points, circles and ellipsoids, and pairs of them.

A *corner* is a point, a rim or an ellipsoid: its support function is h(n) = c·n + √(n·K n), with K = 0, ρ² (1 - a aᵀ)
or A D² Aᵀ. A *side* is a line that slides along two corners, with normals n·d = k: an edge, with its direction d and
k = 0, or the generatrix of a cylinder or a cone, with its axis. A *face* is plane.

All sums are written out: their bits do not depend on the processor.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import product

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.rounded import sines_cosines
from mbd_sim.dynamics.constraints.rows import perpendiculars
from mbd_sim.dynamics.contact.shapes import POINTS
from mbd_sim.dynamics.contact.smooth_rows import FOUND_AT, SMOOTH_SIZE
from mbd_sim.mechanism.elements.contacts import Barrel, ConeBody, Curved, EllipsoidBody, Solid
from mbd_sim.simulation.contact.compiled.features.round.bodies import RoundHull
from mbd_sim.simulation.contact.compiled.features.round.normals import (
    CORNER_CORNER,
    CORNER_SIDE,
    SIDE_CORNER,
    RoundBodies,
)
from mbd_sim.simulation.contact.features.narrow_phase import Bounds, CompiledPhase
from mbd_sim.simulation.contact.features.polytopes import cross, dots

NEAR = 1e-7  # of the size of both bodies, within which two points of contact are one


@dataclass(frozen=True, eq=False)
class PlaneFace:
    """A plane face: its unit `normal` (3,), and a `border` (n, 3) of corners, or a circle about its `center`."""

    normal: Array
    center: Array
    border: Array
    radius: float


@dataclass(frozen=True, eq=False)
class RoundBody:
    """A body in the frame of its part; `roots` (n, 3, 3) are R with K = RᵀR of its corners (n, 3).

    `sides` are pairs of corners, with `directions` (m, 3) and `cosines` (m,); `faces` are plane. It is rounded by a
    `radius`. `curved` are the corners with a K that is not zero, and `ruled` the sides of cylinders and cones. `at`
    (3,) is the point at which the body is attached.
    """

    corners: Array
    roots: Array
    sides: NDArray[np.intp]
    directions: Array
    cosines: Array
    faces: tuple[PlaneFace, ...]
    radius: float
    curved: NDArray[np.bool_]
    ruled: NDArray[np.bool_]
    center: Array
    reach: float
    at: Array
    normals: Array = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "normals", np.array([face.normal for face in self.faces]).reshape(-1, 3))


def round_body(body: Curved | Solid) -> RoundBody:
    """A body of a contact."""
    match body:
        case Solid():
            return _polytope(body)
        case Barrel(radius=r, length=length):
            rims = ((-0.5 * length, r), (0.5 * length, r)) if length else ((0.0, r),)
            return _revolved(body.at.point, body.axis, rims)
        case ConeBody(radius=r, length=length):
            return _revolved(body.at.point, body.axis, ((-0.5 * length, r), (0.5 * length, 0.0)))
        case EllipsoidBody():
            root = np.array(body.radii)[:, None] * body.axes.T
            return _body(body.at.point[None], root[None], (), (), max(body.radii), 0.0, body.at.point)


def _polytope(solid: Solid) -> RoundBody:
    corners, sides = solid.vertices, []
    faces = []
    for loop in solid.faces:
        border = corners[list(loop)]
        normal = cross(border - border[0], np.roll(border, -1, axis=0) - border[0]).sum(axis=0)
        faces.append(PlaneFace(normal / np.sqrt(dots(normal, normal)), border[0], border, 0.0))
    for one, other in solid.edges:
        line = corners[other] - corners[one]
        sides.append((one, other, line / np.sqrt(dots(line, line)), 0.0))
    return _body(corners, np.zeros((len(corners), 3, 3)), sides, faces, 0.0, solid.radius, solid.at.point)


def _revolved(center: Array, axis: Array, rims: tuple[tuple[float, float], ...]) -> RoundBody:
    corners = np.array([center + height * axis for height, _ in rims])
    across = np.array([*perpendiculars(axis), np.zeros(3)])
    roots = np.array([radius * across for _, radius in rims])
    sides, faces, none = [], [], np.zeros((0, 3))
    for k in range(len(rims) - 1):
        (low, wide), (high, narrow) = rims[k], rims[k + 1]
        sides.append((k, k + 1, axis, (wide - narrow) / float(np.hypot(high - low, wide - narrow))))
    for sign, k in ((-1.0, 0), (1.0, len(rims) - 1)):
        if rims[k][1]:
            faces.append(PlaneFace(sign * axis, corners[k], none, rims[k][1]))
    return _body(corners, roots, sides, faces, max(radius for _, radius in rims), 0.0, center)


def _body(
    corners: Array, roots: Array, sides: object, faces: object, spread: float, radius: float, at: Array
) -> RoundBody:
    listed = list(sides)  # type: ignore[call-overload]
    curved = np.array([bool(np.any(root)) for root in roots])
    pairs = np.array([side[:2] for side in listed], dtype=np.intp).reshape(-1, 2)
    center = 0.5 * (corners.max(axis=0) + corners.min(axis=0))
    arms = corners - center
    return RoundBody(
        corners,
        roots,
        pairs,
        np.array([side[2] for side in listed]).reshape(-1, 3),
        np.array([side[3] for side in listed]).reshape(-1),
        tuple(faces),  # type: ignore[arg-type]
        radius,
        curved,
        np.array([bool(curved[pair].any()) for pair in pairs], dtype=bool),
        center,
        float(np.sqrt(dots(arms, arms).max())) + spread + radius,
        at,
    )


def hull_of(body: RoundBody) -> RoundHull:
    """The numbers of a body for compiled code; its rims have points at fixed angles."""
    rims = np.where(body.curved, np.sqrt(np.sum(body.roots**2, axis=(1, 2)) / 2.0), 0.0)
    arms = np.zeros((POINTS, 3))
    if body.curved.any() and len(body.faces):
        first, second = perpendiculars(body.directions[0] if len(body.directions) else body.faces[-1].normal)
        sines, cosines = sines_cosines(np.arange(POINTS, dtype=float) * (2.0 * np.pi / POINTS))
        arms = cosines[:, None] * first + sines[:, None] * second
    borders, inward = [], []
    for face in body.faces:
        lines = np.roll(face.border, -1, axis=0) - face.border
        borders.append(face.border)
        inward.append(cross(face.normal, lines) / np.sqrt(dots(lines, lines))[:, None])
    return RoundHull(
        len(body.corners),
        _numbers(body.corners),
        _numbers(body.roots),
        body.curved.astype(np.int64),
        bool(body.curved.any()),
        rims,
        rims if body.faces else body.curved.astype(float),
        arms.ravel(),
        len(body.sides),
        body.sides.astype(np.int64).ravel(),
        _numbers(body.directions),
        _numbers(body.cosines),
        body.ruled.astype(np.int64),
        len(body.faces),
        _numbers(body.normals),
        _numbers([face.center for face in body.faces]),
        _numbers([face.radius for face in body.faces]),
        np.cumsum([0, *map(len, borders)]),
        _numbers([point for border in borders for point in border]),
        _numbers([direction for each in inward for direction in each]),
        body.reach,
        body.at,
    )


def _numbers(values: object) -> Array:
    return np.array(values, dtype=float).ravel()


class SmoothPair(CompiledPhase):
    """Two convex bodies of which at least one is round, for `compiled.features.round`: see `NarrowPhase`."""

    def __init__(self, first: Curved | Solid, second: Curved | Solid, slots: int) -> None:
        bodies = round_body(first), round_body(second)
        radius, reach = bodies[0].radius + bodies[1].radius, bodies[0].reach + bodies[1].reach
        keys = _iterated(*bodies, rounded=radius > 0.0)
        numbers = np.array(keys, dtype=np.int64).ravel()
        record = RoundBodies(
            hull_of(bodies[0]), hull_of(bodies[1]), radius, NEAR * reach, reach, slots, len(keys), numbers
        )
        bounds = Bounds(bodies[0].center, bodies[0].reach), Bounds(bodies[1].center, bodies[1].reach)
        super().__init__("smooth", record, bounds, slots, SMOOTH_SIZE, iterates=True, found_at=FOUND_AT)


def _iterated(one: RoundBody, other: RoundBody, *, rounded: bool) -> list[tuple[int, int, int, int]]:
    """The kinds and indices of pairs of features whose normals are iterated."""
    corners = product(range(len(one.corners)), range(len(other.corners)))
    keys = [(CORNER_CORNER, i, j, 0) for i, j in corners if rounded or _can_meet(one, i, other, j)]
    keys += [(SIDE_CORNER, i, j, 0) for i, j in _side_corners(one, other, rounded)]
    keys += [(CORNER_SIDE, i, j, 0) for j, i in _side_corners(other, one, rounded)]
    return keys


def _can_meet(one: RoundBody, i: int, other: RoundBody, j: int) -> bool:
    """Whether sharp corners can meet at a smooth place: not a point with a point or with a rim."""
    smooth = (
        one.curved[i] and len(one.corners) == 1 and not one.faces,
        other.curved[j] and len(other.corners) == 1 and not other.faces,
    )
    return bool((one.curved[i] and other.curved[j]) or any(smooth))


def _side_corners(one: RoundBody, other: RoundBody, rounded: bool) -> list[tuple[int, int]]:
    """The sides of one body and the corners of another that can meet at a smooth place."""
    return [
        (i, j)
        for i, j in product(range(len(one.sides)), range(len(other.corners)))
        if rounded or one.ruled[i] or other.curved[j]
    ]
