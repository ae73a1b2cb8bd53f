"""The files of meshes: where they are, the surfaces that trimesh reads from them, and the solids that these enclose.

A mesh is named as URDFs write it: by a `package://` URI, a `file://` URI or a path. A part with a mass and without an
inertia gets center and inertia from its closed meshes; the `solid` of each is written into the data of the file, and
so are the points of a hull, so that a recording and a converted file do not depend on the file of the mesh.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlparse

import numpy as np

from mbd_sim.base.errors import InputError, MechanismError, listed
from mbd_sim.base.geometry.convex_hull import convex_hull, face_normals, fans
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.linear_algebra import product, products, total
from mbd_sim.base.packages import require_packages
from mbd_sim.files.text.library import digest_of_file
from mbd_sim.files.text.ros_packages import installed_folders, package_folders
from mbd_sim.mechanism.elements.parts import MOST_CORNERS
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.values.source import Location, Source


def mesh_path(uri: str, source: str) -> Path | None:
    """The file of a mesh, or None if there is none on this machine.

    A package is searched for as `ros_packages` says.

    :param source: the file of the mechanism, from whose folder relative paths count.
    """
    return next((path for path in _candidates(uri, Path(source).absolute().parent) if _is_file(path)), None)


def files_of(mechanism: Mechanism) -> tuple[str, ...]:
    """The file of a mechanism, then those from which its values come, and those of its meshes as far as they are found.

    Models of an SDF and the URDF of a mechanism file are among them.
    """
    source = mechanism.source
    named = [origin.file for origin in source.origins.values()]
    uris = [mesh.file for part in mechanism.parts.values() for mesh in part.meshes]
    meshes = [str(path) for uri in uris if (path := mesh_path(uri, source.file)) is not None]
    return tuple(dict.fromkeys([source.file, *(source.other_files or ()), *named, *meshes]))


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
            name: _with_uris(part, uris)
            for name, part in source.data["parts"].items()
            if part.get("meshes") or part.get("mesh")
        }
        source = replace(source, data={**source.data, "parts": {**source.data["parts"], **given}})
    return replace(mechanism, parts=parts, source=source)


def _with_uris(part: Mapping[str, Any], uris: Mapping[str, str]) -> dict[str, Any]:
    """The data of a part with other URIs of its meshes."""
    changed = dict(part)
    for steps, mesh in mesh_entries(part):
        changed = with_value(changed, steps, mesh | {"file": uris[mesh["file"]]})
    return changed


def mesh_entries(part: Any) -> list[tuple[Location, Any]]:
    """The meshes in the data of a part, each with its place there: in `mesh` or in `meshes`."""
    if not isinstance(part, dict):
        return []
    single, several = part.get("mesh"), part.get("meshes")
    entries: list[tuple[Location, Any]] = [] if single is None else [(("mesh",), single)]
    return entries + [
        (("meshes", number), mesh) for number, mesh in enumerate(several if isinstance(several, list) else [])
    ]


def _candidates(uri: str, folder: Path) -> Iterator[Path]:
    scheme, _, rest = uri.partition("://")
    if not rest:
        yield folder / uri
    elif scheme == "file":
        yield Path(unquote(urlparse(uri).path))
    elif scheme in ("package", "model"):
        package, _, inner = rest.partition("/")
        yield from (root / inner for root in package_folders(package, folder))


def _installed(uri: str) -> Iterator[Path]:
    """Where the packages of a ROS 2 environment would have the file of a `package://` URI."""
    package, _, inner = uri.partition("://")[2].partition("/")
    if package:
        yield from (folder / inner for folder in installed_folders(package))


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):  # a name too long, a NUL in it
        return False


FORMATS = (".3mf", ".dae", ".glb", ".gltf", ".obj", ".ply", ".stl")  # of the files that are read


_NEEDED = {".dae": ("collada",), ".3mf": ("networkx", "lxml")}  # by trimesh
_WITH_UNIT = (".dae", ".3mf")  # formats that state their unit; glTF is in m


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
    if further := _NEEDED.get(path.suffix.lower()):
        require_packages(*further, purpose="Reading this mesh")
    import trimesh

    try:
        scene = trimesh.load_scene(path, process=False)
        stated = path.suffix.lower() in _WITH_UNIT and scene.units not in (None, "meters")
        return scene.convert_units("meters") if stated else scene
    except Exception as error:  # trimesh raises what its readers raise
        first = (str(error).splitlines() or [""])[0]
        message = f"it cannot be read as {path.suffix.lower()[1:].upper()}: {first or type(error).__name__}"
        raise MeshError(message, "Export the mesh again") from error


PRODUCTS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))  # xx, yy, zz, xy, xz, yz
FLAT = 1e-12  # volume, relative to the cube of the size, below which a surface encloses nothing


HOLLOW = 1e-6  # of a hull's size or volume, by which a mesh must be inside or smaller to show that it has hollows


NOT_READ = "meshes that touch nothing, because the file has no contacts; their hulls touch a floor (--floor)"


def with_mesh_hulls(source: Source, touching: bool) -> Source:
    """The source with points in place of the files of hulls, and remarks on what a hull of them does not show.

    :param touching: whether anything can touch. Meshes by which other formats say what touches are otherwise left out,
        and so are those that have no hull; both are noted.
    :raises MechanismError: a file of another hull cannot be read, or its points have no hull.
    """
    parts = source.data.get("parts") if isinstance(source.data, dict) else None
    if not isinstance(parts, dict):
        return source
    changed, remarks, problems, read = dict(parts), [], [], {}
    dropped: dict[str, list[str]] = {}
    for name, part in parts.items():
        for steps, shape in _hulls_of_files(part):
            imported = bool(source.format) and steps[0] == "collisions"
            if imported and not touching:
                changed[name] = with_value(changed[name], steps, None)
                dropped.setdefault(NOT_READ, []).append(name)
                continue
            try:
                path = found_mesh(shape["file"], source.file)
                points, remark = _corners_of(path, f"the mesh {shape['file']} of {name}")
            except InputError as error:
                if imported:
                    changed[name] = with_value(changed[name], steps, None)
                    dropped.setdefault(f"meshes that touch nothing: {error.message}", []).append(name)
                    continue
                message = f"there is no hull of {shape['file']}: {error.message}"
                problems.append(source.problem(("parts", name, *steps, "file"), message, error.remedy))
                continue
            hull = {key: value for key, value in shape.items() if key != "file"} | {"points": points}
            changed[name] = with_value(changed[name], steps, hull)
            remarks.append(remark)
            read[str(path)] = digest_of_file(path)
    if problems:
        raise MechanismError(problems)
    if not read and not dropped:
        return source
    notes = tuple(f"{kind}: {listed(list(dict.fromkeys(names)))}" for kind, names in dropped.items())
    for name in dict.fromkeys(name for names in dropped.values() for name in names):
        kept = [shape for shape in changed[name]["collisions"] if shape is not None]
        changed[name] = {**changed[name], "collisions": kept}
    if not read:
        comments = (*source.comments, *notes) if source.format else source.comments
        return replace(source, data={**source.data, "parts": changed}, notes=(*source.notes, *notes), comments=comments)
    return replace(
        source,
        notes=(*source.notes, *notes),
        data={**source.data, "parts": changed},
        text=None,
        comments=(*source.comments, *notes)
        if source.text is None
        else (f"From {Path(source.file).name} and its meshes.",),
        other_files=None if source.other_files is None else {**source.other_files, **read},
        remarks=(*source.remarks, *(remark for remark in remarks if remark)),
    )


def _hulls_of_files(part: Any) -> Iterator[tuple[Location, Mapping[str, Any]]]:
    """Those shapes of a part that are hulls of files, each with its keys."""
    if not isinstance(part, dict):
        return
    places: list[tuple[Location, Any]] = [(("shape",), part.get("shape"))]
    for key in ("shapes", "collisions"):
        shapes = part.get(key)
        places += [((key, number), shape) for number, shape in enumerate(shapes if isinstance(shapes, list) else [])]
    for steps, shape in places:
        is_hull = isinstance(shape, dict) and shape.get("type") == "hull" and shape.get("points") is None
        if is_hull and isinstance(shape.get("file"), str):
            yield steps, shape


def with_value(part: Mapping[str, Any], steps: Location, value: Any) -> dict[str, Any]:
    """The data of a part with another value of its shape or mesh, or of one of its shapes or meshes."""
    if len(steps) == 1:
        return {**part, str(steps[0]): value}
    key = str(steps[0])
    return {**part, key: [value if number == steps[1] else one for number, one in enumerate(part[key])]}


def _corners_of(path: Path, name: str) -> tuple[list[list[float]], str]:
    """The corners of the hull of a mesh, and a remark if it has hollows, or more corners.

    :raises MeshError: the file cannot be read.
    :raises InputError: its points have no hull.
    """
    triangles = read_triangles(path)
    points = np.unique(triangles.reshape(-1, 3), axis=0)
    hull = convex_hull(points, MOST_CORNERS)
    corners = points[list(hull.corners)]
    size, said, depths = float(np.max(np.ptp(points, axis=0))), [], np.full(len(points), np.inf)
    for face, normal in zip(hull.faces, face_normals(corners, hull.faces), strict=True):
        depths = np.minimum(depths, product(corners[face[0]] - points, normal))
    full = solid(corners[fans(hull.faces)])["volume"]
    fills = not _is_closed(triangles) or solid(triangles)["volume"] > (1.0 - HOLLOW) * full
    if depths.max() > HOLLOW * size or not fills:
        said.append("has hollows, which its hull fills")
    if hull.beyond:
        said.append(
            f"has a hull of more than {MOST_CORNERS} corners: it is that of the {MOST_CORNERS} farthest out, beyond "
            f"which others are by up to {100.0 * hull.beyond / size:.2g} % of its size"
        )
    return corners.tolist(), f"{name} {' and '.join(said)}." if said else ""


def found_mesh(uri: str, file: str) -> Path:
    """The file of a mesh, see `mesh_path`.

    :raises MeshError: there is none.
    """
    path = mesh_path(uri, file)
    if path is None:
        raise MeshError("not found")
    return path


def solid(triangles: Array, outward: bool = False) -> dict[str, Any]:
    """Volume, center and second moments ∫ x y dV about it of what closed surfaces (n, 3, 3) enclose.

    They are added up over the tetrahedra between each triangle and a point. One with the edges a, b, c from that point
    has the volume V = a·(b × c)/6, and ∫ r rᵀ dV = V/20 (a aᵀ + b bᵀ + c cᵀ + s sᵀ) with s = a + b + c.

    :param outward: whether the triangles must turn to the left, seen from outside.
    :raises MeshError: the surface has an edge where it ends or changes its sides, or encloses no volume, or is inside
        out.
    """
    if not _is_closed(triangles):
        raise MeshError("its surface is not closed, or has triangles that are turned over")
    low, high = triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))
    size = float(np.max(high - low))
    edges = (triangles - (low + high) / 2.0) / size  # without units, and near 1
    volumes = total(edges[:, 0] * np.cross(edges[:, 1], edges[:, 2]), 1) / 6.0
    sums = edges.sum(axis=1)
    volume = math.fsum(volumes)
    if abs(volume) <= FLAT:
        raise MeshError("it encloses no volume")
    if outward and volume < 0.0:
        raise MeshError("it is inside out: its triangles face inward", "Flip its normals")
    center = total(volumes[:, None] * sums, 0) / (4.0 * volume)
    squares = products(edges.swapaxes(1, 2), edges) + sums[:, :, None] * sums[:, None, :]
    moments = total(volumes[:, None, None] * squares, 0) / (20.0 * volume) - np.outer(center, center)
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
