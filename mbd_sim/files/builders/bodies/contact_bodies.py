"""The bodies of contacts from the shapes of parts: balls, rims and corners on planes, round and convex bodies."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import assert_never

import numpy as np

from mbd_sim.base.geometry.batch import array
from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.base.linear_algebra import product as matrix_product
from mbd_sim.files.builders.bodies.outlines import planar_body
from mbd_sim.files.builders.bodies.shapes import hull_of, pose_of
from mbd_sim.files.schema import shapes as schema
from mbd_sim.mechanism.elements.contacts import (
    FIRST_RIM,
    LAST_RIM,
    Ball,
    Barrel,
    Cam,
    ConeBody,
    ContactBody,
    Curved,
    EllipsoidBody,
    Face,
    PlanarBody,
    Rim,
    Solid,
)
from mbd_sim.mechanism.elements.parts import Attachment

SIDES = {-1: "-", 1: "+"}
BLOCK = (  # the faces of a block, whose corners are numbered by x, y, z
    (0, 1, 3, 2),
    (4, 6, 7, 5),
    (0, 4, 5, 1),
    (2, 3, 7, 6),
    (0, 2, 6, 4),
    (1, 5, 7, 3),
)
MOST_SLOTS = 8  # of a pair: two faces with four corners each
ROUND_SLOTS = 6  # of a pair of cylinders, discs, rings or cones; two more with a solid, over whose edge they may lie


def edges(part: str, shape: schema.AnyShapeSpec | Pose) -> list[tuple[str, Ball | Rim | EllipsoidBody | PlanarBody]]:
    """What of a shape, or of a point, can touch a plane, each with a name: balls, rims, corners, tip and outline."""
    if isinstance(shape, Pose):
        return [("", Ball(Attachment(part, np.array(shape.position)), 0.0))]
    pose = pose_of(shape)

    def at(*offset: float) -> Attachment:
        return Attachment(part, pose.position + matrix_product(pose.rotation, array(offset)))

    def corners(*size: float) -> list[tuple[str, Ball | Rim | EllipsoidBody | PlanarBody]]:
        signs = [(-1, 1) if side else (1,) for side in size]
        return [
            (
                "corner "
                + "".join(SIDES[sign] + axis for sign, axis, side in zip(chosen, "xyz", size, strict=True) if side),
                Ball(at(*(0.5 * sign * side for sign, side in zip(chosen, size, strict=True))), 0.0),
            )
            for chosen in product(*signs)
        ]

    axis: Array = pose.rotation[:, 2]
    match shape:
        case schema.ParticleSpec():
            return [("", Ball(at(0.0, 0.0, 0.0), 0.0))]
        case schema.SphereSpec(radius=r):
            return [("", Ball(at(0.0, 0.0, 0.0), r))]
        case schema.RodSpec(start=start, end=end, radius=r):
            ends = (("from", start), ("to", end))
            return [(f"end {name}", Ball(Attachment(part, np.array(point)), r or 0.0)) for name, point in ends]
        case schema.DiscSpec(radius=r) | schema.RingSpec(radius=r):
            return [("", Rim(at(0.0, 0.0, 0.0), axis, r))]
        case schema.CylinderSpec(radius=r, length=length):
            first, last = (at(0.0, 0.0, 0.5 * side * length) for side in (-1, 1))
            return [
                (FIRST_RIM.strip(), Rim(first, axis, r, length)),
                (LAST_RIM.strip(), Rim(last, axis, r, length, first=False)),
            ]
        case schema.ConeSpec(radius=r, length=length):
            base, tip = (at(0.0, 0.0, 0.5 * side * length) for side in (-1, 1))
            return [("", Rim(base, axis, r)), ("tip", Ball(tip, 0.0))]
        case schema.CapsuleSpec(radius=r, length=length):
            return [(f"end {SIDES[side]}", Ball(at(0.0, 0.0, 0.5 * side * length), r)) for side in SIDES]
        case schema.EllipsoidSpec(radii=radii):
            return [("", EllipsoidBody(at(0.0, 0.0, 0.0), pose.rotation, radii))]
        case schema.HullSpec():
            found, _ = hull_of(shape)
            return [(f"corner {number}", Ball(at(*corner), 0.0)) for number, corner in enumerate(found, start=1)]
        case schema.PlateSpec(size=(x, y)):
            return corners(x, y, 0.0)
        case schema.BlockSpec(size=(x, y, z)):
            return corners(x, y, z)
        case schema.OutlineSpec():
            return [("", planar_body(part, shape, pose, hollow=False))]
        case _:
            assert_never(shape)


def round_body(part: str, shape: schema.AnyShapeSpec | Pose) -> Ball | Barrel | None:
    """A shape, or a point, as a ball or a cylinder; None for others."""
    if isinstance(shape, Pose):
        return Ball(Attachment(part, np.array(shape.position)), 0.0)
    pose = pose_of(shape)
    center = Attachment(part, pose.position)
    match shape:
        case schema.ParticleSpec():
            return Ball(center, 0.0)
        case schema.SphereSpec(radius=r):
            return Ball(center, r)
        case schema.DiscSpec(radius=r) | schema.RingSpec(radius=r):
            return Barrel(center, pose.rotation[:, 2], r, 0.0)
        case schema.CylinderSpec(radius=r, length=length):
            return Barrel(center, pose.rotation[:, 2], r, length)
        case (
            schema.RodSpec()
            | schema.PlateSpec()
            | schema.BlockSpec()
            | schema.ConeSpec()
            | schema.CapsuleSpec()
            | schema.EllipsoidSpec()
            | schema.HullSpec()
            | schema.OutlineSpec()
        ):
            return None
        case _:
            assert_never(shape)


def solid(part: str, shape: schema.AnyShapeSpec | Pose) -> Solid | Curved:
    """A shape, or a point, as a convex body."""
    if isinstance(shape, Pose):
        return polytope(part, [shape.position], (), 0.0)
    pose = pose_of(shape)

    def placed(*points: tuple[float, float, float]) -> list[Array]:
        return [pose.position + matrix_product(pose.rotation, np.array(point)) for point in points]

    match shape:
        case schema.ParticleSpec():
            return polytope(part, placed((0.0, 0.0, 0.0)), (), 0.0)
        case schema.SphereSpec(radius=r):
            return polytope(part, placed((0.0, 0.0, 0.0)), (), r)
        case schema.RodSpec(start=start, end=end, radius=r):
            return polytope(part, [np.array(start), np.array(end)], (), r or 0.0)
        case schema.PlateSpec(size=(x, y)):
            corners = [(0.5 * a * x, 0.5 * b * y, 0.0) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
            return polytope(part, placed(*corners), ((0, 1, 2, 3), (3, 2, 1, 0)), 0.0)
        case schema.BlockSpec(size=(x, y, z)):
            signs = product((-1, 1), repeat=3)
            return polytope(part, placed(*((0.5 * a * x, 0.5 * b * y, 0.5 * c * z) for a, b, c in signs)), BLOCK, 0.0)
        case schema.CapsuleSpec(radius=r, length=length):
            return polytope(part, placed((0.0, 0.0, -0.5 * length), (0.0, 0.0, 0.5 * length)), (), r)
        case schema.HullSpec():
            points, faces = hull_of(shape)
            return polytope(part, placed(*points), faces, 0.0)
        case schema.DiscSpec(radius=r) | schema.RingSpec(radius=r):
            return Barrel(Attachment(part, pose.position), pose.rotation[:, 2], r, 0.0)
        case schema.CylinderSpec(radius=r, length=length):
            return Barrel(Attachment(part, pose.position), pose.rotation[:, 2], r, length)
        case schema.ConeSpec(radius=r, length=length):
            return ConeBody(Attachment(part, pose.position), pose.rotation[:, 2], r, length)
        case schema.EllipsoidSpec(radii=radii):
            return EllipsoidBody(Attachment(part, pose.position), pose.rotation, radii)
        case schema.OutlineSpec():
            raise ValueError("an outline touches in its plane")
        case _:
            assert_never(shape)


def polytope(part: str, points: Sequence[Array], faces: tuple[tuple[int, ...], ...], radius: float) -> Solid:
    """A convex body with these vertices (3,) in the frame of the part; for `faces` see `Solid`."""
    return Solid(Attachment(part, np.zeros(3)), np.array(points), faces, radius)


def is_thin(body: Solid | Curved) -> bool:
    """Whether a body has no volume."""
    return body.thin if isinstance(body, Solid) else isinstance(body, Barrel) and body.length == 0.0


def slots_of(first: ContactBody, second: ContactBody, inside: bool, compliant: bool) -> int:
    """The number of points in which two bodies can touch with changing features; 0 if these never change."""
    if isinstance(first, PlanarBody) or isinstance(second, PlanarBody):
        return MOST_SLOTS  # fewer, once the plane is known
    if isinstance(first, Ball) and isinstance(second, Barrel):
        touches_ends = second.length > 0.0 or (first.radius > 0.0 and not inside)  # a ring around a ball is all edge
        return 1 if touches_ends and not compliant else 0
    static = inside or (compliant and isinstance(first, Barrel) and isinstance(second, Barrel))
    if static or isinstance(first, Ball | Rim | Cam) or isinstance(second, Ball | Face | Cam):
        return 0
    if isinstance(first, EllipsoidBody) or isinstance(second, EllipsoidBody):
        return 1
    if not isinstance(first, Solid) or not isinstance(second, Solid):
        vertices = [len(each.vertices) for each in (first, second) if isinstance(each, Solid)]
        return min([*vertices, ROUND_SLOTS + 2 * len(vertices)])
    fewest = min(len(first.vertices), len(second.vertices))
    corners = sum(max(map(len, each.faces), default=len(each.vertices)) for each in (first, second))
    return fewest if fewest <= 2 else min(corners, MOST_SLOTS)
