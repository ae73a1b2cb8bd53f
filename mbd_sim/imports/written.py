"""An assembly as a mechanism file with the meshes beside it: the chosen joints, and the others as comments."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mbd_sim.base.geometry import rotation as rot
from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.files.text.yaml_text import yaml_text
from mbd_sim.imports.assembly import Body, CadAssembly, ImportedPart
from mbd_sim.imports.choice import Choice
from mbd_sim.imports.joints import NEED_AXIS, Candidate
from mbd_sim.imports.masses import MassTable
from mbd_sim.mechanism.elements.joint_types import JointType
from mbd_sim.mechanism.elements.parts import GROUND
from mbd_sim.mechanism.mass_properties import MassProperties
from mbd_sim.mechanism.values.names import reference, unique_name

GRAVITY = 9.81  # m/s²
DIGITS = 13  # of masses and inertias
NEGLIGIBLE = 1e-10  # products of inertia relative to the largest moment, as the integrals are not more exact
ROUND_OFF = 1e-13  # m, and of rotations
UP: Mapping[str, tuple[int, int]] = {
    sign + "xyz"[axis]: (axis, -1 if sign else 1) for axis in range(3) for sign in ("", "-")
}


@dataclass(frozen=True, eq=False)
class WrittenAssembly:
    """What is to be written: the `text` of the mechanism file, and meshes by their names, without a folder."""

    text: str
    meshes: Mapping[str, Array]


def written(
    assembly: CadAssembly,
    table: MassTable,
    candidates: Sequence[Candidate],
    choice: Choice,
    out: Path,
    up: str = "z",
) -> WrittenAssembly:
    """The mechanism file of an assembly.

    :param out: the mechanism file, beside which the meshes are in the folder `mesh_folder`.
    :param up: the axis of the assembly that points upward, such as z or -y.
    :raises InputError: the mass of a part is not known.
    """
    names = mesh_names(assembly)
    points = _points(assembly, candidates)
    axis, sign = UP[up]
    gravity = [0.0, 0.0, 0.0]
    gravity[axis] = -sign * GRAVITY
    data: dict[str, Any] = {
        "mechanism": assembly.name,
        "description": f"Imported from {assembly.name}.",
        "gravity": gravity,
        "ground": {"points": {name: _point_data(assembly, name) for name in choice.held}},
        "parts": {part.name: _part_data(part, table, points[part.name], names, out) for part in assembly.parts},
    }
    head = [*assembly.notes, "Joints that were found and not chosen are comments at the end of this file."]
    text = yaml_text(data, head) + "joints:\n" + "".join(_joint_lines(assembly, candidates, choice))
    meshes = {names[body]: body.triangles for body in names}
    return WrittenAssembly(text, meshes)


def mesh_folder(out: Path) -> Path:
    """The folder for the meshes of a mechanism file."""
    return out.with_name(f"{out.stem}_meshes")


def mesh_names(assembly: CadAssembly) -> dict[Body, str]:
    """A name of a file, without its suffix, for each body that is not read from one, however often it is placed."""
    found: dict[Body, str] = {}
    used: set[str] = set()
    for part in assembly.parts:
        for placed in part.bodies:
            if placed.body not in found and placed.body.file is None:
                plain = re.sub(r"[^\w.-]+", "_", placed.names[0]).strip("._")[:60] or "part"
                number, name = 1, plain
                while name.casefold() in used:
                    number += 1
                    name = f"{plain}_{number}"
                used.add(name.casefold())
                found[placed.body] = name
    return found


def write_stl(path: Path, triangles: Array) -> None:
    """Write triangles (n, 3, 3) in m as a binary STL."""
    edges = triangles[:, 1:] - triangles[:, :1]
    normals = np.cross(edges[:, 0], edges[:, 1])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    rows = np.zeros(len(triangles), record)
    rows["normal"] = normals / np.where(lengths > 0.0, lengths, 1.0)
    rows["corners"] = triangles
    head = b"binary STL in meters, written by mbd_sim".ljust(80) + np.uint32(len(triangles)).tobytes()
    path.write_bytes(head + rows.tobytes())


def _points(assembly: CadAssembly, candidates: Sequence[Candidate]) -> dict[str, dict[str, Any]]:
    """The points of each part, one for each joint that is offered, named after the other part."""
    poses = {part.name: part.pose for part in assembly.parts}
    found: dict[str, dict[str, Any]] = {name: {} for name in poses}
    for candidate in candidates:
        for part, other in (candidate.parts, candidate.parts[::-1]):
            # In the axes of the assembly, so that all joints start at zero.
            inner = poses[part].inverse() @ Pose(candidate.point, np.eye(3))
            found[part][other] = _placed(inner, "list")
    return found


def _point_data(assembly: CadAssembly, name: str) -> Any:
    """The pose of a part as a point of ground."""
    return _placed(next(part.pose for part in assembly.parts if part.name == name), "list")


def _placed(pose: Pose, plain: str) -> Any:
    """A pose as the data of a point, or as keys of a mesh; what is zero is left out."""
    at = _vector(pose.position)
    turned = np.max(np.abs(pose.rotation - np.eye(3))) > ROUND_OFF
    if plain == "list" and not turned:
        return at
    data: dict[str, Any] = {"at": at} if plain == "list" or any(at) else {}
    if turned:
        data["rotate"] = {"quaternion": [_clean(number) for number in rot.to_quaternion(pose.rotation)]}
    return data


def _vector(position: Array) -> list[float]:
    return [_clean(number) for number in position]


def _clean(number: float) -> float:
    """A number of the size of 1 without round-off."""
    return round(float(number), 12) + 0.0


def _part_data(
    part: ImportedPart, table: MassTable, points: dict[str, Any], names: Mapping[Body, str], out: Path
) -> dict[str, Any]:
    found, folder = table.properties(part), mesh_folder(out).name
    if part.bodies[0].body.file is not None:
        return {**_mesh_data(part, table, out), "points": points or None}
    meshes = [
        {"file": f"{folder}/{names[placed.body]}.stl", **_placed(placed.pose, "keys"), "color": placed.color}
        for placed in part.bodies
    ]
    return {
        "mass": _digits(found.mass, found.mass),
        "center": _vector(found.center),
        "inertia": _inertia(found),
        "meshes": meshes,
        "points": points or None,
    }


def _mesh_data(part: ImportedPart, table: MassTable, out: Path) -> dict[str, Any]:
    """A part whose mass, center and inertia follow from the file of its mesh."""
    (placed,) = part.bodies
    assert placed.body.file is not None
    file = os.path.relpath(placed.body.file.absolute(), out.absolute().parent)
    mesh: dict[str, Any] = {"file": file, "scale": None if placed.body.scale == 1.0 else placed.body.scale}
    mass, material = table.mass_of(part), table.material_of(part, placed)
    if mass is not None:
        return {"mesh": {**mesh, "mass": mass}}
    assert material is not None
    if material.name:
        return {"material": material.name, "mesh": mesh}
    return {"mesh": {**mesh, "density": material.density}}


def _inertia(found: MassProperties) -> Any:
    inertia = found.inertia
    largest = float(np.max(np.diag(inertia)))
    values = [
        _digits(inertia[row, column], largest) for row, column in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    ]
    if not any(values[3:]):
        return values[:3]
    return {key: value for key, value in zip(("xx", "yy", "zz", "xy", "xz", "yz"), values, strict=True) if value}


def _digits(value: float, largest: float) -> float:
    """A number with `DIGITS` digits, 0 where it is round-off in comparison with the largest."""
    return 0.0 if abs(value) <= NEGLIGIBLE * largest else float(f"{value:.{DIGITS}g}")


def _joint_lines(assembly: CadAssembly, candidates: Sequence[Candidate], choice: Choice) -> Iterator[str]:
    used = {candidate.name for candidate in candidates}
    for number, part in enumerate(choice.held):
        name = unique_name(f"{part}_mount", used)
        used.add(name)
        if number:
            yield "  # No joint that was chosen connects it: held until one is.\n"
        mount = "free" if choice.is_free and not number else "fixed"
        yield _entry(name, {"type": mount, "between": [reference(GROUND, part), reference(part)]})
    order = _from_ground(assembly, candidates, choice)
    for candidate in candidates:
        if candidate.number in choice.types:
            yield f"  # {candidate.number}: {candidate.why}\n"
            yield _entry(candidate.name, _joint_data(candidate, choice.types[candidate.number], order))
    for candidate in candidates:
        if candidate.number not in choice.types:
            kind = candidate.type
            words = "" if kind is not None else "; no joint has this freedom, so choose a type"
            yield f"  # {candidate.number}: {candidate.why}{words}\n"
            entry = _entry(candidate.name, _joint_data(candidate, kind or "fixed", order))
            yield "".join(f"  # {line[2:]}" for line in entry.splitlines(keepends=True))


def _entry(name: str, joint: dict[str, Any]) -> str:
    return yaml_text({"joints": {name: joint}}).partition("\n")[2]


def _joint_data(candidate: Candidate, kind: JointType, order: Mapping[str, int]) -> dict[str, Any]:
    one, other = sorted(candidate.parts, key=lambda name: order[name])
    data: dict[str, Any] = {"type": kind, "between": [reference(one, other), reference(other, one)]}
    if kind in NEED_AXIS and candidate.axis is not None:
        data["axis"] = [_clean(number) for number in candidate.axis]
    return data


def _from_ground(assembly: CadAssembly, candidates: Sequence[Candidate], choice: Choice) -> dict[str, int]:
    """The rank of each part: first those nearest to ground, over the joints that were chosen."""
    neighbors: dict[str, list[str]] = {part.name: [] for part in assembly.parts}
    for candidate in candidates:
        if candidate.number in choice.types:
            one, other = candidate.parts
            neighbors[one].append(other)
            neighbors[other].append(one)
    order = list(choice.held)
    for name in order:  # grows
        order += [other for other in neighbors[name] if other not in order]
    return {name: rank for rank, name in enumerate(order)}
