"""Meshes of parts: what is drawn, and the uniform solids that closed ones enclose."""

from __future__ import annotations

import numpy as np

from mbd_sim.base.errors import Problem
from mbd_sim.base.geometry.batch import array
from mbd_sim.base.geometry.pose import Pose
from mbd_sim.files.builders.context import rotation_matrix
from mbd_sim.files.schema import file
from mbd_sim.files.text.mesh_files import PRODUCTS
from mbd_sim.mechanism.elements.parts import Mesh
from mbd_sim.mechanism.mass_properties import MassProperties, composite
from mbd_sim.mechanism.values.source import Location, Source

NO_VOLUME = "Give scale factors that are not 0, or 'inertia'."


def build_mesh(spec: file.MeshSpec) -> Mesh:
    """The mesh to draw."""
    scale = spec.scale if isinstance(spec.scale, tuple) else (spec.scale, spec.scale, spec.scale)
    return Mesh(spec.file, Pose(array(spec.at), rotation_matrix(spec.rotate)), scale, spec.color)


def has_solids(spec: file.PartSpec) -> bool:
    """Whether what all meshes of a part enclose is known."""
    return bool(spec.all_meshes) and all(mesh.solid is not None for mesh in spec.all_meshes)


def heavy_meshes(spec: file.PartSpec) -> bool:
    """Whether meshes of a part give it mass."""
    given = any(mesh.mass is not None or mesh.density is not None for mesh in spec.all_meshes)
    return given or bool(spec.all_meshes and spec.material is not None)


def mesh_properties(spec: file.PartSpec, location: Location, source: Source, problems: list[Problem]) -> MassProperties:
    """Mass center and inertia from closed meshes, which are uniform solids of equal density."""
    assert spec.mass
    whole = composite([_unit_density(mesh, mesh.solid) for mesh in spec.all_meshes if mesh.solid])
    if whole.mass:
        return MassProperties(spec.mass, whole.center, spec.mass * (whole.inertia / whole.mass))
    problems.append(source.problem(location, "has meshes without volume", NO_VOLUME))
    return MassProperties(spec.mass, np.zeros(3), np.zeros((3, 3)))


def mesh_bodies(
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
    placed = build_mesh(mesh)
    scale = np.array(placed.scale)
    second = np.zeros((3, 3))
    for (row, column), value in zip(PRODUCTS, spec.moments, strict=True):
        second[row, column] = second[column, row] = value
    factor = abs(float(np.prod(scale)))
    second = factor * np.outer(scale, scale) * second
    inertia = np.trace(second) * np.eye(3) - second
    return MassProperties(factor * spec.volume, scale * np.array(spec.center), inertia).placed(placed.pose)
