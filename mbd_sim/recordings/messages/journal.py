"""The states and events of a run with their ticks and times, for a recorder in a script and for the node."""

from __future__ import annotations

import math
from dataclasses import dataclass

from mbd_sim.recordings.messages.states import Due, Snapshot
from mbd_sim.simulation.run.events import RESTARTS, Event, EventKind, Payload
from mbd_sim.simulation.run.simulation import Simulation


@dataclass
class RunClock:
    """The simulated clock of a run: `ticks` are its steps of `step_ns` ns across resets, of which 0 is at `zero_ns`."""

    step_ns: int
    ticks: int = 0
    zero_ns: int = 0

    @property
    def ns(self) -> int:
        """The time in ns; it goes back only when a reset asks for it, or a followed clock does."""
        return self.zero_ns + self.ticks * self.step_ns

    @property
    def whole_steps(self) -> int:
        """The whole steps since the clock was zero."""
        return self.ns // self.step_ns

    def set(self, time_ns: int) -> None:
        """Set the clock to a time in ns."""
        self.zero_ns = time_ns - self.ticks * self.step_ns


class Journal:
    """Stamps the states and events of a simulation with ticks, which count its steps across resets."""

    def __init__(self, simulation: Simulation, first_tick: int = 0) -> None:
        self.clock = RunClock(round(simulation.step_size * 1e9), first_tick)
        self._simulation, self._steps = simulation, simulation.steps

    def count_steps(self) -> None:
        """Follow the steps that the simulation has taken."""
        self.clock.ticks += self._simulation.steps - self._steps
        self._steps = self._simulation.steps

    def event(self, kind: EventKind, payload: Payload = None) -> Event:
        """An event that happens now; after a restart, ticks count on from here."""
        if kind in RESTARTS:
            self._steps = self._simulation.steps
        self.count_steps()
        return Event(kind, payload, self.clock.ticks, self.clock.ns)

    def snapshot(self, due: Due = Due.STATE, repeated: bool = False, taken: float = math.inf) -> Snapshot:
        """The present state, for what is due."""
        simulation, clock = self._simulation, self.clock
        arrivals = simulation.arrivals if Due.SENSORS in due else ()
        return Snapshot(clock.ticks, clock.ns, simulation.time, simulation.snapshot(), due, repeated, arrivals, taken)
