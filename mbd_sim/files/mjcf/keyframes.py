"""The keyframe `start` of an MJCF, which exported files have, as start values of the joints."""

from __future__ import annotations

from typing import Any

import numpy as np

from mbd_sim.files.mjcf.parts import BALL, FREE, ModelParts
from mbd_sim.files.text.xml import rows

START = "start"


def add_start(parts: ModelParts) -> None:
    """Take the positions and velocities of the keyframe; note the others, and what else it has."""
    model, m = parts.model, parts.model.m
    for index in range(m.nkey):
        if model.name("key", index) != START:
            model.leave_out(f"keyframes: the start is the pose of the file, or the keyframe '{START}'", "key", index)
            continue
        if np.any(m.key_ctrl[index]) or np.any(m.key_act[index]):
            model.leave_out("controls and activations of keyframes", "key", index)
        for joint in range(m.njnt):
            position, speed = int(m.jnt_qposadr[joint]), int(m.jnt_dofadr[joint])
            record = parts.sections["joints"][parts.joints[joint]]
            record |= _values(int(m.jnt_type[joint]), m.key_qpos[index][position:], m.key_qvel[index][speed:])


def _values(kind: int, qpos: Any, qvel: Any) -> dict[str, Any]:
    """The start values of a joint, from those of the keyframe that begin with its own."""
    values: dict[str, Any]
    speeds: dict[str, Any]
    if kind == FREE:
        values = {"position": rows(qpos[:3]), "orientation": {"quaternion": rows(qpos[3:7])}}
        speeds = {"velocity": rows(qvel[:3]), "angular_velocity": rows(qvel[3:6])}
    elif kind == BALL:
        values, speeds = {"orientation": {"quaternion": rows(qpos[:4])}}, {"angular_velocity": rows(qvel[:3])}
    else:
        values, speeds = {"position": float(qpos[0])}, {"velocity": float(qvel[0])}
    return values | {key: value for key, value in speeds.items() if np.any(value)}
