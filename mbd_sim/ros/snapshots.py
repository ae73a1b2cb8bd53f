"""The records that the stepping thread passes to the publishing thread."""

from __future__ import annotations

from dataclasses import dataclass

from mbd_sim.messages.snapshot import Snapshot
from mbd_sim.simulation.events import Event

Item = Snapshot | Event | None  # None ends the output


@dataclass
class Counters:
    """The stepping thread's counters: seconds spent in stepping, and snapshots that were dropped."""

    stepping: float = 0.0
    dropped: int = 0
