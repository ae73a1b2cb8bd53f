"""The sensors of an SDF that a mechanism file has as well: `imu` of links and `force_torque` of joints.

All others are listed. Noise with a standard deviation σ of each measurement has the density σ/√rate.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mbd_sim.base.geometry.pose import Pose
from mbd_sim.files.sdf.links import Values
from mbd_sim.files.text.sampling import STEP, sampling_keys
from mbd_sim.files.text.xml import Element
from mbd_sim.files.urdf.reader import note_unread, read

IMU, FORCE_TORQUE = "imu", "force_torque"
QUIET = ("topic", "visualize", "always_on", "enable_metrics", "frame_id")  # without effect here
READ = {
    "sensor": read("name type", f"pose update_rate imu force_torque {' '.join(QUIET)}"),
    "imu": read("", "angular_velocity linear_acceleration enable_orientation"),
    "force_torque": read("", "frame measure_direction force torque"),
    **dict.fromkeys(("angular_velocity", "linear_acceleration", "force", "torque"), read("", "x y z")),
    **dict.fromkeys("xyz", read("", "noise")),
    "noise": read("type", "mean stddev bias_mean"),
    "pose": read("rotation_format degrees"),
}


def sensor_record(values: Values, sensor: Element, key: str) -> dict[str, Any] | None:
    """The record of a sensor without its place; None, with a note, for those that are not read."""
    kind = sensor.attributes.get("type", "")
    if kind not in (IMU, FORCE_TORQUE):
        values.reading.leave_out_at(f"{kind or 'untyped'} sensors, which are not read", sensor, key)
        return None
    note_unread(values.reading, sensor, key, READ)
    rate = values.number_from_zero(sensor, "update_rate", key)
    record, changed = sampling_keys(1.0 / rate if rate else 0.0, 0.0)
    for sentence in changed:
        values.reading.leave_out_at(sentence, sensor, key)
    own, density = sensor.first(kind), math.sqrt(record.get("rate", 1.0 / STEP))
    found: dict[str, Any] = {"type": kind, **record}
    names = {"angular_velocity": "angular_velocity", "linear_acceleration": "specific_force"}
    for tag, quantity in names.items() if kind == IMU else (("force", "force"), ("torque", "torque")):
        element = None if own is None else own.first(tag)
        if element is not None and (errors := _errors(values, element, f"{key}.{tag}", density)):
            found[quantity] = errors
    if kind == IMU and (
        own is None or own.first("enable_orientation") is None or values.flag(own, "enable_orientation", key)
    ):
        found["orientation"] = {}
        sentence = "orientations of imu sensors in the axes of the world, not relative to the first one"
        values.reading.leave_out_at(sentence, sensor, key)
    return found


def _errors(values: Values, quantity: Element, key: str, density: float) -> dict[str, float]:
    """The bias and the noise of a quantity, which are those of its first axis that has some."""
    found = []
    for axis in "xyz":
        noise = None if (of_axis := quantity.first(axis)) is None else of_axis.first("noise")
        if noise is None or noise.attributes.get("type", "none") == "none":
            found.append((0.0, 0.0))
            continue
        bias = values.number(noise, "mean", key) + values.number(noise, "bias_mean", key)
        found.append((bias, values.number_from_zero(noise, "stddev", key)))
    if found.count(found[0]) < len(found):
        values.reading.leave_out_at("noise that differs by axis, of which the largest is taken", quantity, key)
    bias, deviation = max(found, key=lambda one: (one[1], abs(one[0])))
    return ({"bias": bias} if bias else {}) | ({"noise_density": deviation / density} if deviation else {})


def load_frame(values: Values, sensor: Element, key: str, joint: Pose, child: Pose) -> Pose:
    """The frame of a load in the world: the origin of its joint, and the axes that the SDF names.

    :param joint: the pose of the joint in the world, and that of its `child`.
    """
    own = sensor.first(FORCE_TORQUE)
    frame = "child" if own is None else values.text(own, "frame", "child")
    direction = "child_to_parent" if own is None else values.text(own, "measure_direction", "child_to_parent")
    if direction != "parent_to_child":
        sentence = "loads from the child on the parent, in place of which their opposite is measured"
        values.reading.leave_out_at(sentence, sensor, key)
    if frame == "sensor":
        return Pose(joint.position, (joint @ values.pose(sensor, key)).rotation)
    if frame != "child":
        values.reading.leave_out_at(
            "axes of the parent of loads, in place of which are those of the child", sensor, key
        )
    return Pose(joint.position, np.array(child.rotation))
