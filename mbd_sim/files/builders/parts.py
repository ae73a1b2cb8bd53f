"""Builds the parts of a mechanism from their records in the file: points, shapes, mass, mass center and inertia.

Mass properties that are computed from shapes follow Huston & Liu, ch. 7.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, assert_never

import numpy as np

from mbd_sim.base.errors import InputError, Problem
from mbd_sim.base.geometry import rotation as rot
from mbd_sim.base.geometry.batch import array, distance, fsum, per_variant
from mbd_sim.base.geometry.convex_hull import fans
from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.base.linear_algebra import product
from mbd_sim.files.builders.context import rotation_matrix
from mbd_sim.files.builders.outlines import check_outlines, outline_axes, outline_of
from mbd_sim.files.schema import file
from mbd_sim.files.schema import shapes as schema
from mbd_sim.files.schema.fields import PointSpec
from mbd_sim.files.schema.shapes import AnyShapeSpec
from mbd_sim.files.text.mesh_files import PRODUCTS
from mbd_sim.files.text.mesh_files import solid as solid_within
from mbd_sim.mechanism.elements.parts import Mesh, Part, Polyhedron, Shape
from mbd_sim.mechanism.mass_properties import MassProperties, composite, inertia_defect
from mbd_sim.mechanism.outlines.area import area_of
from mbd_sim.mechanism.values.materials import density_of
from mbd_sim.mechanism.values.source import Location, Source


def build_part(
    name: str, spec: file.PartSpec, source: Source, problems: list[Problem], materials: Mapping[str, float]
) -> Part:
    """A part; its problems are added to `problems`.

    :param materials: densities in kg/m³ of the materials of the file.
    """
    location: Location = ("parts", name)
    shapes = shapes_of(spec)
    if not check_outlines(shapes, location, spec.shape is not None, source, problems):
        return Part(name, spec.mass or 0.0, np.zeros(3), np.zeros((3, 3)), point_poses(spec.points))
    density = _density(spec, materials, location, source, problems)
    meshes = tuple(map(_mesh, spec.all_meshes))
    only_drawn = all(_is_drawn_only(shape) for shape in shapes)
    if _has_heavy_meshes(spec):
        body = _with_meshes(spec, density, location, source, problems)
    elif only_drawn and spec.inertia is None and spec.mass and spec.center is None and _has_solids(spec):
        body = _mesh_properties(spec, location, source, problems)
    elif spec.inertia is not None or not shapes or (only_drawn and spec.mass):
        body = _given_properties(spec, location, source, problems)
    else:
        body = _computed_properties(spec, density, location, source, problems)
    _check_inertia(body, spec, location, source, problems)
    return Part(
        name=name,
        mass=body.mass,
        center=body.center,
        inertia=body.inertia,
        points=point_poses(spec.points),
        shapes=_drawn_shapes(shapes),
        meshes=meshes,
        collisions=None if spec.collisions is None else tuple(map(build_shape, spec.collisions)),
    )


def point_poses(points: Mapping[str, Any]) -> dict[str, Pose]:
    """The poses of named points in the frame of their part."""
    return {
        name: Pose(array(point.at), rotation_matrix(point.rotate))
        if isinstance(point, PointSpec)
        else Pose(array(point), np.eye(3))
        for name, point in points.items()
    }


def shapes_of(spec: file.PartSpec) -> list[AnyShapeSpec]:
    """The shapes of a part."""
    return [spec.shape] if spec.shape is not None else list(spec.shapes or [])


def touching_shapes(spec: file.PartSpec) -> list[AnyShapeSpec]:
    """The shapes of a part that can touch others."""
    return shapes_of(spec) if spec.collisions is None else spec.collisions


def _drawn_shapes(specs: list[AnyShapeSpec]) -> tuple[Shape, ...]:
    if not specs:
        return ()
    return tuple(build_shape(spec) for spec in specs)


def _is_drawn_only(shape: AnyShapeSpec) -> bool:
    return shape.mass == 0.0


NO_VOLUME = "Give scale factors that are not 0, or 'inertia'."


def _mesh(spec: file.MeshSpec) -> Mesh:
    """The mesh to draw."""
    scale = spec.scale if isinstance(spec.scale, tuple) else (spec.scale, spec.scale, spec.scale)
    return Mesh(spec.file, Pose(array(spec.at), rotation_matrix(spec.rotate)), scale, spec.color)


def _has_solids(spec: file.PartSpec) -> bool:
    """Whether what all meshes of a part enclose is known."""
    return bool(spec.all_meshes) and all(mesh.solid is not None for mesh in spec.all_meshes)


def _has_heavy_meshes(spec: file.PartSpec) -> bool:
    """Whether meshes of a part give it mass."""
    given = any(mesh.mass is not None or mesh.density is not None for mesh in spec.all_meshes)
    return given or bool(spec.all_meshes and spec.material is not None)


def _mesh_properties(
    spec: file.PartSpec, location: Location, source: Source, problems: list[Problem]
) -> MassProperties:
    """Mass center and inertia from closed meshes, which are uniform solids of equal density."""
    assert spec.mass
    whole = composite([_unit_density(mesh, mesh.solid) for mesh in spec.all_meshes if mesh.solid])
    if whole.mass:
        return MassProperties(spec.mass, whole.center, spec.mass * (whole.inertia / whole.mass))
    problems.append(source.problem(location, "has meshes without volume", NO_VOLUME))
    return MassProperties(spec.mass, np.zeros(3), np.zeros((3, 3)))


def _mesh_bodies(
    spec: file.PartSpec, density: float | None, location: Location, source: Source, problems: list[Problem]
) -> list[MassProperties]:
    """The solids of the meshes that have a mass, each in the part's frame.

    :param density: in kg/m³, of meshes without mass and density; None: these are only drawn.
    """
    bodies = []
    for number, mesh in enumerate(spec.all_meshes):
        own = mesh.density if mesh.density is not None else density
        if mesh.solid is None or (mesh.mass is None and own is None):
            continue
        body = _unit_density(mesh, mesh.solid)
        if not body.mass:
            where = (*location, "mesh") if spec.mesh is not None else (*location, "meshes", number)
            problems.append(source.problem(where, "has a mesh without volume", NO_VOLUME))
        elif mesh.mass is not None:
            bodies.append(MassProperties(mesh.mass, body.center, mesh.mass * (body.inertia / body.mass)))
        else:
            assert own is not None
            bodies.append(body.scaled(own))
    return bodies


def _unit_density(mesh: file.MeshSpec, spec: file.SolidSpec) -> MassProperties:
    """The solid of a mesh in the part's frame, with 1 kg/m³."""
    placed = _mesh(mesh)
    scale = np.array(placed.scale)
    second = np.zeros((3, 3))
    for (row, column), value in zip(PRODUCTS, spec.moments, strict=True):
        second[row, column] = second[column, row] = value
    factor = abs(float(np.prod(scale)))
    second = factor * np.outer(scale, scale) * second
    inertia = np.trace(second) * np.eye(3) - second
    return MassProperties(factor * spec.volume, scale * np.array(spec.center), inertia).placed(placed.pose)


def _given_properties(
    spec: file.PartSpec, location: Location, source: Source, problems: list[Problem]
) -> MassProperties:
    """Mass, mass center and inertia from the file; the shapes are only drawn."""
    if spec.mass is None:
        problems.append(source.problem(location, "'mass' is missing", "Add 'mass', or a shape with mass or density."))
    for index, shape in enumerate(shapes_of(spec)):
        if not _is_drawn_only(shape) and (shape.mass is not None or getattr(shape, "density", None) is not None):
            where = (*location, "shape") if spec.shape else (*location, "shapes", index)
            remedy = "Remove the shape's mass: if the part gives its inertia, its shapes are only drawn."
            problems.append(source.problem(where, "gives a mass although the part gives its inertia", remedy))
    return MassProperties(spec.mass or 0.0, array(spec.center or (0.0, 0.0, 0.0)), _inertia_matrix(spec.inertia))


def _density(
    spec: file.PartSpec, materials: Mapping[str, float], location: Location, source: Source, problems: list[Problem]
) -> float | None:
    """The density of the part's material in kg/m³; None without one."""
    if spec.material is None:
        return None
    try:
        return density_of(spec.material, materials)
    except InputError as error:
        problems.append(source.problem((*location, "material"), error.message, error.remedy))
        return 1.0


def _with_meshes(
    spec: file.PartSpec, density: float | None, location: Location, source: Source, problems: list[Problem]
) -> MassProperties:
    """Mass, mass center and inertia from meshes with masses, and from the shapes beside them."""
    for key in ("mass", "center", "inertia"):
        if getattr(spec, key) is not None:
            remedy = f"Remove '{key}', or the mass or density of each mesh."
            problems.append(source.problem((*location, key), "follows from the meshes, which have masses", remedy))
    bodies = _mesh_bodies(spec, density, location, source, problems)
    if any(not _is_drawn_only(shape) for shape in shapes_of(spec)):
        bodies.append(_computed_properties(spec.model_copy(update={"mass": None}), density, location, source, problems))
    return composite(bodies)


def _computed_properties(
    spec: file.PartSpec, density: float | None, location: Location, source: Source, problems: list[Problem]
) -> MassProperties:
    """Mass, mass center and inertia from the shapes."""
    if spec.center is not None:
        remedy = "Remove 'center', or give 'inertia' as well."
        problems.append(source.problem((*location, "center"), "is computed from the shapes", remedy))
    try:
        return of_shapes(shapes_of(spec), spec.mass, density)
    except InputError as error:
        problems.append(source.problem_of(location, error))
        return MassProperties(spec.mass or 0.0, np.zeros(3), np.zeros((3, 3)))


def _check_inertia(
    body: MassProperties, spec: file.PartSpec, location: Location, source: Source, problems: list[Problem]
) -> None:
    given = spec.inertia is not None
    if (defect := inertia_defect(body.inertia)) is not None and (spec.inertia_check or not given):
        remedy = "Place the holes inside the material."
        if given:
            location, remedy = (*location, "inertia"), "No rigid body has such an inertia: check its numbers."
        problems.append(source.problem(location, f"the inertia {defect}", remedy))
    if spec.mass == 0.0 and np.any(body.inertia) and spec.inertia_check:
        problems.append(source.problem(location, "has an inertia without mass", "Give the part a mass."))


def _inertia_matrix(spec: file.InertiaSpec | tuple[float, float, float] | None) -> Array:
    if spec is None:
        return np.zeros((3, 3))
    if isinstance(spec, tuple):
        moments: Array = np.diag(array(spec))
        return moments
    matrix: Array = array(
        [
            [spec.xx, spec.xy, spec.xz],
            [spec.xy, spec.yy, spec.yz],
            [spec.xz, spec.yz, spec.zz],
        ]
    )
    return matrix


ROD_RADIUS = 0.02  # of rods drawn without a radius, relative to their length
PARTICLE_RADIUS = 0.05  # m, of particles drawn without a radius


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
