"""The solids that the meshes of a file enclose, where mass, center or inertia of a part follow from them.

The solid of each such mesh is written into the data of the file, so that a recording and a converted file do not depend
on the file of the mesh.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from mbd_sim.base.errors import InputError, MechanismError, Problem, listed
from mbd_sim.files.text.mesh_files import found_mesh, mesh_entries, read_triangles, solid, with_value
from mbd_sim.mechanism.values.source import Location, Source

UNITLESS = (".stl", ".obj", ".ply")  # files that do not state their unit
LARGE = 5.0  # m, radius of gyration beyond which such a file is rather in mm
_REMEDY = "Give its 'inertia'."
_SCALE = "give 'scale: 0.001'"


def with_mesh_solids(source: Source) -> Source:
    """The source with the solids of the meshes from which parts get mass, center and inertia.

    A part with a mass of its own is a point mass, with a remark, where a mesh encloses no solid.

    :raises MechanismError: a mesh with a mass or density encloses no solid.
    """
    parts = source.data.get("parts") if isinstance(source.data, dict) else None
    if not isinstance(parts, dict):
        return source
    remarks, changed, problems = list[str](), dict(parts), list[Problem]()
    for name, part in parts.items():
        if _is_heavy(part):
            changed[name], found = _with_heavy_solids(str(name), part, source, problems)
            remarks += found
            continue
        if not _needs_solids(part):
            continue
        if part.get("center") is not None:
            remarks.append(f"{name} is a point mass at its 'center', as its mesh counts only without it. {_REMEDY}")
            continue
        changed[name], remark = _with_solids(str(name), part, source.file)
        remarks.append(remark)
    if problems:
        raise MechanismError(problems)
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


def _is_heavy(part: Any) -> bool:
    """Whether meshes of a part have a mass or a density, perhaps by its material."""
    meshes = [mesh for _, mesh in mesh_entries(part) if _has_file(mesh)]
    return bool(meshes) and (part.get("material") is not None or any(map(_has_mass, meshes)))


def _has_mass(mesh: Mapping[str, Any]) -> bool:
    return mesh.get("mass") is not None or mesh.get("density") is not None


def _with_heavy_solids(
    name: str, part: Mapping[str, Any], source: Source, problems: list[Problem]
) -> tuple[dict[str, Any], list[str]]:
    """A part whose meshes with masses have solids, and remarks; those without a solid are added to `problems`."""
    changed, large = dict(part), []
    for steps, mesh in mesh_entries(part):
        if not _has_file(mesh) or not (part.get("material") is not None or _has_mass(mesh)):
            continue
        if mesh.get("solid") is not None:
            continue
        location: Location = ("parts", name, *steps, "file")
        try:
            found = _solid_of(mesh["file"], source.file, outward=True)
        except InputError as error:
            message = f"mass, center and inertia of this mesh are not known: {error.message}"
            remedy = error.remedy or "Repair it, or give the part 'mass', 'center' and 'inertia'"
            problems.append(source.problem(location, message, f"{remedy.rstrip('.')}.", mesh["file"]))
            continue
        changed = with_value(changed, steps, {**mesh, "solid": found})
        large += _if_large(mesh, found)
    return changed, [_large(name, large)] if large else []


def _if_large(mesh: Mapping[str, Any], found: Mapping[str, Any]) -> list[str]:
    """The mesh, if it is rather in mm."""
    radius = math.sqrt(max(found["moments"][:3]) / found["volume"])
    if radius > LARGE and mesh.get("scale") is None and mesh["file"].lower().endswith(UNITLESS):
        return [f"{mesh['file']} (radius of gyration {radius:.3g} m)"]
    return []


def _large(name: str, meshes: list[str]) -> str:
    return f"{name} has a large mesh, {listed(meshes)}. Its file states no unit, so it is in m: for mm, {_SCALE}."


def _needs_solids(part: Any) -> bool:
    """Whether meshes are all that says how the mass of a part is distributed."""
    if not isinstance(part, dict) or part.get("inertia") is not None or part.get("mass") in (None, 0):
        return False
    meshes, shapes = [mesh for _, mesh in mesh_entries(part)], [part.get("shape"), *(part.get("shapes") or ())]
    massive = any(isinstance(shape, dict) and shape.get("mass") != 0 for shape in shapes)
    return bool(meshes) and all(map(_has_file, meshes)) and not massive


def _has_file(mesh: Any) -> bool:
    return isinstance(mesh, dict) and isinstance(mesh.get("file"), str)


def _with_solids(name: str, part: Mapping[str, Any], file: str) -> tuple[dict[str, Any], str]:
    """A part whose meshes have solids, or else zero inertia; and a remark."""
    changed, defects, large = dict(part), [], []
    for steps, mesh in mesh_entries(part):
        try:
            found = mesh["solid"] if mesh.get("solid") is not None else _solid_of(mesh["file"], file)
        except InputError as error:
            defects.append(f"{mesh['file']} ({str(error).rstrip('.')})")
            continue
        changed = with_value(changed, steps, {**mesh, "solid": found})
        large += _if_large(mesh, found)
    if not defects:
        return changed, _large(name, large) if large else ""
    reason = f"no solid is known of {listed(defects)}"
    return {**part, "inertia": [0.0, 0.0, 0.0]}, f"{name} is a point mass at its origin: {reason}. {_REMEDY}"


def _solid_of(uri: str, file: str, outward: bool = False) -> dict[str, Any]:
    return solid(read_triangles(found_mesh(uri, file)), outward)
