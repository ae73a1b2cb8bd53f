"""Builds the parts of a mechanism from their records in the file: points, mass, mass center and inertia."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from mbd_sim.errors import InputError, Problem
from mbd_sim.geometry.batch import array
from mbd_sim.geometry.pose import Array, Pose
from mbd_sim.mechanism.mass_properties import MassProperties, inertia_defect
from mbd_sim.mechanism.records import Mesh, Part, Shape
from mbd_sim.mechanism.source import Location, Source
from mbd_sim.mechanism_file.builders.rotation_builder import rotation_matrix
from mbd_sim.mechanism_file.schema import base_schema, file_schema

if TYPE_CHECKING:
    from mbd_sim.mechanism_file.schema.shape_schema import AnyShapeSpec


def build_part(name: str, spec: file_schema.PartSpec, source: Source, problems: list[Problem]) -> Part:
    """A part; its problems are added to `problems`."""
    location: Location = ("parts", name)
    shapes = shapes_of(spec)
    meshes = tuple(
        Mesh(mesh.file, Pose(array(mesh.at), rotation_matrix(mesh.rotate)), mesh.scale, mesh.color)
        for mesh in spec.meshes
    )
    only_drawn = all(_is_drawn_only(shape) for shape in shapes)
    if only_drawn and spec.inertia is None and spec.mass and spec.center is None and _has_solids(spec):
        body = _mesh_properties(meshes, spec, location, source, problems)
    elif spec.inertia is not None or not shapes or (only_drawn and spec.mass):
        body = _given_properties(spec, location, source, problems)
    else:
        body = _computed_properties(spec, location, source, problems)
    _check_inertia(body, spec, location, source, problems)
    return Part(
        name=name,
        mass=body.mass,
        center=body.center,
        inertia=body.inertia,
        points=point_poses(spec.points),
        shapes=_drawn_shapes(shapes),
        meshes=meshes,
    )


def point_poses(points: Mapping[str, Any]) -> dict[str, Pose]:
    """The poses of named points in the frame of their part."""
    return {
        name: Pose(array(point.at), rotation_matrix(point.rotate))
        if isinstance(point, base_schema.PointSpec)
        else Pose(array(point), np.eye(3))
        for name, point in points.items()
    }


def shapes_of(spec: file_schema.PartSpec) -> list[AnyShapeSpec]:
    """The shapes of a part."""
    return [spec.shape] if spec.shape is not None else list(spec.shapes or [])


def _drawn_shapes(specs: list[AnyShapeSpec]) -> tuple[Shape, ...]:
    if not specs:
        return ()
    from mbd_sim.mechanism_file.builders.shape_builder import build_shape  # with the schema of shapes

    return tuple(build_shape(spec) for spec in specs)


def _is_drawn_only(shape: AnyShapeSpec) -> bool:
    return shape.mass == 0.0


def _has_solids(spec: file_schema.PartSpec) -> bool:
    return bool(spec.meshes) and all(mesh.solid is not None for mesh in spec.meshes)


def _mesh_properties(
    meshes: tuple[Mesh, ...],
    spec: file_schema.PartSpec,
    location: Location,
    source: Source,
    problems: list[Problem],
) -> MassProperties:
    """Mass center and inertia from closed meshes."""
    from mbd_sim.mechanism_file.mesh_solids import of_meshes

    assert spec.mass
    try:
        return of_meshes(meshes, spec.meshes, spec.mass)
    except InputError as error:
        problems.append(source.problem_of(location, error))
        return MassProperties(spec.mass, np.zeros(3), np.zeros((3, 3)))


def _given_properties(
    spec: file_schema.PartSpec, location: Location, source: Source, problems: list[Problem]
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


def _computed_properties(
    spec: file_schema.PartSpec, location: Location, source: Source, problems: list[Problem]
) -> MassProperties:
    """Mass, mass center and inertia from the shapes."""
    if spec.center is not None:
        remedy = "Remove 'center', or give 'inertia' as well."
        problems.append(source.problem((*location, "center"), "is computed from the shapes", remedy))
    from mbd_sim.mechanism_file.builders.shape_builder import of_shapes

    try:
        return of_shapes(shapes_of(spec), spec.mass)
    except InputError as error:
        problems.append(source.problem_of(location, error))
        return MassProperties(spec.mass or 0.0, np.zeros(3), np.zeros((3, 3)))


def _check_inertia(
    body: MassProperties, spec: file_schema.PartSpec, location: Location, source: Source, problems: list[Problem]
) -> None:
    given = spec.inertia is not None
    if (defect := inertia_defect(body.inertia)) is not None and (spec.inertia_check or not given):
        remedy = "Place the holes inside the material."
        if given:
            location, remedy = (*location, "inertia"), "No rigid body has such an inertia: check its numbers."
        problems.append(source.problem(location, f"the inertia {defect}", remedy))
    if spec.mass == 0.0 and np.any(body.inertia) and spec.inertia_check:
        problems.append(source.problem(location, "has an inertia without mass", "Give the part a mass."))


def _inertia_matrix(spec: file_schema.InertiaSpec | tuple[float, float, float] | None) -> Array:
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
