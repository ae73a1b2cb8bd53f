"""The motion of named points and frames of a running simulation, with their Jacobians.

The module also finds the coordinates that give a free part a motion.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import numpy as np

from mbd_sim.base.geometry.pose import Array, Pose, identity_pose
from mbd_sim.base.geometry.rotation import rotation_vector, to_quaternion
from mbd_sim.mechanism.elements.parts import GROUND, Joint
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.spanning_tree import resolve_reference
from mbd_sim.simulation.kernel.memory import KernelMemory
from mbd_sim.simulation.model.live_values import LiveValues
from mbd_sim.simulation.model.model import Model
from mbd_sim.simulation.model.state_records import PartMotion

if TYPE_CHECKING:
    from mbd_sim.dynamics.kinematics.frames import FrameQuantity


def named_frame(mechanism: Mechanism, frame: str) -> tuple[str, Pose]:
    """The part, or ground, that `part` or `part.point` names, and the pose of the point in it.

    :raises InputError: there is no such part or point.
    """
    return resolve_reference(frame, points_of(mechanism))


def points_of(mechanism: Mechanism) -> dict[str, Mapping[str, Pose]]:
    """The points of the parts and of ground."""
    return {**{name: part.points for name, part in mechanism.parts.items()}, GROUND: mechanism.ground_points}


def motion_of(model: Model, mechanism: Mechanism, frame: str, time: float, y: Array, inputs: Array) -> PartMotion:
    """The motion of the frame `part` or `part.point` in ground's frame and axes.

    :param mechanism: that of the model, or a variant with the live values among the inputs.
    :raises InputError: there is no such part or point.
    """
    part, pose = named_frame(mechanism, frame)
    if part == GROUND:
        return PartMotion(pose, *np.zeros((4, 3)))
    return model.part_motions(time, y, inputs)[part].of(pose)


def free_joint_of(model: Model, part: str) -> Joint | None:
    """The joint that lets a part move in any direction; None if there is none."""
    joints = model.mechanism.joints.values()
    return next((one for one in joints if one.type == "free" and not one.drive and one.outboard == part), None)


def free_joint_values(
    model: Model, joint: Joint, motions: Mapping[str, PartMotion]
) -> tuple[dict[str, float], dict[str, float]]:
    """The positions and speeds, by the names of coordinates, of a free joint whose parts have the given motions."""
    frames = [
        _frame(motions, end, pose) for end, pose in ((joint.parent, joint.parent_pose), (joint.child, joint.child_pose))
    ]
    (inboard, v_F, w_F), (outboard, v_M, w_M) = frames
    offset = outboard.position - inboard.position
    relative = inboard.rotation.T @ outboard.rotation
    turn = rotation_vector(to_quaternion(relative))
    positions = np.concatenate([inboard.rotation.T @ offset, turn])
    linear = inboard.rotation.T @ (v_M - v_F - np.cross(w_F, offset))
    speeds = np.concatenate([linear, outboard.rotation.T @ (w_M - w_F)])
    names = model.coordinate_names[model.layout.u[joint.name]]
    return dict(zip(names, positions.tolist(), strict=True)), dict(zip(names, speeds.tolist(), strict=True))


def _frame(motions: Mapping[str, PartMotion], part: str, pose: Pose) -> tuple[Pose, Array, Array]:
    """The pose, velocity and angular velocity of a frame of a part, or of ground, in ground's frame."""
    if part == GROUND:
        return identity_pose() @ pose, np.zeros(3), np.zeros(3)
    motion = motions[part].of(pose)
    return motion.pose, motion.velocity, motion.angular_velocity


class MovingPoint:
    """A point of a part, or the center of mass, in the present state of a simulation.

    Everything is in ground's frame and axes, in SI units, and computed when it is read. A velocity is J u, plus the
    motion by drives. The place of a point in its part follows live values.
    """

    _components = 3

    def __init__(self, model: Model, memory: KernelMemory, live: LiveValues, name: str | None) -> None:
        """The point `part.point`, or the origin of a part or of ground; None: the center of mass.

        :param memory: of the simulation, with its `live` values.
        :raises InputError: there is no such part or point.
        """
        self._model, self._memory, self._live, self._name = model, memory, live, name
        self._local = np.zeros(3)
        self._part: str | None = None
        self._pose_in_part = identity_pose()
        self._place()
        self._readers: dict[str, Callable[[], Array]] = {}

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self._name or 'center of mass'})"

    @property
    def position(self) -> Array:
        """(3,) in m."""
        return self._read("position")

    @property
    def velocity(self) -> Array:
        """(3,) in m/s."""
        return self._read("velocity")

    @property
    def acceleration(self) -> Array:
        """(3,) in m/s², under all present forces: J u' + `bias_acceleration`."""
        return self._acceleration()[:3]

    @property
    def jacobian(self) -> Array:
        """J (3, nv): the velocity for each unit speed in u; of a frame (6, nv), with the angular velocity below."""
        return self._read("jacobian")

    @property
    def jacobian_rate(self) -> Array:
        """J', like J (3, nv) or (6, nv): the time derivative of J in the present motion."""
        return self._read("jacobian_rate")

    @property
    def bias_acceleration(self) -> Array:
        """(3,) in m/s²: the acceleration at u' = 0, which is J' u without drives; of a frame (6,), in rad/s² below."""
        return self._read("bias_acceleration")

    def _acceleration(self) -> Array:
        return self._read("jacobian") @ self._memory.accelerations() + self._read("bias_acceleration")

    def _read(self, quantity: str) -> Array:
        if self._values is not self._live.current:
            self._place()
        try:
            return self._readers[quantity]()
        except KeyError:
            self._readers[quantity] = self._bound(quantity)
            return self._readers[quantity]()

    def _place(self) -> None:
        """Find the part and the place of the point in it, with the present live values."""
        self._values = self._live.current
        if self._name is not None:
            self._part, self._pose_in_part = named_frame(self._live.mechanism, self._name)
            self._local[:] = self._pose_in_part.position

    def _bound(self, quantity: str) -> Callable[[], Array]:
        nv, rows = self._model.layout.nv, slice(self._components)
        height = 3 if self._part is None else 6
        readings: dict[str, tuple[FrameQuantity, tuple[int, ...], slice]] = {
            "position": ("pose", (-1,), slice(3)),
            "axes": ("pose", (-1, 3), slice(1, 4)),  # in rows
            "velocity": ("velocity", (height,), slice(3)),
            "angular_velocity": ("velocity", (height,), slice(3, 6)),
            "jacobian": ("jacobian", (height, nv), rows),
            "jacobian_rate": ("jacobian_rate", (height, nv), rows),
            "bias_acceleration": ("bias_acceleration", (height,), rows),
        }
        function, shape, rows = readings[quantity]
        if self._part == GROUND:
            return self._at_rest(quantity)
        memory = self._memory
        compiled = self._model.on_request.frame(self._part, function)
        return compiled.bound(memory.clock, (memory.y, memory.inputs, self._local), shape, rows)

    def _at_rest(self, quantity: str) -> Callable[[], Array]:
        """A quantity of a point of ground."""
        if quantity == "position":
            return self._local.copy
        if quantity == "axes":
            return lambda: np.eye(3)
        shape = {"velocity": (3,), "angular_velocity": (3,), "bias_acceleration": (self._components,)}
        return lambda: np.zeros(shape.get(quantity, (self._components, self._model.layout.nv)))


class MovingFrame(MovingPoint):
    """A frame of a part in the present state of a simulation: a point with axes.

    Everything is in ground's frame and axes, in SI units, and computed when it is read. In the Jacobian and where there
    are six components, those of the velocity of the origin come first, then those of the angular velocity.
    """

    _components = 6

    @property
    def rotation(self) -> Array:
        """(3, 3): its columns are the axes of the frame."""
        return np.asarray(self._read("axes").T @ self._pose_in_part.rotation)

    @property
    def pose(self) -> Pose:
        """Position and rotation."""
        return Pose(self.position, self.rotation)

    @property
    def angular_velocity(self) -> Array:
        """(3,) in rad/s."""
        return self._read("angular_velocity")

    @property
    def angular_acceleration(self) -> Array:
        """(3,) in rad/s², under all present forces."""
        return self._acceleration()[3:]
