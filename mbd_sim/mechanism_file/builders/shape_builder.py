"""From the shapes of a file to mass properties and to shapes to draw (Huston & Liu, ch. 7)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mbd_sim.errors import InputError
from mbd_sim.geometry import rotation as rot
from mbd_sim.geometry.pose import Pose
from mbd_sim.mechanism.mass_properties import MassProperties, composite
from mbd_sim.mechanism.records import Shape
from mbd_sim.mechanism_file.builders.rotation_builder import rotation_matrix
from mbd_sim.mechanism_file.schema import file_schema


@dataclass(frozen=True)
class _Solid:
    dimension: int  # 0 particle, 1 line, 2 surface, 3 solid: sizes of one dimension can be compared
    measure: float  # m^dimension, 1 for a particle
    moments: tuple[float, float, float]  # principal moments for unit mass about the centre, m²


def _box(x: float, y: float, z: float) -> tuple[float, float, float]:
    return ((y * y + z * z) / 12.0, (z * z + x * x) / 12.0, (x * x + y * y) / 12.0)


def _round(radius_squared: float, length: float, share: float) -> tuple[float, float, float]:
    across = share * radius_squared / 2.0 + length * length / 12.0
    return (across, across, share * radius_squared)


def _solid(shape: file_schema.ShapeSpec) -> _Solid:
    match shape:
        case file_schema.RodSpec(start=a, end=b):
            length = math.dist(a, b)
            return _Solid(1, length, _box(0.0, 0.0, length))
        case file_schema.DiscSpec(radius=r):
            return _Solid(2, math.pi * r * r, _round(r * r, 0.0, 0.5))
        case file_schema.RingSpec(radius=r):
            return _Solid(1, 2.0 * math.pi * r, _round(r * r, 0.0, 1.0))
        case file_schema.PlateSpec(size=(x, y)):
            return _Solid(2, x * y, _box(x, y, 0.0))
        case file_schema.BlockSpec(size=(x, y, z)):
            return _Solid(3, x * y * z, _box(x, y, z))
        case file_schema.CylinderSpec(radius=r, length=length):
            return _Solid(3, math.pi * r * r * length, _round(r * r, length, 0.5))
        case file_schema.SphereSpec(radius=r):
            moment = 0.4 * r * r
            return _Solid(3, 4.0 / 3.0 * math.pi * r**3, (moment, moment, moment))
    return _Solid(0, 1.0, (0.0, 0.0, 0.0))


def pose_of(shape: file_schema.ShapeSpec) -> Pose:
    """The centre and axes of a shape in the part's frame: its own z is the axis of rods and axial shapes."""
    match shape:
        case file_schema.RodSpec(start=a, end=b):
            start, end = np.array(a), np.array(b)
            return Pose((start + end) / 2.0, rot.aligning_z(rot.unit(tuple(end - start))))
        case file_schema.AxialShapeSpec(at=at, rotate=rotate, axis=axis):
            return Pose(np.array(at), rotation_matrix(rotate) @ rot.aligning_z(rot.unit(axis)))
        case file_schema.PlacedShapeSpec(at=at, rotate=rotate):
            return Pose(np.array(at), rotation_matrix(rotate))
    raise TypeError(type(shape).__name__)


def drawn(shape: file_schema.ShapeSpec) -> Shape:
    """The shape as a record to draw."""
    size: tuple[float, ...]
    match shape:
        case file_schema.RodSpec(start=a, end=b, radius=r):
            length = math.dist(a, b)
            size = (length, 0.02 * length if r is None else r)
        case file_schema.ParticleSpec(radius=r):
            size = (0.05 if r is None else r,)
        case file_schema.DiscSpec(radius=r) | file_schema.RingSpec(radius=r) | file_schema.SphereSpec(radius=r):
            size = (r,)
        case file_schema.CylinderSpec(length=length, radius=r):
            size = (length, r)
        case file_schema.PlateSpec(size=size) | file_schema.BlockSpec(size=size):
            pass
        case _:
            raise TypeError(type(shape).__name__)
    kind: str = getattr(shape, "type")  # noqa: B009  (the union's members all have it, their base does not)
    return Shape(kind, size, pose_of(shape), shape.color, shape.hole)


def of_shapes(shapes: Sequence[file_schema.ShapeSpec], mass: float | None) -> MassProperties:
    """Mass properties of a part made of shapes.

    :param mass: of the whole part in kg; the shapes without mass and density share it in proportion to their size.
    :raises InputError: masses are missing, given twice, or cannot be shared.
    """
    solids = [_solid(shape) for shape in shapes]
    given = [_given_mass(shape, solid) for shape, solid in zip(shapes, solids, strict=True)]
    per_measure = _mass_per_measure(shapes, solids, given, mass)
    bodies = []
    for shape, solid, value in zip(shapes, solids, given, strict=True):
        kilograms = value if value is not None else per_measure * solid.measure
        body = MassProperties(kilograms, np.zeros(3), kilograms * np.diag(solid.moments)).placed(pose_of(shape))
        bodies.append(body.scaled(-1.0) if shape.hole else body)
    return composite(bodies)


def _mass_per_measure(
    shapes: Sequence[file_schema.ShapeSpec],
    solids: Sequence[_Solid],
    given: Sequence[float | None],
    mass: float | None,
) -> float:
    """What a shape without mass and density weighs by its length, area or volume, in kg/m^dimension."""
    bare = [solid for solid, value in zip(solids, given, strict=True) if value is None]
    if mass is None and bare:
        raise InputError("has shapes without mass", "Give 'mass' on the part, or mass or density on each shape.")
    if mass is not None and not bare:
        raise InputError("gives the mass twice, on the part and on its shapes", "Remove one of the two.")
    if mass is None or not (mass or any(given)):
        return 0.0
    if len({solid.dimension for solid in bare}) > 1:
        message = "cannot share its mass among points, lines, surfaces and solids"
        raise InputError(message, "Give each shape its own.")
    signed = [(-1 if s.hole else 1) * b.measure for s, b, v in zip(shapes, solids, given, strict=True) if v is None]
    rest = mass - math.fsum((-v if s.hole else v) for s, v in zip(shapes, given, strict=True) if v is not None)
    total = math.fsum(signed)
    if rest <= 0.0:
        raise InputError(f"leaves {rest:g} kg for its shapes without mass", "'mass' is that of the whole part.")
    if total <= 0.0:
        raise InputError("has holes as large as its material", "Make them smaller.")
    return rest / total


def _given_mass(shape: file_schema.ShapeSpec, solid: _Solid) -> float | None:
    density = getattr(shape, "density", None)
    return density * solid.measure if density is not None else shape.mass
