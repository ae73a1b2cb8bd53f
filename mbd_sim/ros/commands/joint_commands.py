"""Commands by the names of joints, as messages have them: which are for efforts, which for actuators, and their ranges.

A sender such as ros2_control's JointStateTopicSystem names all of its joints, and has an array for each interface, with
an entry only for each joint that has this interface. Commanded positions and velocities are bounded by the ranges of
the joints, independently of ROS.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np

from mbd_sim.base.errors import CommandError, listed, require_each_once
from mbd_sim.base.geometry.pose import Array
from mbd_sim.mechanism.contents import command_bounds
from mbd_sim.mechanism.elements.actuators import Actuator, CoordinatePort
from mbd_sim.mechanism.elements.joint_types import Channel, CommandedDrive
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.ros.commands.trajectory_player import JointCurve
from mbd_sim.simulation.model.commands import EffortMap

EFFORT: Channel = "effort"


@dataclass(frozen=True, slots=True)
class RoutedCommands:
    """Efforts by joint, and commands of actuators by name and channel."""

    efforts: Mapping[str, float]
    actuators: Mapping[str, Mapping[Channel, float]]


class JointCommandRouter:
    """Knows what takes a command of a joint: an actuator or a drive.

    An actuator without a joint is commanded by its own name.
    """

    def __init__(self, effort_map: EffortMap, takers: Sequence[Actuator | CommandedDrive]) -> None:
        self._effort_map = effort_map
        self.skips_nan = False  # as interfaces have that no controller of ros2_control has claimed
        self._takers: dict[str, dict[Channel, str]] = {}  # by joint and channel: the actuator, or the joint of a drive
        self._drives = {taker.name for taker in takers if isinstance(taker, CommandedDrive)}
        for taker in takers:
            port = None if isinstance(taker, CommandedDrive) else taker.port
            name = port.coordinate if isinstance(port, CoordinatePort) else taker.name
            taken = self._takers.setdefault(name, {})
            for channel in taker.channels:
                taken.setdefault(channel, taker.name)

    def route(self, names: Sequence[str], arrays: Mapping[Channel, Sequence[float]]) -> RoutedCommands:
        """The commands of a message.

        :param arrays: by channel, each with an entry for each of the `names`, or only for those that take it, or empty.
        :raises CommandError: a name is unknown or given twice, a length does not fit, or a joint takes no such command.
        """
        require_each_once(names, "Send one command for each joint.")
        given = {channel: values for channel, values in arrays.items() if len(values)}
        efforts, commands = dict[str, float](), dict[str, dict[Channel, float]]()
        for channel, values in (given or {EFFORT: ()}).items():
            for name, value in zip(self._addressed(names, channel, len(values)), values, strict=True):
                actuator = self._actuator(name, channel)
                if self.skips_nan and math.isnan(value):
                    continue
                if actuator is None:
                    efforts[name] = value
                else:
                    commands.setdefault(actuator, {})[channel] = value
        return RoutedCommands(efforts, commands)

    def positioner(self, name: str) -> str:
        """The actuator or drive of a joint that takes positions.

        :raises CommandError: there is no such joint or actuator.
        """
        if (actuator := self._takers.get(name, {}).get("position")) is not None:
            return actuator
        if name not in self._takers:
            self._effort_map.require(name)
            self._effort_map.require_leading(name)
        remedy = "Give it an actuator with a servo that controls its position."
        raise CommandError(f"joint '{name}' takes no position, which a trajectory commands", remedy)

    def _addressed(self, names: Sequence[str], channel: Channel, count: int) -> Sequence[str]:
        """Those of the names that the entries of an array belong to."""
        if count == len(names):
            return names
        takers = [name for name in names if self._takes(name, channel)]
        if self._takers and count == len(takers):
            return takers
        lengths = f"'name' and '{channel}' differ in length: {len(names)} and {count}"
        also = f", or only for {listed(takers)}" if self._takers and takers else ""
        raise CommandError(lengths, f"Send one {channel} for each name{also}.")

    def _takes(self, name: str, channel: Channel) -> bool:
        if name in self._takers:
            return channel in self._takers[name]
        return channel == EFFORT and name in self._effort_map.names

    def _actuator(self, name: str, channel: Channel) -> str | None:
        """The actuator that takes a command; None where it is the effort of a joint without an actuator."""
        if name in self._takers:
            if (actuator := self._takers[name].get(channel)) is not None:
                return actuator
            taken = listed([cast(str, other) for other in self._takers[name]])
            what = "drive" if name in self._drives else "actuator"
            raise CommandError(f"the {what} of '{name}' takes no {channel}", f"Command its {taken}.")
        self._effort_map.require_leading(name)
        if channel != EFFORT:
            self._effort_map.require(name)
            raise CommandError(f"joint '{name}' takes no {channel}, as it has no servo", "Command its effort.")
        return None


class CommandRanges:
    """The `lower` and `upper` bound (n,) of each command of actuators and drives, infinite without a limit.

    Positions are bounded by the `limits` of a joint and velocities by its `velocity_limit`, with their live values; for
    a drive, by those of the drive.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        found = [bounds for taker in mechanism.commanded for bounds in command_bounds(mechanism, taker)]
        self.lower, self.upper = np.array(found, dtype=float).reshape(-1, 2).T
        self._names = [(taker.name, channel) for taker in mechanism.commanded for channel in taker.channels]
        self._index = {name: index for index, name in enumerate(self._names)}

    def clamped(self, commands: Array) -> Array:
        """Commands (n,) within their bounds; nan stays."""
        return np.clip(commands, self.lower, self.upper)

    def excess(self, commands: Array) -> str:
        """The first of the commands (n,) that is out of its bounds, in words; empty if there is none."""
        beyond = np.flatnonzero((commands < self.lower) | (commands > self.upper))
        if not len(beyond):
            return ""
        (taker, channel), index = self._names[beyond[0]], beyond[0]
        bounds = f"{self.lower[index]:.6g} to {self.upper[index]:.6g}"
        return f"the {channel} {commands[index]:.6g} of '{taker}' is not within {bounds}"

    def require(self, taker: str, joint: str, curve: JointCurve) -> None:
        """Refuse a trajectory with a point out of bounds.

        :raises CommandError: it names the point.
        """
        for number, point in enumerate(curve.points, start=1):
            values: tuple[tuple[Channel, float | None], ...] = (
                ("position", point.position),
                ("velocity", point.velocity),
            )
            for channel, value in values:
                index = self._index[taker, channel]
                lower, upper = float(self.lower[index]), float(self.upper[index])
                if value is not None and not lower <= value <= upper:
                    raise CommandError(
                        (
                            f"the {channel} {value:.6g} of '{joint}' at point {number} is beyond the limits of the "
                            f"joint, {lower:.6g} to {upper:.6g}"
                        ),
                        "Stay within them.",
                    )
