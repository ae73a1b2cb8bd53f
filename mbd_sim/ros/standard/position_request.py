"""What a request to `~/compute_ik` asks for, or why it is refused."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from mbd_sim.base.errors import InputError, listed, nearest, quoted
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.geometry.rotation import from_quaternion, rotation_vector
from mbd_sim.mechanism.elements.parts import GROUND
from mbd_sim.mechanism.spanning_tree import split_reference
from mbd_sim.ros.commands.wrenches import GROUND_FRAMES
from mbd_sim.ros.standard.messages import UNIT_NORM, array
from mbd_sim.ros.standard.position_orders import PositionSearch
from mbd_sim.simulation.model.model import Model
from mbd_sim.simulation.run.run_point import joint_state_names

TIME, MOST_TIME = 5.0, 60.0  # s of a search: without a timeout, and at most


class RefusedError(InputError):
    """A request that is not searched for, with the name of its error code."""

    def __init__(self, code: str, message: str, remedy: str) -> None:
        super().__init__(message, remedy)
        self.code = code


@dataclass(frozen=True, eq=False)
class PresentPositions:
    """The state in which a request arrived: the positions of all joints by name, and q (nq,)."""

    stamp_ns: int
    time: float
    positions: Mapping[str, float]
    q: Array


class RequestReader:
    """Turns requests into searches, or refuses them as a whole."""

    def __init__(self, model: Model, prefix: str, *, position_only: bool) -> None:
        self._model, self._mechanism, self._prefix = model, model.mechanism, prefix
        self._position_only = position_only

    def search(self, request: Any, present: PresentPositions) -> PositionSearch:
        """The search for a `PositionIKRequest`.

        :raises RefusedError: it cannot be done.
        """
        self._require_supported(request)
        link, target = request.ik_link_name, request.pose_stamped
        if request.pose_stamped_vector:
            target = request.pose_stamped_vector[0]
            link = request.ik_link_names[0] if request.ik_link_names else link
        frame = self._frame(link)
        relative_to = self._reference(target.header.frame_id)
        position, rotation = self._target(target.pose)
        limit = 1e-9 * (request.timeout.sec * 1_000_000_000 + request.timeout.nanosec)
        if limit < 0.0:
            raise RefusedError("FAILURE", f"the timeout of {limit:g} s is negative", "Give 0 or more.")
        seed = {**self._joint_seed(request.robot_state), **self._multi_dof_seed(request.robot_state)}
        limit = min(limit or TIME, MOST_TIME)
        return PositionSearch(frame, position, rotation, relative_to, present.q, seed, present.time, limit)

    def _require_supported(self, request: Any) -> None:
        """Refuse what this service does not do, rather than leave it out."""
        if request.group_name:
            what = f"there is no group {quoted(request.group_name)}: all joints move"
            raise RefusedError("INVALID_GROUP_NAME", what, "Leave group_name empty.")
        if request.avoid_collisions:
            what = "collisions cannot be avoided"
            raise RefusedError("COLLISION_CHECKING_UNAVAILABLE", what, "Set avoid_collisions to false.")
        kinds = ("joint", "position", "orientation", "visibility")
        if given := [kind for kind in kinds if getattr(request.constraints, f"{kind}_constraints")]:
            what = f"{given[0]} constraints are not supported: joints keep within their limits"
            raise RefusedError("INVALID_GOAL_CONSTRAINTS", what, "Leave the constraints empty.")
        if len(request.pose_stamped_vector) > 1 or len(request.ik_link_names) > 1:
            what = "only one link can be given a pose"
            raise RefusedError("INVALID_GOAL_CONSTRAINTS", what, "Give ik_link_name and pose_stamped.")
        if request.ik_link_names and not request.pose_stamped_vector:
            what = "ik_link_names needs pose_stamped_vector"
            raise RefusedError("INVALID_GOAL_CONSTRAINTS", what, "Give ik_link_name and pose_stamped.")

    def _frame(self, link: str) -> str:
        """The part or the point `part.point` that a link names, with the prefix of frames or without."""
        name = link.removeprefix(self._prefix)
        known = {one.name: one.points for one in self._mechanism.parts.values()}
        try:
            split_reference(name, known)
        except InputError as error:
            valid = [text for part, points in known.items() for text in (part, *(f"{part}.{p}" for p in points))]
            what = f"there is no part or point {quoted(link)}" if link else "there is no ik_link_name"
            raise RefusedError("INVALID_LINK_NAME", what, nearest(name, valid)) from error
        return name

    def _reference(self, frame_id: str) -> str | None:
        """The part in whose frame the target is given; None for ground."""
        name, parts = frame_id.removeprefix(self._prefix), self._mechanism.parts
        if frame_id in GROUND_FRAMES or name in GROUND_FRAMES:
            return None
        if name not in parts:
            what = f"there is no frame {quoted(frame_id)}"
            raise RefusedError("FRAME_TRANSFORM_FAILURE", what, nearest(name, (GROUND, *parts)))
        return name

    def _target(self, pose: Any) -> tuple[Array, Array | None]:
        position = array(pose.position)
        if not np.all(np.isfinite(position)):
            what = "the position of the pose is not finite"
            raise RefusedError("INVALID_GOAL_CONSTRAINTS", what, "Give finite numbers.")
        if self._position_only:
            return position, None
        quaternion = _unit(pose.orientation, "INVALID_GOAL_CONSTRAINTS", "the orientation of the pose")
        return position, from_quaternion(quaternion)

    def _joint_seed(self, robot_state: Any) -> dict[str, float]:
        state = robot_state.joint_state
        names, positions = list(state.name), list(state.position)
        if positions and len(names) != len(positions):
            what = f"'name' and 'position' of the joint state differ in length: {len(names)} and {len(positions)}"
            raise RefusedError("INVALID_ROBOT_STATE", what, "Give one position for each name.")
        if len(set(names)) < len(names):
            raise RefusedError("INVALID_ROBOT_STATE", "the joint state names a joint twice", "Name each once.")
        known = joint_state_names(self._model)
        for name in names:
            if name not in known:
                raise RefusedError("INVALID_ROBOT_STATE", f"there is no joint {quoted(name)}", nearest(name, known))
        given = dict(zip(names, map(float, positions), strict=False))
        if bad := [name for name, value in given.items() if not np.isfinite(value)]:
            raise RefusedError("INVALID_ROBOT_STATE", f"the position of {listed(bad)} is not finite", "Give numbers.")
        return given

    def _multi_dof_seed(self, robot_state: Any) -> dict[str, float]:
        """Of free and spherical joints, the position and the rotation vector by the names of coordinates."""
        state, given = robot_state.multi_dof_joint_state, dict[str, float]()
        if len(state.joint_names) != len(state.transforms):
            counts = f"{len(state.joint_names)} and {len(state.transforms)}"
            what = f"'joint_names' and 'transforms' of the multi-DOF state differ in length: {counts}"
            raise RefusedError("INVALID_ROBOT_STATE", what, "Give one transform for each name.")
        turning = {
            one.name: one
            for one in self._mechanism.joints.values()
            if one.kind.quaternion is not None and not one.drive
        }
        for name, transform in zip(state.joint_names, state.transforms, strict=True):
            if name not in turning:
                what = f"there is no free or spherical joint {quoted(name)}"
                raise RefusedError("INVALID_ROBOT_STATE", what, nearest(name, turning))
            place = array(transform.translation)
            if not np.all(np.isfinite(place)):
                raise RefusedError("INVALID_ROBOT_STATE", f"the transform of '{name}' is not finite", "Give numbers.")
            turned = rotation_vector(_unit(transform.rotation, "INVALID_ROBOT_STATE", f"the rotation of '{name}'"))
            values = [*place[: turning[name].kind.quaternion], *turned]
            given |= zip(turning[name].motion_names, map(float, values), strict=True)
        return given


def _unit(message: Any, code: str, what: str) -> Array:
    """The unit quaternion (w, x, y, z) of a message.

    :raises RefusedError: it is none.
    """
    quaternion = np.array([message.w, message.x, message.y, message.z])
    norm = float(np.linalg.norm(quaternion))
    if not abs(norm - 1.0) <= UNIT_NORM:
        raise RefusedError(code, f"{what} is not a unit quaternion: its norm is {norm:.4g}", "Give one of norm 1.")
    return quaternion / norm
