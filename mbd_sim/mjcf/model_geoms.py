"""Geoms of a compiled MJCF as shapes and meshes that are drawn."""

from __future__ import annotations

from pathlib import PurePath
from typing import Any

import numpy as np

from mbd_sim.geometry.pose import Array, Pose
from mbd_sim.geometry.rotation import to_quaternion
from mbd_sim.mjcf.compiled_model import CompiledModel, pose
from mbd_sim.urdf.value_reader import rows

GRAY = np.array([0.5, 0.5, 0.5, 1.0], dtype=np.float32)


def drawn(model: CompiledModel, geom: int) -> tuple[str, dict[str, Any]] | None:
    """The section of a part, `shapes` or `meshes`, and the entry with which a geom is drawn; None if it is not."""
    m = model.m
    kind = model.mujoco.mjtGeom(m.geom_type[geom]).name.removeprefix("mjGEOM_")
    place, size = pose(m.geom_pos[geom], m.geom_quat[geom]), m.geom_size[geom].tolist()
    turned = rows(to_quaternion(place.rotation))
    at = {"at": rows(place.position)} if np.any(place.position) else {}
    pose_keys = at | ({"rotate": {"quaternion": turned}} if np.any(place.rotation != np.eye(3)) else {})
    record: dict[str, Any]
    match kind:
        case "SPHERE":
            record = {"type": "sphere", "radius": size[0], **at}
        case "CAPSULE":
            arm = place.rotation @ np.array([0.0, 0.0, size[1]])
            record = {
                "type": "rod",
                "from": rows(place.position - arm),
                "to": rows(place.position + arm),
                "radius": size[0],
            }
        case "CYLINDER":
            record = {"type": "cylinder", "radius": size[0], "length": 2.0 * size[1], **pose_keys}
        case "BOX":
            record = {"type": "block", "size": [2.0 * side for side in size], **pose_keys}
        case _:
            return _mesh(model, geom, kind, place)
    return "shapes", record | _color(model, geom)


def _mesh(model: CompiledModel, geom: int, kind: str, place: Pose) -> tuple[str, dict[str, Any]] | None:
    """A mesh as its file has it: the compiler has moved it to its center and principal axes."""
    m, number = model.m, int(model.m.geom_dataid[geom])
    mesh = model.spec.meshes[number] if kind == "MESH" else None
    if mesh is None or not mesh.file:
        model.leave_out(f"{kind.lower()} geoms, which are not drawn", "geom", geom)
        return None
    center = pose(m.mesh_pos[number], m.mesh_quat[number])
    own = place @ center.inverse()
    file = PurePath(mesh.file).name if model.spec.strippath else mesh.file
    record: dict[str, Any] = {"file": str(PurePath(model.spec.meshdir) / file)}
    if np.any(mesh.scale != 1.0):
        record["scale"] = mesh.scale.tolist()
    if np.any(own.position):
        record["at"] = rows(own.position)
    if np.any(own.rotation != np.eye(3)):
        record["rotate"] = {"quaternion": rows(to_quaternion(own.rotation))}
    return "meshes", record | _color(model, geom)


def _color(model: CompiledModel, geom: int) -> dict[str, str]:
    """The color of a geom, unless it is that of all geoms."""
    m, material = model.m, int(model.m.geom_matid[geom])
    rgba: Array = m.mat_rgba[material] if material >= 0 else m.geom_rgba[geom]
    if material < 0 and np.all(rgba == GRAY):
        return {}
    return {"color": "#" + "".join(f"{round(255.0 * min(max(value, 0.0), 1.0)):02x}" for value in rgba[:3].tolist())}
