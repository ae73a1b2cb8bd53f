"""Builds the shapes of a part from their records in the file: their places, how they are drawn, and what they weigh.

Mass properties follow Huston & Liu, ch. 7.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, assert_never

import numpy as np

from mbd_sim.base.errors import InputError
from mbd_sim.base.geometry import rotation as rot
from mbd_sim.base.geometry.batch import array, distance, fsum, per_variant
from mbd_sim.base.geometry.convex_hull import fans
from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.base.linear_algebra import product
from mbd_sim.files.builders.bodies.outlines import outline_axes, outline_of
from mbd_sim.files.schema import shapes as schema
from mbd_sim.files.schema.fields import RotationSpec
from mbd_sim.files.text.mesh_files import PRODUCTS
from mbd_sim.files.text.mesh_files import solid as solid_within
from mbd_sim.mechanism.elements.parts import Polyhedron, Shape
from mbd_sim.mechanism.mass_properties import MassProperties, composite
from mbd_sim.mechanism.outlines.area import area_of

ROD_RADIUS = 0.02  # of rods drawn without a radius, relative to their length
PARTICLE_RADIUS = 0.05  # m, of particles drawn without a radius


def rotation_matrix(rotation: RotationSpec | None) -> Array:
    """The matrix (3, 3) of a rotation; the identity for None."""
    if rotation is None:
        return np.eye(3)
    if rotation.rpy is not None:
        return rot.from_rpy(*rotation.rpy)
    if rotation.quaternion is not None:
        return rot.from_quaternion(rot.unit(rotation.quaternion))
    assert rotation.axis is not None and rotation.angle is not None
    return rot.about(rot.unit(rotation.axis), rotation.angle)


@dataclass(frozen=True)
class _ShapeInertia:
    """The size and the moments of inertia of a shape."""

    dimension: int  # 0 for a particle, 1 a line, 2 a surface, 3 a solid; sizes of one dimension can be compared
    measure: float  # length, area or volume in m^dimension; 1 for a particle
    inertia: Array  # (3, 3) about the mass center for unit mass, m²
    center: Array | tuple[float, float, float] = (0.0, 0.0, 0.0)  # of mass, from that of the shape, m


def _principal(*moments: float) -> Array:
    inertia: Array = np.diag(array(moments))
    return inertia


def _box(x: float, y: float, z: float) -> Array:
    return _principal((y * y + z * z) / 12.0, (z * z + x * x) / 12.0, (x * x + y * y) / 12.0)


def _axial(radius: float, length: float, factor: float) -> Array:
    """The inertia of a cylindrical body about z; the moment about z is `factor` times radius²."""
    across = factor * (radius * radius) / 2.0 + length * length / 12.0
    return _principal(across, across, factor * (radius * radius))


def _cone(radius: float, length: float) -> _ShapeInertia:
    """A cone about z; its mass center is at a quarter of its height, its center at half of it."""
    across = 0.15 * (radius * radius) + 0.0375 * (length * length)
    inertia = _principal(across, across, 0.3 * (radius * radius))
    return _ShapeInertia(3, math.pi * radius * radius * length / 3.0, inertia, (0.0, 0.0, -0.25 * length))


def _capsule(radius: float, length: float) -> _ShapeInertia:
    """A cylinder about z, and half a ball beyond each end, whose mass center is 3/8 of the radius away from it."""
    barrel, ball = math.pi * radius * radius * length, 4.0 / 3.0 * math.pi * radius * radius * radius
    square = radius * radius
    along = barrel * 0.5 * square + ball * 0.4 * square
    across = barrel * (square / 4.0 + length * length / 12.0)
    across = across + ball * (0.4 * square + length * length / 4.0 + 0.375 * length * radius)
    whole = barrel + ball
    return _ShapeInertia(3, whole, _principal(across / whole, across / whole, along / whole))


def _hull(shape: schema.HullSpec) -> _ShapeInertia:
    """The polyhedron, added up over tetrahedra."""
    numbers = _hull_numbers(*hull_of(shape))
    return _ShapeInertia(3, numbers[0], array([numbers[4:7], numbers[7:10], numbers[10:]]), numbers[1:4])


@per_variant
def _hull_numbers(corners: Any, faces: tuple[tuple[int, ...], ...]) -> Array:
    """Volume, mass center, and the rows of the inertia for unit mass about it, in one array (13,)."""
    if not faces:
        return np.full(13, math.nan)
    found, second = solid_within(np.asarray(corners)[fans(faces)]), np.zeros((3, 3))
    for (row, column), value in zip(PRODUCTS, found["moments"], strict=True):
        second[row, column] = second[column, row] = value / found["volume"]
    inertia = np.trace(second) * np.eye(3) - second
    return np.concatenate([[found["volume"]], found["center"], inertia.ravel()])


def hull_of(shape: schema.HullSpec) -> tuple[Any, tuple[tuple[int, ...], ...]]:
    """The corners (n, 3) of a hull from its center, and its faces as places in these, counterclockwise from outside."""
    corners, faces = shape.polyhedron
    return corners - _middle(corners), faces


def _middle(corners: Any) -> Any:
    """The center (3,) of the box around points (n, 3)."""
    return (np.max(corners, axis=0) + np.min(corners, axis=0)) / 2.0


def _inertia_of(shape: schema.AnyShapeSpec) -> _ShapeInertia:
    match shape:
        case schema.RodSpec(start=a, end=b):
            length = distance(a, b)
            return _ShapeInertia(1, length, _box(0.0, 0.0, length))
        case schema.DiscSpec(radius=r):
            return _ShapeInertia(2, math.pi * r * r, _axial(r, 0.0, 0.5))
        case schema.RingSpec(radius=r):
            return _ShapeInertia(1, 2.0 * math.pi * r, _axial(r, 0.0, 1.0))
        case schema.PlateSpec(size=(x, y)):
            return _ShapeInertia(2, x * y, _box(x, y, 0.0))
        case schema.BlockSpec(size=(x, y, z)):
            return _ShapeInertia(3, x * y * z, _box(x, y, z))
        case schema.CylinderSpec(radius=r, length=length):
            return _ShapeInertia(3, math.pi * r * r * length, _axial(r, length, 0.5))
        case schema.SphereSpec(radius=r):
            moment = 0.4 * r * r
            return _ShapeInertia(3, 4.0 / 3.0 * math.pi * r * r * r, _principal(moment, moment, moment))
        case schema.EllipsoidSpec(radii=(x, y, z)):
            inertia = _principal(0.2 * (y * y + z * z), 0.2 * (z * z + x * x), 0.2 * (x * x + y * y))
            return _ShapeInertia(3, 4.0 / 3.0 * math.pi * x * y * z, inertia)
        case schema.ConeSpec(radius=r, length=length):
            return _cone(r, length)
        case schema.CapsuleSpec(radius=r, length=length):
            return _capsule(r, length)
        case schema.HullSpec():
            return _hull(shape)
        case schema.ParticleSpec():
            return _ShapeInertia(0, 1.0, _principal(0.0, 0.0, 0.0))
        case schema.OutlineSpec():
            return _extruded(shape)
        case _:
            assert_never(shape)


def _extruded(shape: schema.OutlineSpec) -> _ShapeInertia:
    """A plate, or with a thickness a prism; one that is not closed has no mass."""
    if not shape.closed:
        return _ShapeInertia(0, 1.0, _principal(0.0, 0.0, 0.0))
    area, deep = area_of(outline_of(shape)), shape.thickness or 0.0
    xx, yy, xy, across = area.xx / area.area, area.yy / area.area, area.xy / area.area, deep * deep / 12.0
    dimension, measure = (3, area.area * deep) if deep else (2, area.area)
    inertia = np.array([[yy + across, -xy, 0.0], [-xy, xx + across, 0.0], [0.0, 0.0, xx + yy]])
    return _ShapeInertia(dimension, measure, inertia, (*area.center, 0.0))


def pose_of(shape: schema.AnyShapeSpec) -> Pose:
    """The center and the axes of a shape in the part's frame; z is the axis of rods and axial shapes."""
    if isinstance(shape, schema.RodSpec):
        start, end = array(shape.start), array(shape.end)
        return Pose((start + end) / 2.0, rot.aligning_z(rot.unit(tuple(end - start))))
    rotation = rotation_matrix(shape.rotate)
    if isinstance(shape, schema.AxialShapeSpec):
        rotation = product(rotation, rot.aligning_z(rot.unit(shape.axis)))
    if isinstance(shape, schema.OutlineSpec):
        rotation = product(rotation, outline_axes(shape))
    if isinstance(shape, schema.ConeSpec):
        return Pose(array(shape.at) + rotation[:, 2] * (0.5 * shape.length), rotation)
    if isinstance(shape, schema.HullSpec):
        return Pose(array(shape.at) + product(rotation, _middle(shape.polyhedron[0])), rotation)
    return Pose(array(shape.at), rotation)


def build_shape(shape: schema.AnyShapeSpec) -> Shape:
    """The shape to draw."""
    size: tuple[float, ...]
    pose, hull, outline = pose_of(shape), None, None
    match shape:
        case schema.RodSpec(start=a, end=b, radius=r):
            length = distance(a, b)
            size = (length, ROD_RADIUS * length if r is None else r)
        case schema.ParticleSpec(radius=r):
            size = (PARTICLE_RADIUS if r is None else r,)
        case schema.DiscSpec(radius=r) | schema.RingSpec(radius=r) | schema.SphereSpec(radius=r):
            size = (r,)
        case (
            schema.CylinderSpec(length=length, radius=r)
            | schema.ConeSpec(length=length, radius=r)
            | schema.CapsuleSpec(length=length, radius=r)
        ):
            size = (length, r)
        case schema.PlateSpec() | schema.BlockSpec():
            size = shape.size
        case schema.EllipsoidSpec():
            size = shape.radii
        case schema.HullSpec():
            size, (corners, faces) = (), hull_of(shape)
            hull = Polyhedron(tuple((x, y, z) for x, y, z in map(_numbers, corners)), faces)
        case schema.OutlineSpec(thickness=thickness):
            outline, size = outline_of(shape), (thickness or 0.0,)
            x, y = outline.middle
            pose, outline = pose @ Pose(np.array([x, y, 0.0]), np.eye(3)), outline.moved(-x, -y)
        case _:
            assert_never(shape)
    return Shape(shape.type, size, pose, shape.color, shape.hole, hull, shape.name, outline)


def _numbers(point: Any) -> Any:
    """The three numbers of a point, which may be batches."""
    return point.tolist() if isinstance(point, np.ndarray) else point


def of_shapes(
    shapes: Sequence[schema.AnyShapeSpec], mass: float | None, density: float | None = None
) -> MassProperties:
    """Mass properties of a part made of shapes.

    :param mass: of the whole part in kg; the shapes without mass and density share it in proportion to their size.
    :param density: in kg/m³, of solid shapes without mass and density.
    :raises InputError: masses are missing, given twice, or cannot be shared.
    """
    solids = [_inertia_of(shape) for shape in shapes]
    given = [_given_mass(shape, solid, density) for shape, solid in zip(shapes, solids, strict=True)]
    if density is not None and None in given:
        message = f"has a {shapes[given.index(None)].type}, which has no volume for the density of a material"
        raise InputError(message, "Give this shape its mass.")
    per_measure = _mass_per_measure(shapes, solids, given, mass)
    bodies = []
    for shape, solid, value in zip(shapes, solids, given, strict=True):
        kilograms = value if value is not None else per_measure * solid.measure
        body = MassProperties(kilograms, array(solid.center), kilograms * solid.inertia).placed(pose_of(shape))
        bodies.append(body.scaled(-1.0) if shape.hole else body)
    return composite(bodies)


def _mass_per_measure(
    shapes: Sequence[schema.AnyShapeSpec],
    solids: Sequence[_ShapeInertia],
    given: Sequence[float | None],
    mass: float | None,
) -> float:
    """The mass per length, area or volume of the shapes without mass and density, in kg/m^dimension."""
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
    rest = mass - fsum([(-v if s.hole else v) for s, v in zip(shapes, given, strict=True) if v is not None])
    total = fsum(signed)
    if rest <= 0.0:
        raise InputError(f"leaves {rest:g} kg for its shapes without mass", "'mass' is the mass of the whole part.")
    if total <= 0.0:
        raise InputError("has holes as large as its material", "Make them smaller.")
    per_measure: float = rest / total
    return per_measure


def _given_mass(shape: schema.AnyShapeSpec, solid: _ShapeInertia, of_material: float | None) -> float | None:
    density = getattr(shape, "density", None)
    if density is None and shape.mass is None and solid.dimension == 3:
        density = of_material
    return density * solid.measure if density is not None else shape.mass
