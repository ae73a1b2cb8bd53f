"""A trajectory for several joints, checked as a whole, and the motion of each through its points. Independent of ROS.

Between two points the motion is the polynomial in time of the lowest degree that has what both give: linear for
positions, cubic with velocities, quintic with accelerations too, as in ros2_control's joint_trajectory_controller.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from mbd_sim.base.errors import CommandError, listed, require_each_once


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


LARGEST_DELAY_NS = 86_400_000_000_000  # of a start in the future: stamps of another clock are later


@dataclass(frozen=True, slots=True)
class TrajectoryPoint:
    """A point, with an entry for each joint in each array that is not empty; `time_ns` is from the start."""

    time_ns: int
    positions: Sequence[float]
    velocities: Sequence[float] = ()
    accelerations: Sequence[float] = ()
    efforts: Sequence[float] = ()

    @property
    def time(self) -> float:
        """The time from the start in s."""
        return 1e-9 * self.time_ns


@dataclass(frozen=True)
class Trajectory:
    """Points for the `joints`; `start_ns` is a time of the node's clock, 0 for the moment of arrival."""

    joints: Sequence[str]
    points: Sequence[TrajectoryPoint]
    start_ns: int = 0

    def curves(self, now_ns: int) -> dict[str, JointCurve]:
        """The motion of each joint.

        :param now_ns: the time of the node's clock.
        :raises CommandError: the trajectory contradicts itself, is not finite, or its start does not fit.
        """
        if not self.joints:
            raise CommandError("it names no joints", "Name those that it moves.")
        require_each_once(self.joints, "Name each joint once.")
        if not self.points:
            raise CommandError("it has no points", "Give one or more.")
        for number, point in enumerate(self.points, start=1):
            self._check_lengths(number, point)
            self._check_numbers(number, point)
            if point.time_ns < 0 or (number > 1 and point.time <= self.points[number - 2].time):
                raise CommandError(
                    f"time_from_start of point {number} is {point.time:.9g} s",
                    "It must not be negative, and must increase from point to point.",
                )
        self._check_end()
        self._check_start(now_ns)
        return {name: JointCurve([_of_joint(point, i) for point in self.points]) for i, name in enumerate(self.joints)}

    def _check_lengths(self, number: int, point: TrajectoryPoint) -> None:
        if point.efforts:
            raise CommandError(f"point {number} has efforts, which a trajectory cannot have", "Leave 'effort' empty.")
        if point.accelerations and not point.velocities:
            raise CommandError(f"point {number} has accelerations without velocities", "Give both, or only velocities.")
        for key, values in _arrays(point):
            if len(values) != len(self.joints) and (values or key == "positions"):
                raise CommandError(
                    (
                        f"'joint_names' and '{key}' of point {number} differ in length: {len(self.joints)} and "
                        f"{len(values)}"
                    ),
                    "Give one for each joint.",
                )

    def _check_numbers(self, number: int, point: TrajectoryPoint) -> None:
        for key, values in _arrays(point):
            if bad := [name for name, value in zip(self.joints, values, strict=False) if not math.isfinite(value)]:
                raise CommandError(
                    f"the {key} of {listed(bad)} at point {number} are not finite", "Give finite numbers."
                )

    def _check_end(self) -> None:
        last = zip(self.joints, self.points[-1].velocities, strict=False)  # there may be none
        if moving := [name for name, velocity in last if velocity]:
            raise CommandError(
                f"{listed(moving)} would move at the last point, but its position is held",
                "Let all velocities be zero there.",
            )

    def _check_start(self, now_ns: int) -> None:
        if not self.start_ns:
            return
        remedy = "Use simulated time (use_sim_time), or the stamp 0 to start at once."
        if (end := self.start_ns + self.points[-1].time_ns) < now_ns:
            raise CommandError(f"it ends at {1e-9 * end:.9g} s, before the present {1e-9 * now_ns:.9g} s", remedy)
        if self.start_ns - now_ns > LARGEST_DELAY_NS:
            raise CommandError(
                f"it starts at {1e-9 * self.start_ns:.9g} s, more than a day after the present {1e-9 * now_ns:.9g} s",
                remedy,
            )


def _arrays(point: TrajectoryPoint) -> tuple[tuple[str, Sequence[float]], ...]:
    return ("positions", point.positions), ("velocities", point.velocities), ("accelerations", point.accelerations)


def _of_joint(point: TrajectoryPoint, index: int) -> CurvePoint:
    velocity, acceleration = (values[index] if values else None for values in (point.velocities, point.accelerations))
    return CurvePoint(point.time, point.positions[index], velocity, acceleration)
