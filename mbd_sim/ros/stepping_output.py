"""What the stepping thread hands to the publishing thread: snapshots and events, with the node's clock."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from queue import SimpleQueue

from mbd_sim.messages.snapshot import Due, Snapshot
from mbd_sim.recording.run_metadata import Moment
from mbd_sim.ros.contact_reports import ContactReports
from mbd_sim.ros.rates import Rates
from mbd_sim.ros.snapshots import Counters, Item
from mbd_sim.simulation.events import Event, EventKind, Payload
from mbd_sim.simulation.simulation import Simulation

MAX_WAITING = 10_000  # snapshots that may wait at all; when publishing is that slow, further ones are dropped


@dataclass
class NodeClock:
    """The simulated clock of a node: `ticks` are the steps of `step_ns` ns since the node started, at `zero_ns` ns."""

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


class SteppingOutput:
    """The queue of snapshots, events and moments; while it is `silent`, states and moments wait."""

    def __init__(self, simulation: Simulation, clock: NodeClock, *, silent: bool = False) -> None:
        self.queue: SimpleQueue[Item] = SimpleQueue()
        self.counters = Counters()
        self.last_emitted = -1  # the tick of the last state
        self.newest: Snapshot | None = None  # with a state
        self._simulation, self._clock = simulation, clock
        self._last_viewed = -1  # the tick of the last sample for the viewer
        self._emitted_at = 0.0  # s of the steady clock
        self._silent, self._held_moments = silent, 0
        self._contacts = ContactReports(simulation, self.report)

    @property
    def silence(self) -> float:
        """The time since the last state in s."""
        return time.perf_counter() - self._emitted_at

    def due(self, rates: Rates) -> Due:
        """What is due at the present tick."""
        simulation = self._simulation
        due = rates.due(self._clock.whole_steps, simulation.step_size)
        return due | Due.SENSORS if simulation.arrivals else due

    def steps_until_due(self, rates: Rates, *, at_most: int) -> int:
        """The steps to the next tick at which something is due, or fewer."""
        simulation = self._simulation
        steps = simulation.steps_to_arrival(at_most)
        return rates.steps_until_due(self._clock.whole_steps, simulation.step_size, at_most=steps)

    def emit(self, due: Due, repeated: bool = False, *, in_real_time: bool = False) -> None:
        """Put the present state into the queue, or count it as dropped if the queue is too long.

        :param in_real_time: whether the state may be left out if it is published late.
        """
        if self._silent:
            return
        if self.queue.qsize() >= MAX_WAITING:
            self.counters.dropped += 1
            return
        if repeated and self._last_viewed == self._clock.ticks:
            due &= ~Due.VIEW
        if Due.STATE in due:
            self.last_emitted, self._emitted_at = self._clock.ticks, time.perf_counter()
        if Due.VIEW in due:
            self._last_viewed = self._clock.ticks
        snapshot = self.snapshot(due, repeated, time.perf_counter() if in_real_time else math.inf)
        if Due.STATE in due:
            self.newest = snapshot
        self.queue.put(snapshot)

    def snapshot(self, due: Due, repeated: bool = False, taken: float = math.inf) -> Snapshot:
        """The present state."""
        simulation = self._simulation
        return Snapshot(
            ticks=self._clock.ticks,
            clock_ns=self._clock.ns,
            time=simulation.time,
            y=simulation.state,
            inputs=simulation.inputs.copy(),
            start_energy=simulation.start_energy,
            due=due,
            repeated=repeated,
            arrivals=simulation.arrivals if Due.SENSORS in due else (),
            live=simulation.live,
            taken=taken,
        )

    def report(self, kind: EventKind, payload: Payload = None) -> Event:
        """Put an event into the queue."""
        event = Event(kind, payload, self._clock.ticks, self._clock.ns)
        self.queue.put(event)
        return event

    def report_contacts(self) -> None:
        """Put what has happened at contacts since the last call into the queue, at a bounded rate."""
        self._contacts.report()

    def report_new_state(self) -> None:
        """Put the state into the queue as one from which the run continues."""
        self.report(EventKind.NEW_STATE, self._simulation.snapshot())

    def moment(self) -> Moment:
        """Everything that determines the motion from here on."""
        return Moment.of(self._simulation, self._clock.ticks, self._clock.ns)

    def put_moment(self) -> None:
        """Put the present moment into the queue, or as soon as the output is no longer silent."""
        if self._silent:
            self._held_moments += 1
        else:
            self.queue.put(self.moment())

    def begin(self) -> None:
        """End the silence."""
        self._silent = False
        for _ in range(self._held_moments):
            self.queue.put(self.moment())
        self._held_moments = 0
