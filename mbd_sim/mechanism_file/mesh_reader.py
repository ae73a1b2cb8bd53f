"""The surfaces of mesh files, read by trimesh."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from mbd_sim.errors import InputError
from mbd_sim.geometry.pose import Array
from mbd_sim.packages import require_packages

FORMATS = (".dae", ".glb", ".gltf", ".obj", ".stl")  # of the files that are read


class MeshError(InputError):
    """The file of a mesh cannot be read."""


def read_triangles(path: Path) -> Array:
    """All triangles (n, 3, 3) of a mesh in the axes of its file, in m if the file states its unit.

    :raises MeshError: the file cannot be read, or has no triangles.
    :raises MissingPackageError: trimesh is not installed, or what it needs for this file.
    """
    if path.suffix.lower() not in FORMATS:
        raise MeshError(f"its format is none of {', '.join(FORMATS)}")
    found = np.asarray(read_scene(path).to_mesh().triangles, dtype=float)
    if not len(found) or not np.all(np.isfinite(found)):
        raise MeshError("it contains no triangles, or some that are not finite", "Export the mesh again")
    return found


def read_scene(path: Path) -> Any:
    """The scene of a file in m. The vertical axis that a COLLADA file declares is ignored, as in RViz.

    :raises MeshError: the file cannot be read.
    :raises MissingPackageError: trimesh is not installed, or what it needs for this file.
    """
    require_packages("trimesh", purpose="Reading this mesh")
    if path.suffix.lower() == ".dae":
        require_packages("collada", purpose="Reading this mesh")
    import trimesh

    try:
        scene = trimesh.load_scene(path, process=False)
        stated = path.suffix.lower() == ".dae" and scene.units not in (None, "meters")
        return scene.convert_units("meters") if stated else scene
    except Exception as error:  # trimesh raises what its readers raise
        first = (str(error).splitlines() or [""])[0]
        message = f"it cannot be read as {path.suffix.lower()[1:].upper()}: {first or type(error).__name__}"
        raise MeshError(message, "Export the mesh again") from error
