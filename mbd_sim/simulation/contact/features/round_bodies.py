"""Convex bodies that may be round, as the hull of points, circles and ellipsoids.

A *corner* is a point, a rim or an ellipsoid: its support function is h(n) = c·n + √(n·K n), with K = 0, ρ² (1 - a aᵀ)
or A D² Aᵀ. A *side* is a line that slides along two corners, with normals n·d = k: an edge, with its direction d and
k = 0, or the generatrix of a cylinder or a cone, with its axis. A *face* is plane.

All sums are written out: their bits do not depend on the processor.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.mechanism.elements.contacts import Barrel, ConeBody, Curved, EllipsoidBody, Solid
from mbd_sim.simulation.contact.features.polytopes import cross, dots, turned

TINY = 1e-60


@dataclass(frozen=True, eq=False)
class PlaneFace:
    """A plane face: its unit `normal` (3,), and a `border` (n, 3) of corners, or a circle about its `center`."""

    normal: Array
    center: Array
    border: Array
    radius: float


@dataclass(frozen=True, eq=False)
class RoundBody:
    """A body in the frame of its part; `grams` (n, 3, 3) are the matrices K of its corners (n, 3).

    `sides` are pairs of corners, with `directions` (m, 3) and `cosines` (m,); `faces` are plane. It is rounded by a
    `radius`. `curved` are the corners with a K that is not zero, and `ruled` the sides of cylinders and cones.
    """

    corners: Array
    grams: Array
    sides: NDArray[np.intp]
    directions: Array
    cosines: Array
    faces: tuple[PlaneFace, ...]
    radius: float
    curved: NDArray[np.bool_]
    ruled: NDArray[np.bool_]
    center: Array
    reach: float
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
            gram = sum(
                (radius**2 * np.outer(axis, axis) for radius, axis in zip(body.radii, body.axes.T, strict=True)),
                np.zeros((3, 3)),
            )
            return _body(body.at.point[None], gram[None], (), (), max(body.radii), 0.0)


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
    return _body(corners, np.zeros((len(corners), 3, 3)), sides, faces, 0.0, solid.radius)


def _revolved(center: Array, axis: Array, rims: tuple[tuple[float, float], ...]) -> RoundBody:
    corners = np.array([center + height * axis for height, _ in rims])
    across = np.eye(3) - np.outer(axis, axis)
    grams = np.array([radius**2 * across for _, radius in rims])
    sides, faces, none = [], [], np.zeros((0, 3))
    for k in range(len(rims) - 1):
        (low, wide), (high, narrow) = rims[k], rims[k + 1]
        sides.append((k, k + 1, axis, (wide - narrow) / float(np.hypot(high - low, wide - narrow))))
    for sign, k in ((-1.0, 0), (1.0, len(rims) - 1)):
        if rims[k][1]:
            faces.append(PlaneFace(sign * axis, corners[k], none, rims[k][1]))
    return _body(corners, grams, sides, faces, max(radius for _, radius in rims), 0.0)


def _body(corners: Array, grams: Array, sides: object, faces: object, spread: float, radius: float) -> RoundBody:
    listed = list(sides)  # type: ignore[call-overload]
    curved = np.array([bool(np.any(gram)) for gram in grams])
    pairs = np.array([side[:2] for side in listed], dtype=np.intp).reshape(-1, 2)
    center = 0.5 * (corners.max(axis=0) + corners.min(axis=0))
    arms = corners - center
    return RoundBody(
        corners,
        grams,
        pairs,
        np.array([side[2] for side in listed]).reshape(-1, 3),
        np.array([side[3] for side in listed]).reshape(-1),
        tuple(faces),  # type: ignore[arg-type]
        radius,
        curved,
        np.array([bool(curved[pair].any()) for pair in pairs], dtype=bool),
        center,
        float(np.sqrt(dots(arms, arms).max())) + spread + radius,
    )


def times(matrices: Array, vectors: Array) -> Array:
    """Products (..., 3) of symmetric matrices (..., 3, 3) and vectors (..., 3)."""
    return np.stack([dots(matrices[..., row, :], vectors) for row in range(3)], axis=-1)


class PlacedBody:
    """A body at a pose, in ground's axes, with positions relative to an `origin` (3,)."""

    def __init__(self, body: RoundBody, pose: Pose, origin: Array) -> None:
        self.body, self.rotation, self.position = body, pose.rotation, pose.position - origin
        self.corners = turned(pose.rotation, body.corners) + self.position
        self.directions = turned(pose.rotation, body.directions)
        self.normals = turned(pose.rotation, body.normals)

    def offsets(self, corners: NDArray[np.intp], normals: Array) -> Array:
        """From corners (k,) to their farthest points (k, 3) along normals (k, 3)."""
        own = turned(self.rotation.T, normals)
        found = times(self.body.grams[corners], own)
        size = np.sqrt(np.maximum(dots(own, found), 0.0) + TINY)
        return turned(self.rotation, found / size[..., None])

    def bends(self, corners: NDArray[np.intp], normals: Array) -> Array:
        """The derivatives (k, 3, 3) of the offsets by the normals, in ground's axes."""
        own = turned(self.rotation.T, normals)
        grams = self.body.grams[corners]
        found = times(grams, own)
        size = np.sqrt(np.maximum(dots(own, found), 0.0) + TINY)
        arm = found / size[..., None]
        inner = (grams - arm[..., :, None] * arm[..., None, :]) / size[..., None, None]
        half = np.stack([turned(self.rotation, inner[..., row, :]) for row in range(3)], axis=-2)
        return np.stack([turned(self.rotation, half[..., :, row]) for row in range(3)], axis=-1)

    def heights(self, normals: Array) -> Array:
        """How far in m all corners (k, corners) reach along normals (k, 3)."""
        own = turned(self.rotation.T, normals)[:, None]
        squares = dots(own, times(self.body.grams, own))
        return np.asarray(dots(self.corners, normals[:, None]) + np.sqrt(np.maximum(squares, 0.0) + TINY))

    def inside(self, face: int, point: Array) -> float:
        """How far in m a point (3,) is inside the border of a face, seen along its normal."""
        own, known = turned(self.rotation.T, point - self.position), self.body.faces[face]
        arm = own - known.center
        if known.radius:
            aside = arm - known.normal * dots(arm, known.normal)
            return known.radius - float(np.sqrt(dots(aside, aside)))
        lines = np.roll(known.border, -1, axis=0) - known.border
        inward = cross(known.normal, lines) / np.sqrt(dots(lines, lines))[:, None]
        return float(dots(own - known.border, inward).min())

    def lead(self, corners: list[int], normal: Array) -> float:
        """How far in m the first of some corners reaches beyond all others than these along a normal (3,)."""
        heights = self.heights(normal[None])[0]
        others = [height for k, height in enumerate(heights.tolist()) if k not in corners]
        return float(heights[corners[0]]) - max(others, default=-np.inf)
