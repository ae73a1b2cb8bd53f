"""The shapes of parts as bodies of contacts: balls, rims and corners."""

from __future__ import annotations

from itertools import product

import numpy as np

from mbd_sim.geometry.pose import Array, Pose
from mbd_sim.mechanism.contacts import FIRST_RIM, LAST_RIM, Ball, Barrel, Rim
from mbd_sim.mechanism.records import Attachment
from mbd_sim.mechanism_file.builders.shape_builder import pose_of
from mbd_sim.mechanism_file.schema import shape_schema as schema

SIDES = {-1: "-", 1: "+"}


def edges(part: str, shape: schema.AnyShapeSpec | Pose) -> list[tuple[str, Ball | Rim]]:
    """What of a shape, or of a point, can touch a plane, each with a name: its balls, rims and corners."""
    if isinstance(shape, Pose):
        return [("", Ball(Attachment(part, np.array(shape.position)), 0.0))]
    pose = pose_of(shape)

    def at(*offset: float) -> Attachment:
        return Attachment(part, pose.position + pose.rotation @ np.array(offset))

    def corners(*size: float) -> list[tuple[str, Ball | Rim]]:
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
        case schema.PlateSpec(size=(x, y)):
            return corners(x, y, 0.0)
        case schema.BlockSpec(size=(x, y, z)):
            return corners(x, y, z)


def round_body(part: str, shape: schema.AnyShapeSpec | Pose) -> Ball | Barrel | None:
    """A shape, or a point, as a ball or a cylinder; None for shapes with corners."""
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
        case schema.RodSpec() | schema.PlateSpec() | schema.BlockSpec():
            return None
