"""The commands of actuators and drives as actions: their names and their ranges."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import SupportsFloat

from mbd_sim.errors import InputError, nearest, quoted
from mbd_sim.mechanism.channels import channel_names
from mbd_sim.mechanism.command_bounds import action_bounds
from mbd_sim.mechanism.records import Mechanism

Limit = float | Sequence[float]  # the largest absolute value, or the bounds


class CommandNames:
    """The commands of a mechanism by their names, with their ranges `bounds`, and the actuators and drives `first`.

    `channels` are their full names, in order.
    """

    def __init__(self, mechanism: Mechanism, limits: Mapping[str, Limit]) -> None:
        """:param limits: replace the bounds of some commands, by name.

        :raises InputError: an unknown name, or limits that are no numbers, or in the wrong order.
        """
        self.channels = channel_names(mechanism.commanded)
        self._index = {name: index for index, name in enumerate(self.channels)}
        self.first = tuple(taker.name for taker in mechanism.commanded)
        for taker in mechanism.commanded:
            self._index[taker.name] = self._index[f"{taker.name}.{taker.channels[0]}"]
        self.bounds = [bounds for taker in mechanism.commanded for bounds in action_bounds(mechanism, taker)]
        for name, limit in limits.items():
            if (place := self.get(name)) is None:
                raise InputError(f"there is no command '{name}'", nearest(name, self.names))
            try:
                lower, upper = (-float(limit), float(limit)) if isinstance(limit, SupportsFloat) else map(float, limit)
            except (TypeError, ValueError):
                lower, upper = math.nan, math.nan
            if not lower <= upper:
                remedy = "Give the largest absolute value, or a pair of bounds."
                raise InputError(f"the limit of the command {name} is {quoted(limit)}", remedy)
            self.bounds[place] = lower, upper

    @property
    def names(self) -> list[str]:
        """All names: `actuator.channel`, and `actuator` for its first channel."""
        return list(self._index)

    def get(self, name: str) -> int | None:
        """The index of a command; None if there is none of this name."""
        return self._index.get(name)
