"""The motion of one joint through the points of a trajectory. Independent of ROS.

Between two points it is the polynomial in time of the lowest degree that has what both give: linear for positions,
cubic with velocities, quintic with accelerations too, as in ros2_control's joint_trajectory_controller.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from typing import NamedTuple


class CurvePoint(NamedTuple):
    """A point at a time in s from the start of the trajectory, in rad or m; None: not given."""

    time: float
    position: float
    velocity: float | None = None
    acceleration: float | None = None


class JointMotion(NamedTuple):
    """Position, velocity and acceleration at one time, in rad or m and s."""

    position: float
    velocity: float = 0.0
    acceleration: float = 0.0


class JointCurve:
    """The motion through points whose times increase; after the last one, its position is held."""

    def __init__(self, points: Sequence[CurvePoint]) -> None:
        self.points = list(points)
        self._times = [point.time for point in points]

    @property
    def end(self) -> float:
        """The time of the last point in s."""
        return self._times[-1]

    def begun(self, time: float, motion: JointMotion) -> JointCurve:
        """The curve from a motion at a time in s on, to the first of its points that is later."""
        later = [point for point in self.points if point.time > time]
        if len(later) < len(self.points):  # it has begun already
            return self
        return JointCurve([CurvePoint(time, *motion), *later])

    def at(self, time: float) -> JointMotion:
        """The motion at a time in s, which is not before the first point."""
        index = bisect_right(self._times, time)
        if index == len(self._times):
            return JointMotion(self.points[-1].position)
        return between(self.points[index - 1], self.points[index], time)


def between(first: CurvePoint, second: CurvePoint, time: float) -> JointMotion:
    """The motion at a time in s between two points."""
    t, duration = time - first.time, second.time - first.time
    p, rise = first.position, second.position - first.position
    if first.velocity is None or second.velocity is None:
        return JointMotion(p + rise * (t / duration), rise / duration)
    v, w = first.velocity, second.velocity
    if first.acceleration is None or second.acceleration is None:
        a = 0.0
        c3 = ((v + w) * duration - 2.0 * rise) / duration**3
        c2, c4, c5 = (3.0 * rise - (2.0 * v + w) * duration) / duration**2, 0.0, 0.0
    else:
        a, b = first.acceleration, second.acceleration
        c2 = 0.5 * a
        c3 = (20.0 * rise - (12.0 * v + 8.0 * w) * duration - (3.0 * a - b) * duration**2) / (2.0 * duration**3)
        c4 = (-30.0 * rise + (16.0 * v + 14.0 * w) * duration + (3.0 * a - 2.0 * b) * duration**2) / (2.0 * duration**4)
        c5 = (12.0 * rise - 6.0 * (v + w) * duration - (a - b) * duration**2) / (2.0 * duration**5)
    return JointMotion(
        p + t * (v + t * (c2 + t * (c3 + t * (c4 + t * c5)))),
        v + t * (2.0 * c2 + t * (3.0 * c3 + t * (4.0 * c4 + t * 5.0 * c5))),
        2.0 * c2 + t * (6.0 * c3 + t * (12.0 * c4 + t * 20.0 * c5)),
    )
