"""The motion of points of parts in given states."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbd_sim.dynamics.evaluation import evaluated
from mbd_sim.dynamics.frame_functions import FrameQuantity, frame_function
from mbd_sim.geometry.pose import Array, Pose
from mbd_sim.kinematic_analysis.kinematic_system import KinematicSystem
from mbd_sim.mechanism.records import GROUND
from mbd_sim.short_repr import short_repr
from mbd_sim.simulation.part_motion import named_frame


@dataclass(frozen=True, eq=False)
class PointMotion:
    """`position`, `velocity` and `acceleration` (n, 3) of a point in ground's axes, in m and s."""

    position: Array
    velocity: Array
    acceleration: Array

    __repr__ = short_repr


class PointFunctions:
    """The kinematics of a point, or of a frame, of a part."""

    def __init__(self, system: KinematicSystem, name: str) -> None:
        """A point `part.point`, or the origin of a part.

        :raises InputError: there is no such point.
        """
        self._system = system
        self._part, pose = named_frame(system.mechanism, name)
        self._local = pose.position
        self._functions = {
            quantity: frame_function(system.traced, self._part, quantity)
            for quantity in (_QUANTITIES if self._part != GROUND else ())
        }
        self._inputs = np.zeros(system.traced.input_layout.size)
        self._inputs[system.traced.input_layout.values] = system.values
        self._rest = np.zeros(system.traced.y.shape[0] - system.layout.nq - system.layout.nv)

    def motion(self, q: Array, u: Array, u_rates: Array) -> PointMotion:
        """The motion in n states, with (n, nq) and (n, nv) numbers."""
        rows = [self.state(*row) for row in zip(q, u, u_rates, strict=True)]
        return PointMotion(*(np.array([row[index] for row in rows]) for index in range(3)))

    def state(self, q: Array, u: Array, u_rates: Array) -> tuple[Array, Array, Array]:
        """Position, velocity and acceleration (3,) in a state."""
        if self._part == GROUND:
            return self._local, np.zeros(3), np.zeros(3)
        velocity, acceleration = self.twist(q, u, u_rates)
        return self._value("pose", q, u)[:3], velocity[:3], acceleration[:3]

    def twist(self, q: Array, u: Array, u_rates: Array) -> tuple[Array, Array]:
        """Velocity and angular velocity (6,) in a state, and their rates (6,)."""
        if self._part == GROUND:
            return np.zeros(6), np.zeros(6)
        jacobian = self.jacobian(q)
        return jacobian @ u, jacobian @ u_rates + self._value("bias_acceleration", q, u)

    def jacobian(self, q: Array) -> Array:
        """(6, nv): the velocity and the angular velocity for each unit speed."""
        nv = self._system.layout.nv
        if self._part == GROUND:
            return np.zeros((6, nv))
        return self._value("jacobian", q, np.zeros(nv)).reshape(6, nv)

    def pose(self, q: Array) -> Pose:
        """The position of the point and the rotation of its part."""
        if self._part == GROUND:
            return Pose(self._local, np.eye(3))
        values = self._value("pose", q, np.zeros(self._system.layout.nv))
        return Pose(values[:3], values[3:].reshape(3, 3, order="F"))

    def _value(self, quantity: FrameQuantity, q: Array, u: Array) -> Array:
        y = np.concatenate([q, u, self._rest])
        # Rows and columns: the functions give a column of numbers, matrices row by row.
        return evaluated(self._functions[quantity], 0.0, y, self._inputs, self._local).ravel(order="F")


_QUANTITIES: tuple[FrameQuantity, ...] = ("pose", "jacobian", "bias_acceleration")
