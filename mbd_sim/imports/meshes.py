"""Reads files of meshes as the parts of an assembly: a closed mesh is a part."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mbd_sim.base.errors import InputError, listed
from mbd_sim.base.geometry.pose import identity_pose
from mbd_sim.files.text.mesh_files import FORMATS, PRODUCTS, read_triangles, solid
from mbd_sim.files.text.mesh_solids import UNITLESS
from mbd_sim.imports.assembly import Body, CadAssembly, ImportedPart, PlacedBody
from mbd_sim.imports.mesh_faces import faces_of_mesh
from mbd_sim.mechanism.elements.parts import is_frame_name
from mbd_sim.mechanism.mass_properties import MassProperties
from mbd_sim.mechanism.values.names import accepted_names, unique_name

MOST_TRIANGLES = 2_000_000  # of a mesh


def mesh_files(paths: Sequence[Path]) -> list[Path]:
    """The files of meshes among paths, and in the folders among them.

    :raises InputError: a folder has none, or there is no such file.
    """
    found: list[Path] = []
    for path in paths:
        if not path.exists():
            raise InputError(f"{path}: there is no such file", "Check the path.")
        inner = [path]
        if path.is_dir():
            inner = sorted(file for file in path.iterdir() if file.suffix.lower() in FORMATS)
            if not inner:
                raise InputError(f"{path}: the folder has no meshes", f"They end in {', '.join(FORMATS)}.")
        found += inner
    return found


def read_meshes(paths: Sequence[Path], unit: float | None, name: str) -> CadAssembly:
    """An assembly of meshes, in whose common frame each is given.

    :param unit: in m, of the files that state none.
    :raises InputError: a mesh cannot be read, is not closed, or states no unit where none is given.
    :raises MissingPackageError: what reads them is not installed.
    """
    unitless = [path.name for path in paths if path.suffix.lower() in UNITLESS]
    if unitless and unit is None:
        message = f"the unit of {listed(unitless)} is not known: such files state none"
        raise InputError(message, "Add --unit mm, or the unit in which they were exported.")
    names, used, parts = accepted_names([path.stem for path in paths], "part", is_frame_name), set[str](), []
    for path in paths:
        scale = unit if unit is not None and path.suffix.lower() in UNITLESS else 1.0
        own = unique_name(names[path.stem], used)
        used.add(own)
        placed = PlacedBody(_body(path, scale), identity_pose(), (path.stem,))
        parts.append(ImportedPart(own, identity_pose(), (placed,)))
    notes = [f"{listed(unitless)}: lengths in units of {unit:g} m"] if unitless and unit is not None else []
    if stated := [path.name for path in paths if path.suffix.lower() not in UNITLESS]:
        notes.append(f"{listed(stated)}: in the unit that the file states, or m")
    return CadAssembly(name, tuple(parts), tuple(notes))


def _body(path: Path, scale: float) -> Body:
    """A closed mesh as data, in m."""
    try:
        triangles = read_triangles(path)
        if len(triangles) > MOST_TRIANGLES:
            message = f"it has {len(triangles)} triangles, and at most {MOST_TRIANGLES} are read"
            raise InputError(message, "Export it more coarsely.")
        found = solid(triangles, outward=True)
    except InputError as error:
        remedy = error.remedy or "Repair it, and export it again"
        raise InputError(f"{path}: {error.message}", f"{remedy.rstrip('.')}, or leave it out.") from error
    second = np.zeros((3, 3))
    for (row, column), value in zip(PRODUCTS, found["moments"], strict=True):
        second[row, column] = second[column, row] = value
    inertia = scale**5 * (np.trace(second) * np.eye(3) - second)
    volume = MassProperties(scale**3 * found["volume"], scale * np.array(found["center"]), inertia)
    return Body(volume, scale * triangles, faces_of_mesh(scale * triangles), path, scale)
