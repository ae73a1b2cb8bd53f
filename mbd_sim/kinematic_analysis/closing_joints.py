"""The coordinates of joints that close loops, from the frames on both sides: they are not among q."""

from __future__ import annotations

import numpy as np

from mbd_sim.errors import InputError
from mbd_sim.geometry.pose import Array
from mbd_sim.kinematic_analysis.kinematic_system import KinematicSystem
from mbd_sim.kinematic_analysis.point_motion import PointFunctions
from mbd_sim.mechanism.records import Joint, Mechanism


def closing_names(mechanism: Mechanism) -> tuple[str, ...]:
    """The revolute and prismatic joints that close loops."""
    return tuple(name for name, joint in mechanism.closing.items() if joint.type in ("revolute", "prismatic"))


class ClosingJoint:
    """The angle, or the displacement, of a revolute or prismatic joint that closes a loop."""

    def __init__(self, system: KinematicSystem, joint: Joint) -> None:
        """Trace the motion of both parts.

        :raises InputError: it is another type of joint.
        """
        if joint.type not in ("revolute", "prismatic"):
            raise InputError(
                f"'{joint.name}' closes a loop, and so has no coordinates", "Write 'cut: true' at another joint of it."
            )
        self._joint = joint
        self._parent, self._child = PointFunctions(system, joint.parent), PointFunctions(system, joint.child)

    def position(self, q: Array) -> float:
        """In rad, from -pi to pi, or in m."""
        joint = self._joint
        parent, child = self._parent.pose(q) @ joint.parent_pose, self._child.pose(q) @ joint.child_pose
        if joint.type == "prismatic":
            return float(parent.rotation @ joint.axis @ (child.position - parent.position))
        turn = parent.rotation.T @ child.rotation
        sine = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
        return float(np.arctan2(sine @ joint.axis, np.trace(turn) - 1.0))

    def rates(self, q: Array, u: Array, u_rates: Array) -> tuple[float, float]:
        """Its velocity and acceleration, in rad/s or m/s and so on."""
        joint = self._joint
        one, other = self._parent.twist(q, u, u_rates), self._child.twist(q, u, u_rates)
        pose, far = self._parent.pose(q), self._child.pose(q)
        axis = pose.rotation @ joint.parent_pose.rotation @ joint.axis
        if joint.type == "revolute":
            return float(axis @ (other[0][3:] - one[0][3:])), float(axis @ (other[1][3:] - one[1][3:]))
        # Both parts turn together. The Coriolis acceleration is perpendicular to the axis.
        arm = (far @ joint.child_pose).position - pose.position
        carried = far.rotation @ joint.child_pose.position
        spin, turning = one[0][3:], one[1][3:]

        def of_point(velocity: Array, acceleration: Array, reach: Array) -> tuple[Array, Array]:
            centripetal = np.cross(spin, np.cross(spin, reach))
            return velocity + np.cross(spin, reach), acceleration + np.cross(turning, reach) + centripetal

        near = of_point(one[0][:3], one[1][:3], arm)
        away = of_point(other[0][:3], other[1][:3], carried)
        return float(axis @ (away[0] - near[0])), float(axis @ (away[1] - near[1]))
