"""The motion of points and frames of a running simulation, with their Jacobians."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from mbd_sim.geometry.pose import Array, Pose, identity_pose
from mbd_sim.mechanism.records import GROUND
from mbd_sim.simulation.compiled_model import Model
from mbd_sim.simulation.kernel_memory import KernelMemory
from mbd_sim.simulation.live_values import LiveValues
from mbd_sim.simulation.part_motion import named_frame

if TYPE_CHECKING:
    from mbd_sim.dynamics.frame_functions import FrameQuantity


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
