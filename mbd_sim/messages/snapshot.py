"""The state of a run at a tick, from which its messages are written."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Flag, auto

from mbd_sim.simulation.sensor_samples import Arrival
from mbd_sim.simulation.snapshot import RunPoint


class Due(Flag):
    """The messages that are due with a snapshot."""

    NONE = 0
    STATE = auto()
    CLOCK = auto()
    MARKERS = auto()
    VIEW = auto()  # the Rerun scene
    SENSORS = auto()
    RECORDING = auto()  # a recording begins, continues in another file, or ends here
    ALL = STATE | CLOCK | MARKERS | VIEW
    NEW = ALL | SENSORS  # of a state that has not been measured before


@dataclass(frozen=True, slots=True)
class Snapshot:
    """The `point` of a run at a tick.

    `ticks` counts the steps since the node or the recording started, across resets. `clock_ns` is the simulated clock,
    `time` the mechanism's time in s. `repeated` says that nothing has changed since the last snapshot.
    `arrivals` are measurements of sensors that arrive at this tick. `taken` is the time in s of the steady clock, where
    a state that is published late may be left out for a newer one; infinite, where all are published.
    """

    ticks: int
    clock_ns: int
    time: float
    point: RunPoint
    due: Due = Due.STATE
    repeated: bool = False
    arrivals: Sequence[Arrival] = ()
    taken: float = math.inf
