"""What the stepping thread hands out."""

from __future__ import annotations

from dataclasses import dataclass

from mbd_sim.geometry.pose import Array
from mbd_sim.recording.run_metadata import Moment
from mbd_sim.simulation.events import Event


@dataclass(frozen=True, slots=True)
class Snapshot:
    """The state at a tick. `clock_ns` is the node's simulated clock, `time` that of the mechanism in s.

    `inputs` are those of the equations, the efforts first. `ticks` counts the steps since the node started, over all
    resets. `state` and `clock` say what is due, and `repeated` that nothing has changed since the last snapshot.
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


Item = Snapshot | Event | Moment | None  # what the stepping thread hands out; None ends it


@dataclass
class Counters:
    """Where the time of the stepping thread goes: seconds of stepping, and snapshots that were dropped."""

    stepping: float = 0.0
    dropped: int = 0
