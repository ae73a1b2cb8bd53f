"""What can be computed from a state, as plain records, such as energies, reactions and the motion of parts."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.base.short_repr import short_repr


class Energies(NamedTuple):
    """The energy audit, all in J; `total` is kinetic + potential.

    `residual = total - total at the start - work_applied - work_drives + dissipated` measures the error of the
    integration: it is zero for an exact solution. `potential`, `total` and `residual` are nan where the potential of a
    spring is not computed: see `DistantPotential`.
    """

    kinetic: float
    potential: float
    dissipated: float
    work_applied: float
    work_drives: float
    total: float
    residual: float

    def __repr__(self) -> str:
        return short_repr(self)


class Losses(NamedTuple):
    """Parts of the dissipated energy in J: that of impacts, and that of friction that sticks and slides."""

    impact: float
    friction: float

    def __repr__(self) -> str:
        return short_repr(self)


class Violation(NamedTuple):
    """The largest violation of the constraints: in position (m or 1) and in velocity (m/s or 1/s)."""

    position: float
    velocity: float

    def __repr__(self) -> str:
        return short_repr(self)


class DriveState(NamedTuple):
    """A driven coordinate in m or rad, its velocity, and the force or moment in N or N·m that its drive exerts."""

    position: float
    velocity: float
    force: float

    def __repr__(self) -> str:
        return short_repr(self)


class Reaction(NamedTuple):
    """The load that a joint transmits: `force` (3,) in N and `moment` (3,) in N·m on its child, in ground's axes.

    The moment is about the joint's point on the child. Springs, efforts and drives of the joint are included, and so
    is the load of a gear, rack or coupling: it acts on the coordinates of the joints as a couple or a force between
    the parts of each joint, and puts no additional load on the bearings. Redundant joints share the load as described
    in `LoadSharing`.
    """

    force: Array
    moment: Array

    def __repr__(self) -> str:
        return short_repr(self)


class EnsembleEnergies(NamedTuple):
    """The energy audit with an array (k,) for each entry, in J: see `Energies`."""

    kinetic: Array
    potential: Array
    dissipated: Array
    work_applied: Array
    work_drives: Array
    total: Array
    residual: Array

    def __repr__(self) -> str:
        return short_repr(self)


class EnsembleMotion(NamedTuple):
    """The motion of a frame in each member, in ground's axes: see `PartMotion`.

    All are (k, 3), in m, m/s, rad/s, m/s² and rad/s², but the `rotation` matrices (k, 3, 3).
    """

    position: Array
    rotation: Array
    velocity: Array
    angular_velocity: Array
    acceleration: Array
    angular_acceleration: Array


class EnsembleDrive(NamedTuple):
    """A driven coordinate (k,) in m or rad, its velocity, and the force of its drive in N or N·m: see `DriveState`."""

    position: Array
    velocity: Array
    force: Array


class PartMotion(NamedTuple):
    """The motion of a frame in ground's frame and axes: pose, velocity of the origin, angular velocity, their rates.

    Each is (3,), in m/s, rad/s, m/s² and rad/s².
    """

    pose: Pose
    velocity: Array
    angular_velocity: Array
    acceleration: Array
    angular_acceleration: Array

    def __repr__(self) -> str:
        return short_repr(self)

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
