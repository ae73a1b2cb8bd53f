"""Mass, mass centre and inertia dyadic of shapes and of what is made of them (Huston & Liu, ch. 7).

An inertia is a symmetric matrix (3, 3) in kg·m² about the mass centre: I = ∫ (r·r 1 - r rᵀ) dm, so its products
are I_xy = -∫ x y dm.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mbd_sim.mechanism import rotation as rot
from mbd_sim.mechanism import schema
from mbd_sim.mechanism.model import Array, Pose, Shape


@dataclass(frozen=True, eq=False)
class MassProperties:
    """`mass` in kg, `center` (3,) in m, `inertia` (3, 3) in kg·m² about `center`."""

    mass: float
    center: Array
    inertia: Array

    def scaled(self, factor: float) -> MassProperties:
        """The same body with `factor` times the mass."""
        return MassProperties(self.mass * factor, self.center, self.inertia * factor)

    def placed(self, pose: Pose) -> MassProperties:
        """The body seen from the outer frame of `pose`."""
        center = pose.position + pose.rotation @ self.center
        return MassProperties(self.mass, center, pose.rotation @ self.inertia @ pose.rotation.T)

    def about(self, point: Array) -> Array:
        """The inertia (3, 3) about another point: the parallel axis theorem (Huston & Liu, sec. 7.6)."""
        k = rot.skew(self.center - point)
        return self.inertia - self.mass * (k @ k)


def composite(bodies: Sequence[MassProperties]) -> MassProperties:
    """Several bodies as one; holes have negative mass.

    :raises ValueError: the holes take away all mass.
    """
    if not any(body.mass for body in bodies):
        return MassProperties(0.0, np.zeros(3), np.zeros((3, 3)))
    mass = math.fsum(body.mass for body in bodies)
    if mass <= 1e-12 * math.fsum(abs(body.mass) for body in bodies):
        raise ValueError(f"the holes take away all mass, {mass:g} kg are left: make them smaller or lighter")
    center = sum((body.mass * body.center for body in bodies), np.zeros(3)) / mass
    inertia = sum((body.about(center) for body in bodies), np.zeros((3, 3)))
    return MassProperties(mass, center, inertia)


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


def _solid(shape: schema.Shape) -> _Solid:
    match shape:
        case schema.Rod(start=a, end=b):
            length = math.dist(a, b)
            return _Solid(1, length, _box(0.0, 0.0, length))
        case schema.Disc(radius=r):
            return _Solid(2, math.pi * r * r, _round(r * r, 0.0, 0.5))
        case schema.Ring(radius=r):
            return _Solid(1, 2.0 * math.pi * r, _round(r * r, 0.0, 1.0))
        case schema.Plate(size=(x, y)):
            return _Solid(2, x * y, _box(x, y, 0.0))
        case schema.Block(size=(x, y, z)):
            return _Solid(3, x * y * z, _box(x, y, z))
        case schema.Cylinder(radius=r, length=length):
            return _Solid(3, math.pi * r * r * length, _round(r * r, length, 0.5))
        case schema.Sphere(radius=r):
            moment = 0.4 * r * r
            return _Solid(3, 4.0 / 3.0 * math.pi * r**3, (moment, moment, moment))
    return _Solid(0, 1.0, (0.0, 0.0, 0.0))


def pose_of(shape: schema.Shape) -> Pose:
    """The centre and axes of a shape in the part's frame: its own z is the axis of rods and axial shapes."""
    match shape:
        case schema.Rod(start=a, end=b):
            start, end = np.array(a), np.array(b)
            return Pose((start + end) / 2.0, rot.aligning_z(rot.unit(tuple(end - start))))
        case schema.AxialShape(at=at, rotate=rotate, axis=axis):
            return Pose(np.array(at), rot.of_record(rotate) @ rot.aligning_z(rot.unit(axis)))
        case schema.Placed(at=at, rotate=rotate):
            return Pose(np.array(at), rot.of_record(rotate))
    raise TypeError(type(shape).__name__)


def drawn(shape: schema.Shape) -> Shape:
    """The shape as a record to draw."""
    size: tuple[float, ...]
    match shape:
        case schema.Rod(start=a, end=b, radius=r):
            length = math.dist(a, b)
            size = (length, 0.02 * length if r is None else r)
        case schema.Particle(radius=r):
            size = (0.05 if r is None else r,)
        case schema.Disc(radius=r) | schema.Ring(radius=r) | schema.Sphere(radius=r):
            size = (r,)
        case schema.Cylinder(length=length, radius=r):
            size = (length, r)
        case schema.Plate(size=size) | schema.Block(size=size):
            pass
        case _:
            raise TypeError(type(shape).__name__)
    kind: str = getattr(shape, "type")  # noqa: B009  (the union's members all have it, their base does not)
    return Shape(kind, size, pose_of(shape), shape.color, shape.hole)


def of_shapes(shapes: Sequence[schema.Shape], mass: float | None) -> MassProperties:
    """Mass properties of a part made of shapes.

    :param mass: kg of the whole part, shared in proportion to size by the shapes without mass and density.
    :raises ValueError: masses missing, given twice, or not comparable.
    """
    solids = [_solid(shape) for shape in shapes]
    own = [_own_mass(shape, solid) for shape, solid in zip(shapes, solids, strict=True)]
    bare = [solid for solid, value in zip(solids, own, strict=True) if value is None]
    if mass is None and bare:
        raise ValueError("has shapes without mass: give 'mass' on the part, or mass or density on each shape")
    if mass is not None and not bare:
        raise ValueError("gives the mass twice, on the part and on its shapes: remove one of the two")
    share = 0.0
    if mass or (mass is not None and any(own)):
        if len({solid.dimension for solid in bare}) > 1:
            raise ValueError("cannot share its mass among points, lines, surfaces and solids: give each shape its own")
        signed = [(-1 if s.hole else 1) * b.measure for s, b, v in zip(shapes, solids, own, strict=True) if v is None]
        rest = mass - math.fsum((-v if s.hole else v) for s, v in zip(shapes, own, strict=True) if v is not None)
        total = math.fsum(signed)
        if rest <= 0.0:
            raise ValueError(f"leaves {rest:g} kg for its shapes without mass: 'mass' is that of the whole part")
        if total <= 0.0:
            raise ValueError("has holes as large as its material: make them smaller")
        share = rest / total
    bodies = []
    for shape, solid, value in zip(shapes, solids, own, strict=True):
        kilograms = value if value is not None else share * solid.measure
        body = MassProperties(kilograms, np.zeros(3), kilograms * np.diag(solid.moments)).placed(pose_of(shape))
        bodies.append(body.scaled(-1.0) if shape.hole else body)
    return composite(bodies)


def _own_mass(shape: schema.Shape, solid: _Solid) -> float | None:
    density = getattr(shape, "density", None)
    return density * solid.measure if density is not None else shape.mass


def defect(inertia: Array) -> str | None:
    """What makes a matrix no inertia of any body, or None: it needs moments ≥ 0 that meet the triangle inequality."""
    if not np.all(np.isfinite(inertia)):
        return None  # of parameters that are reported themselves
    moments = np.linalg.eigvalsh(inertia)
    slack = 1e-9 * max(float(np.max(np.abs(moments))), 1e-300)
    text = ", ".join(f"{moment:.6g}" for moment in moments)
    if moments[0] < -slack:
        return f"has a negative principal moment (principal moments {text} kg·m²)"
    if moments[0] + moments[1] < moments[2] - slack:
        excess = "the largest principal moment exceeds the sum of the others"
        return f"violates the triangle inequality: {excess} (principal moments {text} kg·m²)"
    return None
