"""Numbers in messages, and answers that something has failed."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from types import ModuleType
from typing import Any

import numpy as np
from geometry_msgs.msg import Accel, Point, Quaternion, Twist, Vector3
from geometry_msgs.msg import Pose as PoseMessage
from rclpy.node import Node

from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.base.geometry.rotation import from_quaternion, to_quaternion
from mbd_sim.simulation.model.state_records import PartMotion

_WORDS = re.compile(r"(?<=[a-z])(?=[A-Z])")
UNIT_NORM = 1e-3  # by how much the norm of a given quaternion may differ from 1


def fail(response: Any, code: int, text: str) -> Any:
    """The response with a code of `Result` or of its own, and the reason."""
    response.result.result, response.result.error_message = code, text
    return response


def filled(message: Any, values: Array) -> Any:
    """The message with x, y and z."""
    message.x, message.y, message.z = values.tolist()
    return message


def array(vector: Any) -> Array:
    """(3,) from x, y and z."""
    return np.array([vector.x, vector.y, vector.z])


def pose_of(message: Any) -> Pose | None:
    """The pose of a message; None if a number is not finite or the quaternion not a unit one."""
    position, q = array(message.position), message.orientation
    quaternion = np.array([q.w, q.x, q.y, q.z])
    norm = float(np.linalg.norm(quaternion))
    if not (np.all(np.isfinite(position)) and np.isfinite(norm) and abs(norm - 1.0) <= UNIT_NORM):
        return None
    return Pose(position, from_quaternion(quaternion / norm))


def pose_message(pose: Pose) -> PoseMessage:
    """The message of a pose."""
    w, x, y, z = to_quaternion(pose.rotation).tolist()
    return PoseMessage(position=filled(Point(), pose.position), orientation=Quaternion(w=w, x=x, y=y, z=z))


def twist_message(motion: PartMotion) -> Twist:
    """The velocities of a motion."""
    return Twist(linear=filled(Vector3(), motion.velocity), angular=filled(Vector3(), motion.angular_velocity))


def acceleration_message(motion: PartMotion) -> Accel:
    """The accelerations of a motion."""
    return Accel(linear=filled(Vector3(), motion.acceleration), angular=filled(Vector3(), motion.angular_acceleration))


def installs(package: str) -> str:
    """How a missing package of ROS is installed."""
    name = f"ros-{os.environ.get('ROS_DISTRO', 'jazzy')}-{package.replace('_', '-')}"
    return f"Where ROS 2 comes from apt: sudo apt install {name}. Else build {package} in a workspace and source that."


def serve(node: Node, services: ModuleType, name: str, callback: Callable[[Any, Any], Any]) -> None:
    """Create a service by the name of its type, such as GetEntityState, unless the installed package has none."""
    if (kind := getattr(services, name, None)) is not None:
        node.create_service(kind, f"~/{_WORDS.sub('_', name).lower()}", callback)
