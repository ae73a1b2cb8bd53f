"""The services of `simulation_interfaces` about entities, which are the parts of the mechanism."""

from __future__ import annotations

from collections.abc import Mapping
from types import ModuleType
from typing import Any

import numpy as np
from geometry_msgs.msg import Accel, Point, Quaternion, Twist, Vector3
from geometry_msgs.msg import Pose as PoseMessage
from rclpy.node import Node
from rclpy.time import Time
from std_msgs.msg import Header

from mbd_sim.errors import nearest, quoted
from mbd_sim.geometry.pose import Array, Pose
from mbd_sim.geometry.rotation import from_quaternion, to_quaternion
from mbd_sim.mechanism.records import GROUND
from mbd_sim.ros.stepping_thread import SteppingThread
from mbd_sim.simulation.motions import PartMotion
from mbd_sim.simulation.part_motion import free_joint_of, free_joint_values
from mbd_sim.simulation.state_values import StateValues

UNIT = 1e-3  # by how much the norm of a given quaternion may differ from 1
FLAGS = ("set_pose", "set_twist")  # of a request; simulation_interfaces 1 has none, and sets both


class EntityServices:
    """Reads the motion of any part, and sets that of parts which move freely."""

    def __init__(
        self, node: Node, stepping_thread: SteppingThread, messages: ModuleType, services: ModuleType, frame_prefix: str
    ) -> None:
        self._stepping_thread, self._model = stepping_thread, stepping_thread.simulation.model
        self._result, self._ground = messages.Result, frame_prefix + GROUND
        self._invalid_pose = getattr(
            services.SetEntityState.Response, "INVALID_POSE", messages.Result.RESULT_OPERATION_FAILED
        )
        node.create_service(services.GetEntityState, "~/get_entity_state", self._on_get)
        node.create_service(services.SetEntityState, "~/set_entity_state", self._on_set)

    def _on_get(self, request: Any, response: Any) -> Any:
        if problem := self._unknown(request.entity):
            return self._fail(response, self._result.RESULT_NOT_FOUND, problem)
        self._prepare()
        found = list[tuple[int, Mapping[str, PartMotion]]]()

        def read() -> str:
            found.append((self._stepping_thread.clock.ns, self._now()))
            return ""

        if problem := self._stepping_thread.between_steps(read):
            return self._fail(response, self._result.RESULT_OPERATION_FAILED, problem)
        time_ns, motion = found[0][0], found[0][1][request.entity]
        state, (w, x, y, z) = response.state, to_quaternion(motion.pose.rotation).tolist()
        state.header = Header(stamp=Time(nanoseconds=time_ns).to_msg(), frame_id=self._ground)
        state.pose = PoseMessage(
            position=_filled(Point(), motion.pose.position), orientation=Quaternion(w=w, x=x, y=y, z=z)
        )
        state.twist = Twist(linear=_vector(motion.velocity), angular=_vector(motion.angular_velocity))
        state.acceleration = Accel(linear=_vector(motion.acceleration), angular=_vector(motion.angular_acceleration))
        response.result.result = self._result.RESULT_OK
        return response

    def _on_set(self, request: Any, response: Any) -> Any:
        part, state, result = request.entity, request.state, self._result
        if problem := self._unknown(part):
            return self._fail(response, result.RESULT_NOT_FOUND, problem)
        joint = free_joint_of(self._model, part)
        if joint is None:
            text = f"part '{part}' does not move freely: its joints determine its pose. Set them on ~/set_state."
            return self._fail(response, result.RESULT_OPERATION_FAILED, text)
        if state.header.frame_id not in ("", GROUND, self._ground):
            text = f"the frame {quoted(state.header.frame_id)} is not known. Use '{self._ground}', or leave it empty."
            return self._fail(response, result.RESULT_OPERATION_FAILED, text)
        sets_pose, sets_twist = (getattr(request, flag, True) for flag in FLAGS)
        if not (sets_pose or sets_twist):
            text = "it sets neither pose nor twist; an acceleration follows from the forces"
            return self._fail(response, result.RESULT_FEATURE_UNSUPPORTED, text)
        pose = _pose(state.pose)
        velocity, angular_velocity = _array(state.twist.linear), _array(state.twist.angular)
        if sets_pose and pose is None:
            text = "the pose is not valid. Give finite numbers, and a quaternion of norm 1."
            return self._fail(response, self._invalid_pose, text)
        if sets_twist and not np.all(np.isfinite([velocity, angular_velocity])):
            return self._fail(response, result.RESULT_OPERATION_FAILED, "the twist is not finite. Give finite numbers.")
        self._prepare()

        def values() -> StateValues:
            now = self._now()
            motion = now[part]
            if sets_pose and pose is not None:
                motion = motion._replace(pose=pose)
            if sets_twist:
                motion = motion._replace(velocity=velocity, angular_velocity=angular_velocity)
            return StateValues(*free_joint_values(self._model, joint, {**now, part: motion}))

        if problem := self._stepping_thread.set_state(values):
            return self._fail(response, result.RESULT_OPERATION_FAILED, problem)
        response.result.result = result.RESULT_OK
        return response

    def _prepare(self) -> None:
        """Compile what computes the motions, at the first request and outside the stepping thread."""
        self._model.part_motions(0.0, self._model.start, self._model.inputs)

    def _now(self) -> Mapping[str, PartMotion]:
        """The motions of all parts, for the stepping thread."""
        simulation = self._stepping_thread.simulation
        return self._model.part_motions(simulation.time, simulation.y, simulation.inputs)

    def _unknown(self, part: str) -> str:
        if part in self._model.part_names:
            return ""
        return f"there is no part {quoted(part)}. {nearest(part, self._model.part_names)}".strip()

    def _fail(self, response: Any, code: int, text: str) -> Any:
        response.result.result, response.result.error_message = code, text
        return response


def _vector(values: Array) -> Vector3:
    return _filled(Vector3(), values)


def _filled(message: Any, values: Array) -> Any:
    message.x, message.y, message.z = values.tolist()
    return message


def _array(vector: Any) -> Array:
    return np.array([vector.x, vector.y, vector.z])


def _pose(message: Any) -> Pose | None:
    """The pose of a message; None if a number is not finite or the quaternion not a unit one."""
    position, q = _array(message.position), message.orientation
    quaternion = np.array([q.w, q.x, q.y, q.z])
    norm = float(np.linalg.norm(quaternion))
    if not (np.all(np.isfinite(position)) and np.isfinite(norm) and abs(norm - 1.0) <= UNIT):
        return None
    return Pose(position, from_quaternion(quaternion / norm))
