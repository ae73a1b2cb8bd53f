"""The files of meshes: where they are, and the surfaces that trimesh reads from them.

A mesh is named as URDFs write it: by a `package://` URI, a `file://` URI or a path.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlparse

import numpy as np

from mbd_sim.base.errors import InputError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.packages import require_packages
from mbd_sim.mechanism.mechanism import Mechanism


def mesh_path(uri: str, source: str) -> Path | None:
    """The file of a mesh, or None if there is none on this machine.

    A package is searched in AMENT_PREFIX_PATH and ROS_PACKAGE_PATH, and then among the folders that contain the
    mechanism's file, beside them and above them.

    :param source: the file of the mechanism, from whose folder relative paths count.
    """
    return next((path for path in _candidates(uri, Path(source).absolute().parent) if _is_file(path)), None)


def resource_uri(uri: str, source: str) -> str:
    """The URI under which other programs find a mesh; empty if its file is not on this machine.

    A `package://` URI that ROS can resolve stays as it is, so that it is valid on other machines too; anything else
    becomes the `file://` URI of the file.
    """
    path = mesh_path(uri, source)
    if path is None:
        return ""
    known = [path for path in _installed(uri) if _is_file(path)] if uri.startswith("package://") else []
    return uri if known else path.absolute().as_uri()


def seen_from(uri: str, source: str, folder: Path | None) -> str:
    """The URI of a mesh for a mechanism file in another folder, or anywhere on this machine if `folder` is None.

    One that would be found there as well stays as it is.
    """
    path = mesh_path(uri, source)
    if path is None and "://" not in uri:
        path = Path(source).absolute().parent / uri
    if path is None or uri.startswith("file://") or any(_is_file(known) for known in _installed(uri)):
        return uri
    if folder is None:
        return path.resolve().as_uri()
    elsewhere = mesh_path(uri, str(folder / "any"))
    if elsewhere is not None and elsewhere.samefile(path):
        return uri
    return os.path.relpath(path, folder.absolute())


def with_meshes_seen_from(mechanism: Mechanism, folder: Path | None) -> Mechanism:
    """The mechanism with URIs of meshes for a file in another folder; see `seen_from`.

    In the text of a mechanism file, which is kept as it was written, they stay.
    """
    source = mechanism.source
    uris = {mesh.file: "" for part in mechanism.parts.values() for mesh in part.meshes}
    uris = {uri: seen_from(uri, source.file, folder) for uri in uris}
    if all(uri == new for uri, new in uris.items()):
        return mechanism
    parts = {
        name: replace(part, meshes=tuple(replace(mesh, file=uris[mesh.file]) for mesh in part.meshes))
        for name, part in mechanism.parts.items()
    }
    if source.text is None or source.changed:
        given = {
            name: part | {"meshes": [mesh | {"file": uris[mesh["file"]]} for mesh in part["meshes"]]}
            for name, part in source.data["parts"].items()
            if part.get("meshes")
        }
        source = replace(source, data={**source.data, "parts": {**source.data["parts"], **given}})
    return replace(mechanism, parts=parts, source=source)


def _candidates(uri: str, folder: Path) -> Iterator[Path]:
    scheme, _, rest = uri.partition("://")
    if not rest:
        yield folder / uri
    elif scheme == "file":
        yield Path(unquote(urlparse(uri).path))
    elif scheme in ("package", "model"):
        package, _, inner = rest.partition("/")
        yield from _installed(uri)
        for root in (*_folders("ROS_PACKAGE_PATH"), folder, *folder.parents):
            yield root / package / inner
            if root.name == package:
                yield root / inner


def _installed(uri: str) -> Iterator[Path]:
    """Where the packages of a ROS 2 environment would have the file of a `package://` URI."""
    package, _, inner = uri.partition("://")[2].partition("/")
    if not package:
        return
    for prefix in _folders("AMENT_PREFIX_PATH"):
        yield prefix / "share" / package / inner


def _folders(variable: str) -> list[Path]:
    return [Path(folder) for folder in os.environ.get(variable, "").split(os.pathsep) if folder]


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):  # a name too long, a NUL in it
        return False


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
