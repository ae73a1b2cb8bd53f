"""Buffers commands of actuators from the topics until the next step. Independent of ROS.

They are held until the next command or reset: no watchdog ends them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from mbd_sim.errors import CommandError, listed
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.actuators import Channel
from mbd_sim.simulation.actuator_commands import CommandMap


class ActuatorBuffer:
    """Keeps the newest command of each channel; `map` checks them. Its owner calls it under a lock."""

    def __init__(self, command_map: CommandMap) -> None:
        self.map = command_map
        self._requested = np.full(len(command_map.names), np.nan)  # nan: never commanded
        self._new = False

    def merged(self, commands: Mapping[str, Mapping[Channel, float]]) -> Array:
        """The newest commands (n,) with further ones, for `take`.

        :raises CommandError: one does not fit, or is not finite.
        """
        return self.map.merged(self._requested, commands)

    def in_order(self, values: Sequence[float]) -> Array:
        """Commands (n,) of all channels, for `take`.

        :raises CommandError: wrong length, or one is not finite.
        """
        if len(values) != len(self.map.names):
            names = listed(list(self.map.names)) if self.map.names else "no channel: there are no actuators"
            raise CommandError(f"{len(values)} commands given. Give one for each of: {names}.")
        return self.map.checked(self.map.names, np.array(values, dtype=float))

    def take(self, requested: Array) -> None:
        """Take commands from the next step on."""
        self._requested, self._new = requested, True

    def due(self, current: Array) -> Array | None:
        """All commands (n,) to apply, if there are new ones; channels never commanded keep the `current` ones."""
        if not self._new:
            return None
        self._new = False
        return np.where(np.isnan(self._requested), current, self._requested)

    def clear(self) -> None:
        """Discard all commands, as after a reset."""
        self._requested, self._new = np.full(len(self.map.names), np.nan), False
