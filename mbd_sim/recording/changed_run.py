"""What a recorded run would have been with other values, another method or another step, under the same commands."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mbd_sim.errors import CommandError, DivergedError
from mbd_sim.geometry.pose import Array
from mbd_sim.recording import cdr
from mbd_sim.recording.contents import Message
from mbd_sim.recording.recomputation import (
    COMMANDS,
    ENERGIES,
    STATES,
    Recomputation,
    joint_rows,
)

QUANTITIES = ("position", "velocity", "effort")


class Series(NamedTuple):
    """One quantity over the time in s since the beginning of the recording, as recorded and as it would have been."""

    name: str
    times: Array
    recorded: Array
    changed: Array

    @property
    def largest(self) -> tuple[float, float]:
        """The largest deviation and the time of it; both 0 where there is none."""
        if not len(self.times):
            return 0.0, 0.0
        off = np.abs(self.changed - self.recorded)
        place = int(np.argmax(off))
        return float(off[place]), float(self.times[place])


@dataclass(frozen=True)
class WhatIf:
    """Two runs under the same commands: `coordinates` by quantity and name, and `energies`, over the same times.

    `ended` says why the changed run ends before the recorded one, or is "".
    """

    replica: Recomputation
    coordinates: Mapping[str, Sequence[Series]]
    energies: Sequence[Series]
    ended: str = ""


def what_if(
    replica: Recomputation,
    progress: Callable[[float], None] | None = None,
    keep: Callable[[Message, Sequence[Array]], None] | None = None,
) -> WhatIf:
    """Lead a changed simulation through the recorded commands.

    :param keep: hears of each message that was taken, with the arrays that it would hold in the changed run.
    :raises DamagedError: the recording is not what was written.
    """
    told: dict[str, list[tuple[float, Array, Array]]] = {STATES: [], ENERGIES: []}
    ended = ""
    blocks = replica.part.blocks
    try:
        for number, block in enumerate(blocks):
            if progress is not None:
                progress(number / len(blocks))
            for message in block.load():
                _take(replica, message, told, keep)
    except (DivergedError, CommandError) as error:
        ended = str(error)
    if progress is not None:
        progress(1.0)
    model = replica.simulation.model
    names = [*model.coordinate_names, *model.driven_names]
    rows = _series(told[STATES], [f"{name} {quantity}" for quantity in QUANTITIES for name in names])
    count = len(names)
    coordinates = {quantity: rows[place * count :][:count] for place, quantity in enumerate(QUANTITIES)}
    return WhatIf(replica, coordinates, _series(told[ENERGIES], replica.simulation.energies._fields), ended)


def _take(
    replica: Recomputation,
    message: Message,
    told: Mapping[str, list[tuple[float, Array, Array]]],
    keep: Callable[[Message, Sequence[Array]], None] | None,
) -> None:
    role = replica.roles.get(message.topic)
    tick = replica.behind(message)
    if tick != replica.tick:
        replica.advance(tick)
    arrays: Sequence[Array] = ()
    if role in COMMANDS:
        replica.apply(message)
    elif role is not None and role in told:
        simulation = replica.simulation
        if role == STATES:
            arrays = joint_rows(simulation.model, simulation.time, simulation.y, simulation.inputs)
            recorded = np.concatenate(cdr.joint_states(message.payload)[3:])
        else:
            arrays = (np.array(simulation.energies),)
            recorded = cdr.numbers(message.payload).values
        time = (tick - replica.first_tick) * replica.recorded_step
        told[role].append((time, recorded, np.concatenate(arrays)))
    if keep is not None:
        keep(message, arrays)


def _series(rows: Sequence[tuple[float, Array, Array]], names: Sequence[str]) -> list[Series]:
    if not rows:
        return [Series(name, np.empty(0), np.empty(0), np.empty(0)) for name in names]
    times = np.array([time for time, _, _ in rows])
    recorded, changed = np.array([row[1] for row in rows]).T, np.array([row[2] for row in rows]).T
    return [Series(*each) for each in zip(names, [times] * len(names), recorded, changed, strict=True)]
