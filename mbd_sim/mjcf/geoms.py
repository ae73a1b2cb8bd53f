"""Geoms: the mass, center and inertia that a body has from them, and the shapes with which they are drawn.

MuJoCo's sizes are radii and half lengths. A capsule is a cylinder with two half balls, whose centers of mass are at 3/8
of the radius from their plane faces.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import PurePath
from typing import Any

import numpy as np

from mbd_sim.geometry.pose import Array, Pose
from mbd_sim.geometry.rotation import to_quaternion
from mbd_sim.mechanism.mass_properties import MassProperties
from mbd_sim.mjcf.compiler_options import Context, turning_z
from mbd_sim.mjcf.items import Item
from mbd_sim.urdf.value_reader import rows
from mbd_sim.urdf.xml_elements import Element

SIZES = {"sphere": 1, "capsule": 2, "cylinder": 2, "ellipsoid": 3, "box": 3}
MASSLESS = ("plane", "hfield")
UNKNOWN = ("mesh", "sdf")  # their mass depends on a file
LONG = ("capsule", "cylinder", "box", "ellipsoid")  # may be given by their ends
DENSITY = 1000.0  # kg/m³, where a geom gives neither mass nor density


@dataclass(frozen=True, eq=False)
class Geom:
    """A geom in its body's frame: its type, its sizes as in MJCF, its pose, and what it was read from."""

    item: Item
    kind: str
    size: tuple[float, ...]
    pose: Pose

    @property
    def counts(self) -> bool:
        """Whether it may have a mass: neither a plane nor a height field, nor a geom whose mass or density is 0."""
        named = "mass" if self.item.has("mass") else "density"
        return self.kind not in MASSLESS and self.item.number_from_zero(named, DENSITY) > 0.0


def geom_of(context: Context, element: Element, key: str, childclass: str) -> Geom:
    """A geom with its sizes; those that are missing or wrong are reported, and 1 m here."""
    item = context.defaults.item(element, key, childclass)
    kind = item.choice("type", (*SIZES, *MASSLESS, *UNKNOWN), "sphere")
    if kind not in SIZES:
        return Geom(item, kind, (), context.pose(item))
    pose, length = ends(context, item) if item.has("fromto") and kind in LONG else (context.pose(item), None)
    if item.has("mesh"):
        message = f"a {kind} that is fitted to a mesh has a size that depends on another file"
        item.report("mesh", message, f"Give the size, and remove 'mesh': {COMPILED}")
        return Geom(item, kind, (1.0,) * SIZES[kind], pose)
    return Geom(item, kind, _size(item, kind, length), pose)


COMPILED = "mujoco.mj_saveLastXML writes a model with explicit numbers."


def ends(context: Context, item: Item) -> tuple[Pose, float]:
    """The pose and half the length of an element that is given by its ends; z points from the second to the first."""
    numbers = item.numbers("fromto", 6) or [0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
    start, end = np.array(numbers[:3]), np.array(numbers[3:])
    length = float(np.linalg.norm(start - end))
    if length == 0.0:
        item.report("fromto", "has no length", "Write two points that differ.")
        return context.pose(item), 1.0
    return Pose(0.5 * (start + end), turning_z((start - end) / length)), 0.5 * length


def _size(item: Item, kind: str, length: float | None) -> tuple[float, ...]:
    count = SIZES[kind]
    wanted = count if length is None else 1
    numbers = item.numbers("size", 1, 3)
    if numbers is None or len(numbers) < wanted:
        if not item.has("size") or numbers is not None:
            item.report("size", f"a {kind} needs {wanted} sizes", "Give radius or half lengths in m.")
        return (1.0,) * count
    size = (*numbers[:wanted], *(() if length is None else (length,)))
    if length is not None and count == 3:
        size = (size[0], size[0], length)  # MuJoCo takes one size across the axis, even if there are two
    if min(size) <= 0.0:
        item.report("size", "must be positive", "Give radius or half lengths in m.")
        return (1.0,) * count
    return size


def mass_of(geom: Geom) -> MassProperties:
    """Its mass properties in its body's frame. It must have a known volume."""
    volume, moments = _solid(geom.kind, geom.size)
    item = geom.item
    mass = item.number_from_zero("mass") if item.has("mass") else volume * item.number_from_zero("density", DENSITY)
    return MassProperties(mass, np.zeros(3), mass * np.diag(moments)).placed(geom.pose)


def _solid(kind: str, size: tuple[float, ...]) -> tuple[float, Array]:
    """The volume in m³, and the principal moments of inertia (3,) per mass in m²."""
    match kind, size:
        case "sphere", (r,):
            return 4.0 / 3.0 * math.pi * r**3, np.full(3, 0.4 * r * r)
        case "cylinder", (r, half):
            across = (3.0 * r * r + (2.0 * half) ** 2) / 12.0
            return 2.0 * math.pi * r * r * half, np.array([across, across, 0.5 * r * r])
        case "ellipsoid", (a, b, c):
            return 4.0 / 3.0 * math.pi * a * b * c, np.array([b * b + c * c, a * a + c * c, a * a + b * b]) / 5.0
        case "box", (a, b, c):
            return 8.0 * a * b * c, np.array([b * b + c * c, a * a + c * c, a * a + b * b]) / 3.0
    r, half = size
    rod, balls = 2.0 * math.pi * r * r * half, 4.0 / 3.0 * math.pi * r**3
    across = rod * (3.0 * r * r + 4.0 * half * half) / 12.0 + balls * (0.4 * r * r + half * half + 0.75 * r * half)
    along = rod * 0.5 * r * r + balls * 0.4 * r * r
    return rod + balls, np.array([across, across, along]) / (rod + balls)


def drawn(geom: Geom, meshes: Mapping[str, Item], context: Context) -> tuple[str, dict[str, Any]] | None:
    """The section of a part, `shapes` or `meshes`, and the entry with which a geom is drawn; None if it is not."""
    center = geom.pose.position
    pose = rotated(geom.pose)
    record: dict[str, Any]
    match geom.kind, geom.size:
        case "sphere", (r,):
            record = {"type": "sphere", "radius": r, **_at(center)}
        case "capsule", (r, half):
            arm = geom.pose.rotation @ np.array([0.0, 0.0, half])
            record = {"type": "rod", "from": rows(center - arm), "to": rows(center + arm), "radius": r}
        case "cylinder", (r, half):
            record = {"type": "cylinder", "radius": r, "length": 2.0 * half, **_at(center), **pose}
        case "box", size:
            record = {"type": "block", "size": [2.0 * side for side in size], **_at(center), **pose}
        case _:
            mesh = meshes.get(geom.item.text("mesh")) if geom.kind == "mesh" else None
            if mesh is None or not mesh.has("file"):
                geom.item.leave_out(f"{geom.kind} geoms, which are not drawn")
                return None
            geom.item.leave_out("meshes, which are only drawn")
            return "meshes", {**_mesh(mesh, context), **_at(center), **pose, **_color(geom.item)}
    return "shapes", record | _color(geom.item)


def _mesh(mesh: Item, context: Context) -> dict[str, Any]:
    file = mesh.text("file")
    file = PurePath(file).name if context.compiler.strippath else file
    scale = mesh.numbers("scale", 3)
    return {"file": str(PurePath(context.compiler.mesh_folder) / file)} | ({"scale": scale} if scale else {})


def _at(position: Array) -> dict[str, Any]:
    return {"at": rows(position)} if np.any(position) else {}


def rotated(pose: Pose) -> dict[str, Any]:
    """The key `rotate` of a pose, if it needs one."""
    return {"rotate": {"quaternion": rows(to_quaternion(pose.rotation))}} if np.any(pose.rotation != np.eye(3)) else {}


def _color(item: Item) -> dict[str, Any]:
    rgba = item.numbers("rgba", 4)
    if rgba is None:
        return {}
    return {"color": "#" + "".join(f"{round(255.0 * min(max(value, 0.0), 1.0)):02x}" for value in rgba[:3])}
