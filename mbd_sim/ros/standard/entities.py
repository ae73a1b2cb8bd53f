"""The entities of `simulation_interfaces`: the parts of the mechanism, their motion, kind and size.

Entities are selected by names, by kinds, and by what they overlap; parts have no tags. Named poses are the points of
ground.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import ModuleType
from typing import Any

import numpy as np
from geometry_msgs.msg import Vector3
from rclpy.node import Node
from rclpy.time import Time
from std_msgs.msg import Header

from mbd_sim.base.errors import InputError, nearest, quoted
from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.mechanism.elements.parts import GROUND
from mbd_sim.mechanism.touching import first_of, welded
from mbd_sim.pictures.shapes.extent import bounding_points
from mbd_sim.ros.standard.filters import EntityBox, UnsupportedError, name_filter, overlap_filter, tags_allow
from mbd_sim.ros.standard.messages import (
    acceleration_message,
    array,
    fail,
    filled,
    pose_message,
    pose_of,
    serve,
    twist_message,
)
from mbd_sim.ros.stepping.thread import SteppingThread
from mbd_sim.simulation.model.state_records import PartMotion
from mbd_sim.simulation.run.changes import StateValues
from mbd_sim.simulation.run.moving_points import free_joint_of, free_joint_values

FLAGS = ("set_pose", "set_twist")  # of a request; simulation_interfaces 1 has none, and sets both


class EntityServices:
    """Tells of the parts and their motions, and sets the motion of those which move freely."""

    def __init__(
        self, node: Node, stepping_thread: SteppingThread, messages: ModuleType, services: ModuleType, frame_prefix: str
    ) -> None:
        self._stepping_thread, self._model = stepping_thread, stepping_thread.simulation.model
        self._messages, self._result, self._ground = messages, messages.Result, frame_prefix + GROUND
        self._invalid_pose = getattr(
            services.SetEntityState.Response, "INVALID_POSE", messages.Result.RESULT_OPERATION_FAILED
        )
        groups = welded(self._model.mechanism.all_joints.values())
        self._resting = {part for part in self._model.part_names if first_of(groups, part) == GROUND}
        for name, callback in (
            ("GetEntityState", self._on_get),
            ("SetEntityState", self._on_set),
            ("GetEntities", self._on_list),
            ("GetEntitiesStates", self._on_list_states),
            ("GetEntityInfo", self._on_info),
            ("GetEntityBounds", self._on_bounds),
            ("GetNamedPoses", self._on_named_poses),
        ):
            serve(node, services, name, callback)

    def _on_list(self, request: Any, response: Any) -> Any:
        code, problem, found = self._selected(request.filters)
        if problem:
            return fail(response, code, problem)
        response.entities, response.result.result = found, self._result.RESULT_OK
        return response

    def _on_list_states(self, request: Any, response: Any) -> Any:
        code, problem, found = self._selected(request.filters)
        if not problem:
            code = self._result.RESULT_OPERATION_FAILED
            problem, response.states = self._states(found)
        if problem:
            return fail(response, code, problem)
        response.entities, response.result.result = found, self._result.RESULT_OK
        return response

    def _selected(self, filters: Any) -> tuple[int, str, list[str]]:
        """A code with a problem, or else the parts that pass."""
        try:
            fits, overlaps = name_filter(filters.filter), overlap_filter(filters.bounds, self._messages)
        except UnsupportedError as error:
            return self._result.RESULT_FEATURE_UNSUPPORTED, str(error), []
        except InputError as error:
            return self._result.RESULT_OPERATION_FAILED, str(error), []
        kinds = {one.category for one in filters.categories}
        names = [
            name
            for name in self._model.mechanism.parts
            if tags_allow(filters.tags) and fits(name) and (not kinds or self._category(name) in kinds)
        ]
        if overlaps is None:
            return 0, "", names
        problem, motions = self._motions()
        if problem:
            return self._result.RESULT_OPERATION_FAILED, problem, []
        return 0, "", [name for name in names if overlaps(self._box(name, motions[name].pose))]

    def _category(self, part: str) -> int:
        kinds = self._messages.EntityCategory
        wanted = "STATIC" if part in self._resting else "DYNAMIC"
        return int(getattr(kinds, f"CATEGORY_{wanted}_OBJECT", kinds.CATEGORY_OBJECT))

    def _corners(self, part: str) -> tuple[Array, Array] | None:
        """The least and the greatest coordinates (3,) of a part in its frame; None if it has no shape."""
        mechanism = self._model.mechanism
        points = bounding_points(mechanism.parts[part], mechanism.source.file)
        return (points.min(axis=0), points.max(axis=0)) if len(points) else None

    def _box(self, part: str, pose: Pose) -> EntityBox:
        """The box of a part where it is now; its origin where it has no shape."""
        lower, upper = self._corners(part) or (np.zeros(3), np.zeros(3))
        middle = pose.position + pose.rotation @ (0.5 * (lower + upper))
        return EntityBox(Pose(middle, pose.rotation), 0.5 * (upper - lower))

    def _on_info(self, request: Any, response: Any) -> Any:
        if problem := self._unknown(request.entity):
            return fail(response, self._result.RESULT_NOT_FOUND, problem)
        part = self._model.mechanism.parts[request.entity]
        response.info.category.category = self._category(part.name)
        response.info.description = f"part of {self._model.mechanism.name}, {part.mass:.6g} kg"
        response.result.result = self._result.RESULT_OK
        return response

    def _on_bounds(self, request: Any, response: Any) -> Any:
        if problem := self._unknown(request.entity):
            return fail(response, self._result.RESULT_NOT_FOUND, problem)
        if (corners := self._corners(request.entity)) is not None:
            response.bounds.type = self._messages.Bounds.TYPE_BOX
            response.bounds.points = [filled(Vector3(), corner) for corner in reversed(corners)]
        response.result.result = self._result.RESULT_OK
        return response

    def _on_named_poses(self, request: Any, response: Any) -> Any:
        if tags_allow(request.tags):
            response.poses = [
                self._messages.NamedPose(name=name, description="point of ground", pose=pose_message(pose))
                for name, pose in self._model.mechanism.ground_points.items()
            ]
        response.result.result = self._result.RESULT_OK
        return response

    def _on_get(self, request: Any, response: Any) -> Any:
        if problem := self._unknown(request.entity):
            return fail(response, self._result.RESULT_NOT_FOUND, problem)
        problem, found = self._states([request.entity])
        if problem:
            return fail(response, self._result.RESULT_OPERATION_FAILED, problem)
        response.state, response.result.result = found[0], self._result.RESULT_OK
        return response

    def _motions(self) -> tuple[str, Mapping[str, PartMotion]]:
        """A problem, or else the motions of all parts at the same instant."""
        problem, _, motions = self._instant()
        return problem, motions

    def _instant(self) -> tuple[str, int, Mapping[str, PartMotion]]:
        self._prepare()
        read = list[tuple[int, Mapping[str, PartMotion]]]()

        def look() -> str:
            read.append((self._stepping_thread.clock.ns, self._now()))
            return ""

        problem = self._stepping_thread.between_steps(look)
        return (problem, 0, {}) if problem else ("", *read[0])

    def _states(self, parts: Sequence[str]) -> tuple[str, list[Any]]:
        """A problem, or else the states of parts at the same instant."""
        problem, time_ns, motions = self._instant()
        if problem:
            return problem, []
        header = Header(stamp=Time(nanoseconds=time_ns).to_msg(), frame_id=self._ground)
        return "", [
            self._messages.EntityState(
                header=header,
                pose=pose_message(motions[part].pose),
                twist=twist_message(motions[part]),
                acceleration=acceleration_message(motions[part]),
            )
            for part in parts
        ]

    def _on_set(self, request: Any, response: Any) -> Any:
        part, state, result = request.entity, request.state, self._result
        if problem := self._unknown(part):
            return fail(response, result.RESULT_NOT_FOUND, problem)
        joint = free_joint_of(self._model, part)
        if joint is None:
            text = f"part '{part}' does not move freely: its joints determine its pose. Set them on ~/set_state."
            return fail(response, result.RESULT_OPERATION_FAILED, text)
        if state.header.frame_id not in ("", GROUND, self._ground):
            text = f"the frame {quoted(state.header.frame_id)} is not known. Use '{self._ground}', or leave it empty."
            return fail(response, result.RESULT_OPERATION_FAILED, text)
        sets_pose, sets_twist = (getattr(request, flag, True) for flag in FLAGS)
        if not (sets_pose or sets_twist):
            text = "it sets neither pose nor twist; an acceleration follows from the forces"
            return fail(response, result.RESULT_FEATURE_UNSUPPORTED, text)
        pose = pose_of(state.pose)
        velocity, angular_velocity = array(state.twist.linear), array(state.twist.angular)
        if sets_pose and pose is None:
            text = "the pose is not valid. Give finite numbers, and a quaternion of norm 1."
            return fail(response, self._invalid_pose, text)
        if sets_twist and not np.all(np.isfinite([velocity, angular_velocity])):
            return fail(response, result.RESULT_OPERATION_FAILED, "the twist is not finite. Give finite numbers.")
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
            return fail(response, result.RESULT_OPERATION_FAILED, problem)
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
