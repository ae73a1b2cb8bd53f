"""Trajectories, and their player: commands of actuators that take positions, step by step. Independent of ROS.

If a trajectory is a goal, the module also decides when it has succeeded or failed.
"""

from __future__ import annotations

import enum
import math
from bisect import bisect_right
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from mbd_sim.base.errors import CommandError, listed, require_each_once
from mbd_sim.base.geometry.pose import Array
from mbd_sim.recordings.messages.events import publication_schedule
from mbd_sim.simulation.model.commands import CommandMap


@dataclass(frozen=True, slots=True)
class JointPoint:
    """A point at a time in s from the start of the trajectory, in rad or m; None: not given."""

    time: float
    position: float
    velocity: float | None = None
    acceleration: float | None = None


class Setpoint(NamedTuple):
    """Position, velocity and acceleration at one time, in rad or m and s."""

    position: float
    velocity: float = 0.0
    acceleration: float = 0.0


class JointCurve:
    """The motion through points whose times increase; after the last one, its position is held."""

    def __init__(self, points: Sequence[JointPoint]) -> None:
        self.points = list(points)
        self._times = [point.time for point in points]

    @property
    def end(self) -> float:
        """The time of the last point in s."""
        return self._times[-1]

    def begun(self, time: float, motion: Setpoint) -> JointCurve:
        """The curve from a motion at a time in s on, to the first of its points that is later."""
        later = [point for point in self.points if point.time > time]
        if len(later) < len(self.points):  # it has begun already
            return self
        return JointCurve([JointPoint(time, *motion), *later])

    def at(self, time: float) -> Setpoint:
        """The motion at a time in s, which is not before the first point."""
        index = bisect_right(self._times, time)
        if index == len(self._times):
            return Setpoint(self.points[-1].position)
        return between(self.points[index - 1], self.points[index], time)


def between(first: JointPoint, second: JointPoint, time: float) -> Setpoint:
    """The motion at a time in s between two points."""
    t, duration = time - first.time, second.time - first.time
    p, rise = first.position, second.position - first.position
    if first.velocity is None or second.velocity is None:
        return Setpoint(p + rise * (t / duration), rise / duration)
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
    return Setpoint(
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


def _of_joint(point: TrajectoryPoint, index: int) -> JointPoint:
    velocity, acceleration = (values[index] if values else None for values in (point.velocities, point.accelerations))
    return JointPoint(point.time, point.positions[index], velocity, acceleration)


@dataclass(frozen=True, slots=True)
class PlayedCurve:
    """A curve of an actuator, whose time zero is `start` in ns of the run; None: when it is first due."""

    curve: JointCurve
    start: int | None
    number: int = 0  # of the trajectory, see `TrajectoryPlayer.take`

    def elapsed(self, now: int) -> float:
        """The time of the curve in s at `now` in ns of the run."""
        return 1e-9 * (now - (now if self.start is None else self.start))


class TrajectoryPlayer:
    """A trajectory of each actuator, and the one that replaces it when its start has come.

    A new trajectory begins with the commands that are in effect, and is sampled `rate` times a simulated second, at
    most once in each step. Its owner calls it under a lock.
    """

    def __init__(self, command_map: CommandMap, step_size: float, rate: float = 1000.0) -> None:
        """Play trajectories in steps of `step_size` in s, with a `rate` in Hz of simulated time above zero."""
        self.rate, self._step_size = rate, step_size
        self._index = {name: index for index, name in enumerate(command_map.names)}
        self._playing = dict[str, PlayedCurve]()
        self._waiting = dict[str, PlayedCurve]()
        self._taken = 0

    @property
    def is_active(self) -> bool:
        """Whether there are trajectories that have not ended."""
        return bool(self._playing or self._waiting)

    def plays(self, actuator: str) -> bool:
        """Whether a trajectory of an actuator has begun and not ended."""
        return actuator in self._playing

    def take(self, curves: Mapping[str, JointCurve], start: int | None) -> int:
        """Take a trajectory of some actuators; it replaces theirs when it starts, at a time in ns of the run.

        Returns its number.
        """
        self._taken += 1
        self._waiting |= {name: PlayedCurve(curve, start, self._taken) for name, curve in curves.items()}
        return self._taken

    def follows(self, actuator: str, number: int) -> bool:
        """Whether an actuator follows the trajectory with this number, or will."""
        return any(
            played is not None and played.number == number
            for played in (self._playing.get(actuator), self._waiting.get(actuator))
        )

    def motion(self, actuator: str, now: int) -> Setpoint | None:
        """The motion that is commanded `now` in ns of the run; None if no trajectory has begun."""
        played = self._playing.get(actuator)
        return None if played is None else _motion(played, now)

    def cancel(self, actuators: Iterable[str]) -> list[int]:
        """End the trajectories of actuators; returns the channels of the velocities that have been commanded."""
        found = []
        for name in actuators:
            self._waiting.pop(name, None)
            if self._playing.pop(name, None) is not None:
                found.append(self._index[f"{name}.velocity"])
        return found

    def clear(self) -> None:
        """End all trajectories."""
        self._playing.clear()
        self._waiting.clear()

    def steps_to_sample(self, tick: int, at_most: int) -> int:
        """The steps from a tick to the next one at which there may be a sample, or fewer."""
        schedule = publication_schedule(self.rate, self._step_size)
        if not self.is_active or schedule is None:
            return at_most
        return min(at_most, schedule.next_tick(tick) - tick)

    def sample(self, time: float, current: Array) -> dict[int, float]:
        """The commands at a time in s of the run, by their number.

        :param current: the commands (n,) in effect.
        """
        if not self.is_active:
            return {}
        now = round(1e9 * time)
        begun = self._begin(now, current)
        schedule = publication_schedule(self.rate, self._step_size)
        is_due = schedule is None or schedule.is_due(round(time / self._step_size))
        commands = dict[int, float]()
        for name, played in list(self._playing.items()):
            if not is_due and name not in begun:
                continue
            motion = _motion(played, now)
            commands[self._index[f"{name}.position"]] = motion.position
            commands[self._index[f"{name}.velocity"]] = motion.velocity
            if played.elapsed(now) >= played.curve.end:
                del self._playing[name]
        return commands

    def _begin(self, now: int, current: Array) -> set[str]:
        """Begin the trajectories whose start has come, with the motion that is commanded now; returns the actuators."""
        begun = {name for name, waiting in self._waiting.items() if waiting.start is None or waiting.start <= now}
        for name in sorted(begun):
            waiting = self._waiting.pop(name)
            before = self._playing.get(name)
            motion = _motion(before, now) if before else Setpoint(float(current[self._index[f"{name}.position"]]))
            curve = waiting.curve.begun(waiting.elapsed(now), motion)
            self._playing[name] = PlayedCurve(curve, now if waiting.start is None else waiting.start, waiting.number)
        return begun


def _motion(played: PlayedCurve, now: int) -> Setpoint:
    motion = played.curve.at(played.elapsed(now))
    if not math.isfinite(motion.position) or not math.isfinite(motion.velocity):  # of points too far apart
        return Setpoint(played.curve.points[-1].position)
    return motion


@dataclass(frozen=True, slots=True)
class Tolerance:
    """The largest deviations of a joint from its trajectory, in rad or m and s."""

    position: float = math.inf
    velocity: float = math.inf


class Outcome(enum.Enum):
    """How a goal has ended."""

    SUCCEEDED = "succeeded"
    LEFT_PATH = "left its path"
    MISSED_GOAL = "missed its goal"


@dataclass(frozen=True, slots=True)
class Verdict:
    """How a goal has ended, and why."""

    outcome: Outcome
    text: str


@dataclass(frozen=True)
class TrajectoryGoal:
    """Tolerances of joints by name, `path` on the way and `goal` at the end, which comes after `duration` in s.

    At the end the joints have `time_tolerance` in s to come within the tolerances.
    """

    duration: float
    path: Mapping[str, Tolerance] = field(default_factory=dict)
    goal: Mapping[str, Tolerance] = field(default_factory=dict)
    time_tolerance: float = math.inf

    def verdict(self, elapsed: float, deviations: Mapping[str, Setpoint]) -> Verdict | None:
        """How the goal has ended, at a time in s from its start; None: it has not.

        :param deviations: of the joints from their trajectories.
        """
        if elapsed < self.duration:
            found = next(_exceeded(self.path, deviations), None)
            return None if found is None else Verdict(Outcome.LEFT_PATH, f"{found} at {elapsed:.3f} s")
        found = next(_exceeded(self.goal, deviations), None)
        if found is None:
            return Verdict(Outcome.SUCCEEDED, "")
        if (late := elapsed - self.duration) <= self.time_tolerance:
            return None
        return Verdict(Outcome.MISSED_GOAL, f"{found} {late:.3f} s after the end")


def _exceeded(tolerances: Mapping[str, Tolerance], deviations: Mapping[str, Setpoint]) -> Iterator[str]:
    for name, tolerance in tolerances.items():
        for what, value, limit in (
            ("position", deviations[name].position, tolerance.position),
            ("velocity", deviations[name].velocity, tolerance.velocity),
        ):
            if abs(value) > limit:
                yield f"the {what} of '{name}' is {value:.6g} off, more than {limit:.6g},"
