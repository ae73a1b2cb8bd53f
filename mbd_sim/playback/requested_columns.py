"""The columns of a table for what a run records on request: reactions, poses, violation of constraints."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from mbd_sim.geometry.pose import Array
from mbd_sim.playback.recorded_mechanism import names_by_topic, recorded_mechanism
from mbd_sim.recording import cdr
from mbd_sim.recording.reader import Recording
from mbd_sim.recording.recorded_file import Message

REACTION = "reaction."
REACTIONS, POSE = "sensor_msgs/msg/MultiDOFJointState", "geometry_msgs/msg/PoseStamped"
_WRENCH = tuple(f"{vector}_{axis}_{unit}" for vector, unit in (("force", "N"), ("moment", "Nm")) for axis in "xyz")
_POSE = ("x_m", "y_m", "z_m", "qx", "qy", "qz", "qw")

ColumnReader = Callable[[Message], tuple[tuple[str, ...], Array]]  # names and values of the columns of a message


def requested_readers(recording: Recording) -> Mapping[str, ColumnReader]:
    """Return functions that read the messages of a run that were recorded on request, by topic."""
    found: dict[str, ColumnReader] = {}
    posed = any(topic.type == POSE for topic in recording.topics.values())
    mechanism = recorded_mechanism(recording) if posed else None
    parts = names_by_topic(mechanism.parts) if mechanism else {}
    for name, topic in recording.topics.items():
        *_, folder, last = ("", *name.split("/"))
        if topic.type == REACTIONS and last == "joint_reactions":
            found[name] = lambda message: _reactions(recording.decoded(message))
        elif topic.type == POSE and folder == "poses":
            part = parts.get(last, last)
            found[name] = lambda message, part=part: _pose(part, recording.decoded(message))  # type: ignore[misc]
        elif topic.type == cdr.MULTI_ARRAY and last == "constraint_violation":
            found[name] = lambda message: _violation(recording.decoded(message))
    return found


def _reactions(message: Any) -> tuple[tuple[str, ...], Array]:
    wrenches = [(wrench.force, wrench.torque) for wrench in message.wrench]
    names = tuple(f"{REACTION}{joint}.{column}" for joint in message.joint_names for column in _WRENCH)
    return names, np.array([[v.x, v.y, v.z] for wrench in wrenches for v in wrench]).reshape(-1)


def _pose(part: str, message: Any) -> tuple[tuple[str, ...], Array]:
    at, turned = message.pose.position, message.pose.orientation
    return tuple(f"pose.{part}.{column}" for column in _POSE), np.array(
        [at.x, at.y, at.z, turned.x, turned.y, turned.z, turned.w]
    )


def _violation(array: cdr.MultiArray) -> tuple[tuple[str, ...], Array]:
    return tuple(f"violation.{label}" for label in array.labels), array.values
