"""Plays trajectories as commands of actuators that take positions, from step to step. Independent of ROS.

If a trajectory is a goal, the module also decides when it has succeeded or failed.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

from mbd_sim.base.geometry.pose import Array
from mbd_sim.recordings.messages.journal import publication_schedule
from mbd_sim.ros.commands.trajectory import JointCurve, JointMotion
from mbd_sim.simulation.model.commands import CommandMap


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

    def motion(self, actuator: str, now: int) -> JointMotion | None:
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
            motion = _motion(before, now) if before else JointMotion(float(current[self._index[f"{name}.position"]]))
            curve = waiting.curve.begun(waiting.elapsed(now), motion)
            self._playing[name] = PlayedCurve(curve, now if waiting.start is None else waiting.start, waiting.number)
        return begun


def _motion(played: PlayedCurve, now: int) -> JointMotion:
    motion = played.curve.at(played.elapsed(now))
    if not math.isfinite(motion.position) or not math.isfinite(motion.velocity):  # of points too far apart
        return JointMotion(played.curve.points[-1].position)
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

    def verdict(self, elapsed: float, deviations: Mapping[str, JointMotion]) -> Verdict | None:
        """How the goal has ended, at a time in s from its start; None: it has not.

        :param deviations: of the joints from their trajectories.
        """
        if elapsed < self.duration:
            found = next(_exceeded(self.path, deviations), None)
            return None if found is None else Verdict(Outcome.LEFT_PATH, f"{found} at {elapsed:.3f} s")
        found = next(_exceeded(self.goal, deviations), None)
        if found is None:
            return Verdict(Outcome.SUCCEEDED, "")
        late = elapsed - self.duration
        return (
            Verdict(Outcome.MISSED_GOAL, f"{found} {late:.3f} s after the end") if late > self.time_tolerance else None
        )


def _exceeded(tolerances: Mapping[str, Tolerance], deviations: Mapping[str, JointMotion]) -> Iterator[str]:
    for name, tolerance in tolerances.items():
        for what, value, limit in (
            ("position", deviations[name].position, tolerance.position),
            ("velocity", deviations[name].velocity, tolerance.velocity),
        ):
            if abs(value) > limit:
                yield f"the {what} of '{name}' is {value:.6g} off, more than {limit:.6g},"
