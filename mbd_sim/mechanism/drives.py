"""Drives that take the motion of a joint from commands, as plain records."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from mbd_sim.errors import MechanismError, Problem, listed

if TYPE_CHECKING:
    from mbd_sim.mechanism.channels import Channel
    from mbd_sim.mechanism.records import Mechanism

STATES = 3  # position, velocity and acceleration


@dataclass(frozen=True)
class CommandedDrive:
    """A drive whose motion follows commands of its position, or of its velocity, through a filter of third order.

    `name` is that of the joint, and `bandwidth` the slowest rate in 1/s: see `mbd_sim.dynamics.commanded_drives`. The
    position stays between `lower` and `upper`, and the speed and the acceleration within their limits, whatever is
    commanded; in rad or m and s. `start` is the position at time zero.
    """

    name: str
    controls: Literal["position", "velocity"]
    bandwidth: float
    velocity_limit: float = math.inf
    acceleration_limit: float = math.inf
    lower: float = -math.inf
    upper: float = math.inf
    start: float = 0.0

    @property
    def channels(self) -> tuple[Channel, ...]:
        """The commands that it takes, in their order among the inputs."""
        return ("position", "velocity") if self.controls == "position" else ("velocity",)


def commanded_drives(mechanism: Mechanism) -> Mapping[str, CommandedDrive]:
    """The drives that follow commands, by the names of their joints, in the order of the file."""
    return {name: joint.drive for name, joint in mechanism.joints.items() if isinstance(joint.drive, CommandedDrive)}


def require_no_commanded_drives(mechanism: Mechanism, what: str) -> None:
    """Refuse what is possible only without drives that follow commands.

    :param what: that it is not possible, such as "cannot be printed".
    :raises MechanismError: their joints are named.
    """
    if names := list(commanded_drives(mechanism)):
        message = f"{mechanism.name} {what}, because drives follow commands: {listed(names)}"
        raise MechanismError([Problem(message, "Drive these joints by expressions of the time.")])
