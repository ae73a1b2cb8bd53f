"""The records that the stepping thread passes to the publishing thread."""

from __future__ import annotations

from dataclasses import dataclass

from mbd_sim.geometry.pose import Array
from mbd_sim.recording.run_metadata import Moment
from mbd_sim.simulation.events import Event


@dataclass(frozen=True, slots=True)
class Snapshot:
    """The state at a tick.

    `ticks` counts the steps since the node started, across resets. `clock_ns` is the node's simulated clock, `time`
    the mechanism's time in s. `y` is the integrated state; `inputs` are the inputs of the equations, efforts first.
    `state` and `clock` say which messages are due; `repeated` says that nothing has changed since the last snapshot.
    """

    ticks: int
    clock_ns: int
    time: float
    y: Array
    inputs: Array
    start_energy: float
    state: bool
    clock: bool
    repeated: bool


Item = Snapshot | Event | Moment | None  # None ends the output


@dataclass
class Counters:
    """The stepping thread's counters: seconds spent in stepping, and snapshots that were dropped."""

    stepping: float = 0.0
    dropped: int = 0
