"""Keeps the newest commands of actuators and drives until the next step. Independent of ROS.

They are held until the next command, trajectory or reset, unless a watchdog is asked for.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from mbd_sim.base.errors import CommandError, listed
from mbd_sim.base.geometry.pose import Array
from mbd_sim.ros.commands.joint_commands import CommandRanges
from mbd_sim.ros.commands.trajectory_player import TrajectoryPlayer
from mbd_sim.simulation.model.commands import Command, CommandMap


class ActuatorBuffer:
    """Keeps the newest command of each channel; `map` checks them. Its owner calls it under a lock."""

    def __init__(self, command_map: CommandMap, step_size: float, ranges: CommandRanges | None = None) -> None:
        """Commands for steps of `step_size` in s, which are clamped to the `ranges` if they are given."""
        self.map, self.player = command_map, TrajectoryPlayer(command_map, step_size)
        self.ranges, self.limited = ranges, 0  # how often commands have been clamped
        self.excess = ""  # the newest command that has been clamped, in words
        self._exceeded = False
        self._requested = np.full(len(command_map.names), np.nan)  # nan: never commanded
        self._new = False
        self.timeout = 0.0  # s; 0: never
        self.expired: list[str] = []  # actuators whose commands have expired since this list was emptied
        self._commanded = dict[str, None]()  # since commands were due
        self._last_times = dict[str, float]()  # of the actuators that are watched
        self._streamed = dict[str, float]()  # actuators under a stream of commands, which expire after this time in s

    def keep_within(self, ranges: CommandRanges) -> None:
        """Clamp commands to other ranges from now on, the ones in effect included."""
        self.ranges = ranges
        self._new |= not np.all(np.isnan(self._requested))

    def merged(self, commands: Mapping[str, Command]) -> Array:
        """The newest commands (n,) with further ones, for `take`.

        :raises CommandError: one does not fit, or is not finite.
        """
        return self.map.merged(self._requested, commands)

    def in_order(self, values: Sequence[float]) -> Array:
        """Commands (n,) of all channels, for `take`.

        :raises CommandError: wrong length, or one is not finite.
        """
        names = self.map.names
        if not names and len(values):
            remedy = "Send efforts of joints to ~/commands, or write actuators into the file."
            raise CommandError("the mechanism has no actuators", remedy)
        if len(values) != len(names):
            remedy = f"Give one for each of: {listed(list(names))}."
            raise CommandError(f"{len(names)} commands expected, but {len(values)} given", remedy)
        return self.map.checked(self.map.names, np.array(values, dtype=float))

    def take(self, requested: Array, actuators: Iterable[str], timeout: float | None = None) -> None:
        """Take commands from the next step on; the trajectories of the actuators that they command end.

        :param timeout: in s, after which these commands expire; by default that of all actuators.
        """
        actuators = tuple(actuators)
        for name in actuators:
            self._streamed.pop(name, None)
        if timeout is not None:
            self._streamed |= dict.fromkeys(actuators, timeout)
        for velocity in self.player.cancel(actuators):
            if requested[velocity] == self._requested[velocity]:  # no new command
                requested[velocity] = 0.0
        self._commanded |= dict.fromkeys(actuators)
        self._requested, self._new = requested, True
        excess = self.ranges.excess(requested) if self.ranges is not None else ""
        self._count(excess, again=True)

    def renew(self, commands: Mapping[str, float]) -> None:
        """Restart the watchdog of each actuator one of whose commands by channel is still the newest."""
        for channel, value in zip(self.map.names, self._requested.tolist(), strict=True):
            actuator = channel.rpartition(".")[0]
            if commands.get(channel) == value and not self.player.plays(actuator):
                self._commanded[actuator] = None

    def newest(self, current: Array) -> Array:
        """The commands (n,) that are due next; channels never commanded keep the `current` ones."""
        commands = np.where(np.isnan(self._requested), current, self._requested)
        return commands if self.ranges is None else self.ranges.clamped(commands)

    def due(self, time: float, current: Array) -> Array | None:
        """All commands (n,) to apply at a time in s of the run, if there are new ones.

        Channels never commanded keep the `current` ones.
        """
        self._last_times |= dict.fromkeys(self._commanded, time)
        self._commanded.clear()
        self._expire(time)
        commands = np.where(np.isnan(self._requested), current, self._requested)
        samples = self.player.sample(time, commands)
        for index, value in samples.items():
            self._requested[index] = commands[index] = value
        if not self._new and not samples:
            return None
        self._new = False
        if self.ranges is None:
            return commands
        self._count(self.ranges.excess(commands), again=False)
        return self.ranges.clamped(commands)

    def _count(self, excess: str, *, again: bool) -> None:
        """Count commands that are clamped: each one, or those of a trajectory once until it is in range `again`."""
        self.limited += bool(excess) and (again or not self._exceeded)
        self.excess, self._exceeded = excess or self.excess, bool(excess)

    def _expire(self, time: float) -> None:
        """Set commands other than positions to zero where none has arrived for too long."""
        for name, last in list(self._last_times.items()):
            timeout = self._streamed.get(name, self.timeout)
            if timeout <= 0.0 or time - last < timeout or self.player.plays(name):
                continue
            del self._last_times[name]
            channels = [
                index
                for index, channel in enumerate(self.map.names)
                if channel.rpartition(".")[0] == name and not channel.endswith(".position")
            ]
            if np.any(np.nan_to_num(self._requested[channels])):
                self._requested[channels], self._new = 0.0, True
                self.expired.append(name)

    def clear(self) -> None:
        """Discard all commands, as after a reset."""
        self._requested, self._new = np.full(len(self.map.names), np.nan), False
        self._commanded.clear()
        self._last_times.clear()
        self._streamed.clear()
        self.player.clear()
