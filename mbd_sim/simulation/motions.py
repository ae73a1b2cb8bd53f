"""Velocities and accelerations of the parts, and of points and frames that are fixed in them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from mbd_sim.geometry.pose import Array, Pose

if TYPE_CHECKING:
    from mbd_sim.compiler.bound_call import Call, Clock
    from mbd_sim.dynamics.equations import Equations


class PartMotion(NamedTuple):
    """The motion of a frame in ground's frame and axes: pose, velocity of the origin, angular velocity, their rates.

    Each is (3,), in m/s, rad/s, m/s² and rad/s².
    """

    pose: Pose
    velocity: Array
    angular_velocity: Array
    acceleration: Array
    angular_acceleration: Array

    def of(self, frame: Pose) -> PartMotion:
        """The motion of a frame that is fixed in this one."""
        arm = self.pose.rotation @ frame.position
        turning = np.cross(self.angular_velocity, arm)
        return PartMotion(
            self.pose @ frame,
            self.velocity + turning,
            self.angular_velocity,
            self.acceleration + np.cross(self.angular_acceleration, arm) + np.cross(self.angular_velocity, turning),
            self.angular_acceleration,
        )


class MotionReaders:
    """Accelerations of the coordinates and motions of the parts, under inputs that contain the contact forces."""

    def __init__(self, equations: Equations) -> None:
        """Compile the functions; this takes as long as for the kernel of the mechanism."""
        from mbd_sim.compiler.readers import CompiledReaders

        functions = {name: getattr(equations.measurements, name) for name in ("accelerations", "part_motions")}
        self._readers, self._part_names = CompiledReaders(functions), equations.part_names

    def accelerations(self, time: float, y: Array, inputs: Array) -> Array:
        """The accelerations of the coordinates, then of the driven ones."""
        return self._readers.read("accelerations", time, y, inputs)

    def bound_accelerations(self, clock: Clock, y: Array, inputs: Array, count: int) -> Call:
        """The first ones of arrays that stay where they are, as a callable: see `CompiledFunction.bound`."""
        return self._readers.bound_to("accelerations", clock, (y, inputs), slice(count))

    def rows(self, time: float, y: Array, inputs: Array) -> Array:
        """(parts, 4, 3): velocity, angular velocity and their rates."""
        return self._readers.read("part_motions", time, y, inputs).reshape(-1, 4, 3)

    def parts(self, time: float, y: Array, inputs: Array, poses: Mapping[str, Pose]) -> dict[str, PartMotion]:
        """The motion of each part, with its pose."""
        return {
            name: PartMotion(poses[name], *(vector.copy() for vector in row))
            for name, row in zip(self._part_names, self.rows(time, y, inputs), strict=True)
        }
