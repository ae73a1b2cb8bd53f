"""When a trajectory that is a goal has succeeded or failed. Independent of ROS."""

from __future__ import annotations

import enum
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from mbd_sim.ros.joint_curve import JointMotion


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
