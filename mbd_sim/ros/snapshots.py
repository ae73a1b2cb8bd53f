"""What the stepping thread hands out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from mbd_sim.geometry.pose import Array
from mbd_sim.recording.run_metadata import Moment


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


@dataclass(frozen=True, slots=True)
class Event:
    """Something that happened between two steps, and what took effect: efforts, a part's wrench, live values.

    A wrench is given by its numbers among the inputs of the equations, see `InputLayout`.
    """

    ticks: int
    clock_ns: int
    time: float
    text: str
    efforts: Array | None = None
    wrench: tuple[str, Array] | None = None
    live: Mapping[str, float] | None = None


Item = Snapshot | Event | Moment | None  # what the stepping thread hands out; None ends it


@dataclass
class Counters:
    """Where the time of the stepping thread goes: seconds of stepping, and snapshots that were dropped."""

    stepping: float = 0.0
    dropped: int = 0
