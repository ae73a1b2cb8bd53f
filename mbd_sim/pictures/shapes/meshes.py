"""Meshes as triangles and as glTF, for pictures, and for viewers that cannot read a file."""

from __future__ import annotations

import functools
from collections.abc import Collection
from pathlib import Path

import numpy as np

from mbd_sim.base.errors import MbdSimError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.files.text.mesh_files import MeshError, mesh_path, read_scene, read_triangles
from mbd_sim.mechanism.elements.parts import Mesh, Part
from mbd_sim.mechanism.mechanism import Mechanism

MOST_TRIANGLES = 20_000  # of a mesh in a picture; finer ones are coarsened
FINEST_GRID = 256  # cells along the longest side, to which the corners of finer meshes are moved at first
SIDE = FINEST_GRID + 1  # corners of such cells
CACHED = 64  # meshes


def part_triangles(part: Part, source: str) -> list[tuple[Mesh, Array]]:
    """The meshes of a part that can be drawn, each with its triangles (n, 3, 3) in the part's frame in m.

    :param source: the file of the mechanism, from whose folder relative paths count.
    """
    found = []
    for mesh in part.meshes:
        path = mesh_path(mesh.file, source)
        if path is not None and not reason_not_to_draw(path):
            corners = triangles(path) * np.array(mesh.scale)
            found.append((mesh, mesh.pose.position + corners @ mesh.pose.rotation.T))
    return found


def undrawn_meshes(mechanism: Mechanism, native: Collection[str] = ()) -> list[str]:
    """The meshes of a mechanism that are not drawn, each with the reason.

    :param native: suffixes of the files that the viewer reads by itself.
    """
    found = []
    for uri in dict.fromkeys(mesh.file for part in mechanism.parts.values() for mesh in part.meshes):
        path = mesh_path(uri, mechanism.source.file)
        if path is None:
            found.append(f"{uri} (not found)")
        elif path.suffix.lower() not in native and (reason := reason_not_to_draw(path)):
            found.append(f"{uri} ({reason})")
    return found


def reason_not_to_draw(path: Path) -> str:
    """Why a file cannot be drawn, with the remedy; empty if it can."""
    try:
        triangles(path)
    except MbdSimError as error:
        return str(error).rstrip(".")
    return ""


def triangles(path: Path) -> Array:
    """The triangles (n, 3, 3) of a mesh in the axes of its file, in m if the file states its unit; not to be changed.

    Of a mesh with more than `MOST_TRIANGLES`, the corners are moved to a grid on which fewer remain.

    :raises MeshError: the file cannot be read, or has no triangles.
    :raises MissingPackageError: trimesh is not installed, or what it needs for this file.
    """
    return _triangles(path, *_identity(path))


def as_glb(path: Path) -> bytes:
    """A mesh with its materials as binary glTF, in the axes of its file, in m if the file states its unit.

    :raises MeshError: the file cannot be read.
    :raises MissingPackageError: trimesh is not installed, or what it needs for this file.
    """
    return bytes(read_scene(path).export(file_type="glb"))


def _identity(path: Path) -> tuple[int, int]:
    """What changes when a file is written again."""
    try:
        state = path.stat()
    except OSError as error:
        raise MeshError(f"{error.strerror or error}", "Check the path") from error
    return state.st_mtime_ns, state.st_size


@functools.lru_cache(maxsize=CACHED)
def _triangles(path: Path, _changed: int, _size: int) -> Array:
    found = coarsened(read_triangles(path))
    found.setflags(write=False)
    return found


def coarsened(corners: Array, most: int = MOST_TRIANGLES) -> Array:
    """At most `most` triangles (n, 3, 3) of about the same shape; the same ones if they are few enough.

    All corners in a cell of a grid move to their mean.
    """
    low = corners.min(axis=(0, 1))
    cell = float(np.max(corners.max(axis=(0, 1)) - low)) / FINEST_GRID
    while len(corners) > most and cell > 0.0:
        cells = np.round((corners - low) / cell).astype(np.int64) @ [1, SIDE, SIDE * SIDE]
        number = np.unique(cells, return_inverse=True)[1].reshape(-1)
        sums = [np.bincount(number, weights=values) for values in corners.reshape(-1, 3).T]
        means = np.column_stack(sums) / np.bincount(number)[:, None]
        triples = np.sort(number.reshape(-1, 3), axis=1)
        apart = (triples[:, 0] != triples[:, 1]) & (triples[:, 1] != triples[:, 2])
        if not apart.any():
            break
        corners = means[np.unique(triples[apart], axis=0)]
        cell *= 2.0
    return corners
