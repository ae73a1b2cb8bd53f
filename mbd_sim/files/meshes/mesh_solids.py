"""The solids that closed meshes enclose, from which a part with a mass and without an inertia gets center and inertia.

The `solid` of each mesh is written into the data of the file, so that a recording and a converted file do not depend on
the file of the mesh.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mbd_sim.base.errors import InputError, listed
from mbd_sim.base.geometry.pose import Array
from mbd_sim.files.meshes.mesh_files import MeshError, mesh_path, read_triangles
from mbd_sim.mechanism.elements.parts import Mesh
from mbd_sim.mechanism.mass_properties import MassProperties, composite
from mbd_sim.mechanism.values.source import Source

if TYPE_CHECKING:
    from mbd_sim.files.schema.file import MeshSpec, SolidSpec

PRODUCTS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))  # xx, yy, zz, xy, xz, yz
UNITLESS = (".stl", ".obj")  # files that do not state their unit
LARGE = 5.0  # m, radius of gyration beyond which such a file is rather in mm
FLAT = 1e-12  # volume, relative to the cube of the size, below which a surface encloses nothing


def with_mesh_solids(source: Source) -> Source:
    """The source with the solids of the meshes from which parts get center and inertia.

    A part is a point mass, with a remark, where a mesh encloses no solid.
    """
    parts = source.data.get("parts") if isinstance(source.data, dict) else None
    if not isinstance(parts, dict):
        return source
    remarks, changed = [], dict(parts)
    for name, part in parts.items():
        if not _needs_solids(part):
            continue
        if part.get("center") is not None:
            remarks.append(f"{name} is a point mass at its 'center', as its mesh counts only without it. {_REMEDY}")
            continue
        changed[name], remark = _with_solids(str(name), part, source.file)
        remarks.append(remark)
    if changed == parts:
        return replace(source, remarks=(*source.remarks, *remarks))
    comments = source.comments if source.text is None else (f"From {Path(source.file).name} and its meshes.",)
    return replace(
        source,
        data={**source.data, "parts": changed},
        text=None,
        comments=comments,
        other_files=None,
        remarks=(*source.remarks, *(remark for remark in remarks if remark)),
    )


_REMEDY = "Give its 'inertia'."
_SCALE = "give 'scale: [0.001, 0.001, 0.001]'"


def _needs_solids(part: Any) -> bool:
    """Whether meshes are all that says how the mass of a part is distributed."""
    if not isinstance(part, dict) or part.get("inertia") is not None or part.get("mass") in (None, 0):
        return False
    meshes, shapes = part.get("meshes"), [part.get("shape"), *(part.get("shapes") or ())]
    massive = any(isinstance(shape, dict) and shape.get("mass") != 0 for shape in shapes)
    return isinstance(meshes, list) and any(map(_has_file, meshes)) and all(map(_has_file, meshes)) and not massive


def _has_file(mesh: Any) -> bool:
    return isinstance(mesh, dict) and isinstance(mesh.get("file"), str)


def _with_solids(name: str, part: Mapping[str, Any], file: str) -> tuple[dict[str, Any], str]:
    """A part whose meshes have solids, or else zero inertia; and a remark."""
    found, defects, large = [], [], []
    for mesh in part["meshes"]:
        try:
            found.append(mesh if mesh.get("solid") is not None else {**mesh, "solid": _solid_of(mesh["file"], file)})
        except InputError as error:
            defects.append(f"{mesh['file']} ({str(error).rstrip('.')})")
            continue
        radius = math.sqrt(max(found[-1]["solid"]["moments"][:3]) / found[-1]["solid"]["volume"])
        if radius > LARGE and mesh.get("scale") is None and mesh["file"].lower().endswith(UNITLESS):
            large.append(f"{mesh['file']} (radius of gyration {radius:.3g} m)")
    if not defects:
        remark = f"{name} has a large mesh, {listed(large)}. Its file states no unit, so it is in m: for mm, {_SCALE}."
        return {**part, "meshes": found}, remark if large else ""
    reason = f"no solid is known of {listed(defects)}"
    return {**part, "inertia": [0.0, 0.0, 0.0]}, f"{name} is a point mass at its origin: {reason}. {_REMEDY}"


def _solid_of(uri: str, file: str) -> dict[str, Any]:
    path = mesh_path(uri, file)
    if path is None:
        raise MeshError("not found")
    return solid(read_triangles(path))


def solid(triangles: Array) -> dict[str, Any]:
    """Volume, center and second moments ∫ x y dV about it of what closed surfaces (n, 3, 3) enclose.

    They are added up over the tetrahedra between each triangle and a point. One with the edges a, b, c from that point
    has the volume V = a·(b × c)/6, and ∫ r rᵀ dV = V/20 (a aᵀ + b bᵀ + c cᵀ + s sᵀ) with s = a + b + c.

    :raises MeshError: the surface has an edge where it ends or changes its sides, or encloses no volume.
    """
    if not _is_closed(triangles):
        raise MeshError("its surface is not closed, or has triangles that are turned over")
    low, high = triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))
    size = float(np.max(high - low))
    edges = (triangles - (low + high) / 2.0) / size  # without units, and near 1
    volumes = np.einsum("ij,ij->i", edges[:, 0], np.cross(edges[:, 1], edges[:, 2])) / 6.0
    sums = edges.sum(axis=1)
    volume = math.fsum(volumes)
    if abs(volume) <= FLAT:
        raise MeshError("it encloses no volume")
    center = np.einsum("i,ij->j", volumes, sums) / (4.0 * volume)
    squares = np.einsum("iaj,iak->ijk", edges, edges) + np.einsum("ij,ik->ijk", sums, sums)
    moments = np.einsum("i,ijk->jk", volumes, squares) / (20.0 * volume) - np.outer(center, center)
    volume, moments = abs(volume) * size**3, abs(volume) * size**5 * moments
    return {
        "volume": float(volume),
        "center": ((low + high) / 2.0 + size * center).tolist(),
        "moments": [float(moments[index]) for index in PRODUCTS],
    }


def _is_closed(triangles: Array) -> bool:
    """Whether each edge is run through in both directions equally often, so that the surface has no boundary."""
    _, corner = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)
    corners = corner.reshape(-1, 3).astype(np.int64)
    starts, ends = corners.ravel(), np.roll(corners, -1, axis=1).ravel()
    count = int(corners.max()) + 1
    keys, way = np.minimum(starts, ends) * count + np.maximum(starts, ends), np.sign(ends - starts)
    _, edge = np.unique(keys, return_inverse=True)
    return not np.any(np.bincount(edge.ravel(), weights=way))


def of_meshes(meshes: Sequence[Mesh], specs: Sequence[MeshSpec], mass: float) -> MassProperties:
    """Mass properties of a part whose meshes are uniform solids of equal density.

    :raises InputError: a scale factor is 0.
    """
    bodies = [_unit_density(mesh, spec.solid) for mesh, spec in zip(meshes, specs, strict=True) if spec.solid]
    whole = composite(bodies)
    if not whole.mass:
        raise InputError("has meshes without volume", "Give scale factors that are not 0, or 'inertia'.")
    return MassProperties(mass, whole.center, mass * (whole.inertia / whole.mass))


def _unit_density(mesh: Mesh, spec: SolidSpec) -> MassProperties:
    """The solid of a mesh in the part's frame, with 1 kg/m³."""
    scale = np.array(mesh.scale)
    second = np.zeros((3, 3))
    for (row, column), value in zip(PRODUCTS, spec.moments, strict=True):
        second[row, column] = second[column, row] = value
    factor = abs(float(np.prod(scale)))
    second = factor * np.outer(scale, scale) * second
    inertia = np.trace(second) * np.eye(3) - second
    return MassProperties(factor * spec.volume, scale * np.array(spec.center), inertia).placed(mesh.pose)
