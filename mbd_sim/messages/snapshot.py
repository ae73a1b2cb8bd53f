"""The state of a run at a tick, from which its messages are written."""

from __future__ import annotations

from dataclasses import dataclass

from mbd_sim.geometry.pose import Array


@dataclass(frozen=True, slots=True)
class Snapshot:
    """The state at a tick.

    `ticks` counts the steps since the node or the recording started, across resets. `clock_ns` is the simulated clock,
    `time` the mechanism's time in s. `y` is the integrated state; `inputs` are the inputs of the equations, efforts
    first. `state` and `clock` say which messages are due; `repeated` says that nothing has changed since the last
    snapshot.
    """

    ticks: int
    clock_ns: int
    time: float
    y: Array
    inputs: Array
    start_energy: float
    state: bool = True
    clock: bool = False
    repeated: bool = False
