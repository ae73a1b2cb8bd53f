"""Commands of actuators: checked as a whole, by the names of actuators or of their channels."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from mbd_sim.errors import CommandError, listed, nearest, quoted
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.channels import Channel, channel_names

if TYPE_CHECKING:
    from mbd_sim.dynamics.input_layout import InputLayout
    from mbd_sim.mechanism.actuators import Actuator
    from mbd_sim.mechanism.drives import CommandedDrive

Command = float | Mapping[Channel, float]


class CommandMap:
    """The commands of actuators and drives, one number for each channel; `names` are `actuator.channel`, in order.

    A command in N, N·m, rad, m, rad/s, m/s, V or A acts on the first channel of an actuator, or on those that it names.
    A drive has the name of its joint.
    """

    def __init__(self, takers: Sequence[Actuator | CommandedDrive], layout: InputLayout) -> None:
        self.takers, self.range = {taker.name: taker for taker in takers}, layout.commands
        channels = [(taker.name, channel) for taker in takers for channel in taker.channels]
        self.names = channel_names(takers)
        self._index = {key: index for index, key in enumerate(channels)}

    def merged(self, current: Array, commands: Mapping[str, Command]) -> Array:
        """All commands (n,) after new ones; those that they do not name stay as in `current`.

        :raises CommandError: an unknown actuator or channel, or a value that is not a finite number.
        """
        merged = current.copy()
        for name, given in commands.items():
            if name not in self.takers:
                remedy = nearest(name, self.takers) if self.takers else "This mechanism has no actuators."
                raise CommandError(f"there is no actuator '{name}'. {remedy}")
            channels = self.takers[name].channels
            by_channel = given if isinstance(given, Mapping) else {channels[0]: given}
            for channel, value in by_channel.items():
                if (name, channel) not in self._index:
                    message = f"actuator '{name}' takes no {channel}. Command its {listed(list(channels))}."
                    raise CommandError(message)
                merged[self._index[name, channel]] = _finite(f"{name}.{channel}", value)
        return merged

    def checked(self, labels: Sequence[str], values: Array) -> Array:
        """All commands (n,), as a recording has them.

        :raises CommandError: the labels are those of other actuators, or a value is not finite.
        """
        if tuple(labels) != self.names or len(values) != len(self.names) or not np.all(np.isfinite(values)):
            raise CommandError(f"the commands do not fit: one finite number is needed for {listed(list(self.names))}.")
        return values


def _finite(name: str, value: object) -> float:
    try:
        if isinstance(value, str | bytes):
            raise TypeError(f"{quoted(value)} is a text")
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError) as error:
        raise CommandError(f"the command of {name} is not a number ({error}). Give a number.") from error
    if not math.isfinite(number):
        raise CommandError(f"the command of {name} is not finite. Give a finite number.")
    return number
