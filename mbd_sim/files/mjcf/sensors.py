"""The sensors of a compiled MJCF that a mechanism file has as well; all others are listed.

A sensor of MuJoCo measures one quantity. The one here may measure another one too, such as an `imu` for a `gyro`.
"""

from __future__ import annotations

from typing import Any

from mbd_sim.base.geometry.pose import Pose, identity_pose
from mbd_sim.files.mjcf.compiled_model import pose
from mbd_sim.files.mjcf.parts import ModelParts
from mbd_sim.files.text.sampling import sampling_keys
from mbd_sim.mechanism.elements.parts import GROUND

# The record of each kind of sensor at a frame, and the quantity that has its cutoff as `limit`; "" for its own key.
AT_SITE: dict[str, tuple[dict[str, Any], str]] = {
    "ACCELEROMETER": ({"type": "accelerometer"}, ""),
    "GYRO": ({"type": "imu"}, "angular_velocity"),
    "VELOCIMETER": ({"type": "twist", "axes": "frame"}, "velocity"),
}
ON_JOINT: dict[str, tuple[dict[str, Any], str]] = {
    "FORCE": ({"type": "force_torque"}, "force"),
    "TORQUE": ({"type": "force_torque"}, "torque"),
}
OF_FRAME: dict[str, tuple[dict[str, Any], str]] = {
    "FRAMEPOS": ({"type": "pose"}, "position"),
    "FRAMEQUAT": ({"type": "pose"}, ""),
    "FRAMELINVEL": ({"type": "twist"}, "velocity"),
    "FRAMEANGVEL": ({"type": "twist"}, "angular_velocity"),
}


def add_sensors(parts: ModelParts) -> None:
    """Add the sensors of a model, and note those that are not read."""
    model, m, places = parts.model, parts.model.m, dict[tuple[str, int], str]()
    for index in range(m.nsensor):
        kind = _name_of(model.mujoco.mjtSensor, m.sensor_type[index])
        record = _record(parts, places, index, kind)
        if isinstance(record, str):
            model.leave_out(record, "sensor", index)
            continue
        sampling, problems = sampling_keys(float(m.sensor_interval[index][0]), float(m.sensor_delay[index]))
        for problem in problems:
            model.leave_out(problem, "sensor", index)
        if m.sensor_noise[index]:
            model.leave_out("noise of sensors, which MuJoCo does not add either", "sensor", index)
        name = model.name("sensor", index) or f"{kind.lower()}_{index}"
        parts.add("sensors", "sensor", index, name, record | sampling)


def _name_of(kinds: Any, value: Any) -> str:
    return str(kinds(value).name).split("_", 1)[1]


def _record(parts: ModelParts, places: dict[tuple[str, int], str], index: int, kind: str) -> dict[str, Any] | str:
    """The record of a sensor, or why there is none.

    :param places: the points of earlier sensors by the kind and the number of what they measure.
    """
    m, target = parts.model.m, int(parts.model.m.sensor_objid[index])
    cutoff = float(m.sensor_cutoff[index])
    if kind == "JOINTVEL":
        name, limit = parts.joints[target], {"limit": cutoff} if cutoff else {}
        return {"type": "tachometer", "joint": name, **limit}
    if kind == "JOINTPOS":
        return "positions of joints as sensors, which are not read: joint states have them"
    if kind in OF_FRAME and m.sensor_refid[index] >= 0:
        return f"sensors of the kind {kind.lower()} relative to another frame, which are not read"
    found = {**AT_SITE, **ON_JOINT, **OF_FRAME}.get(kind)
    measured = _name_of(parts.model.mujoco.mjtObj, m.sensor_objtype[index]), target
    owner = _frame(parts, *measured) if found else None
    if found is None or owner is None:
        return f"sensors of the kind {kind.lower()}, which are not read"
    part, place, name = owner
    if part == GROUND:
        return "sensors of the world, which are not read"
    record, quantity = found
    if kind in ON_JOINT:
        record = {**record, "joint": parts.inward[part]}
    limit = {"limit": cutoff} if cutoff and kind != "FRAMEQUAT" else {}
    if measured not in places:
        places[measured] = parts.point(part, place, name)
    return {**record, "at": places[measured], **({quantity: limit} if quantity and limit else limit)}


def _frame(parts: ModelParts, kind: str, index: int) -> tuple[str, Pose, str] | None:
    """The part, the pose there and the name of what a sensor measures; None for cameras and others."""
    m = parts.model.m
    match kind:
        case "SITE":
            return parts.sites[index].part, parts.sites[index].pose, parts.model.name("site", index) or "site"
        case "GEOM":
            place, name = pose(m.geom_pos[index], m.geom_quat[index]), parts.geom_names[index]
            return parts.parts[int(m.geom_bodyid[index])], place, name
        case "XBODY":
            return parts.parts[index], identity_pose(), ""
        case "BODY":
            return parts.parts[index], pose(m.body_ipos[index], m.body_iquat[index]), "center"
    return None
