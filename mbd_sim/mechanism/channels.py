"""The commands that actuators and drives take: each of them takes one or several, its channels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal, TypeVar

if TYPE_CHECKING:
    from mbd_sim.mechanism.actuators import Actuator
    from mbd_sim.mechanism.drives import CommandedDrive

Number = TypeVar("Number")  # or a symbol
Channel = Literal["position", "velocity", "effort", "voltage", "current", "opening"]


def channel_names(takers: Sequence[Actuator | CommandedDrive]) -> tuple[str, ...]:
    """All commands in their order, as `actuator.channel`; a drive has the name of its joint."""
    return tuple(f"{taker.name}.{channel}" for taker in takers for channel in taker.channels)


def default_command(channel: Channel, position: Number) -> Number | float:
    """The command before the first one: the position at the start is held, everything else is zero."""
    return position if channel == "position" else 0.0
