"""Builds the parts of a mechanism from their records in the file: points, mass, mass center and inertia."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from mbd_sim.base.errors import InputError, Problem
from mbd_sim.base.geometry.batch import array
from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.files.builders.bodies.outlines import check_outlines
from mbd_sim.files.builders.bodies.shapes import build_shape, of_shapes, rotation_matrix
from mbd_sim.files.schema import file
from mbd_sim.files.schema.fields import PointSpec
from mbd_sim.files.schema.shapes import AnyShapeSpec
from mbd_sim.files.text.mesh_files import PRODUCTS
from mbd_sim.mechanism.elements.parts import Mesh, Part, Shape
from mbd_sim.mechanism.mass_properties import MassProperties, composite, inertia_defect
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
