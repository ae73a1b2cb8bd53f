"""What the stepping thread hands to the publishing thread: snapshots, records and events, with the node's clock.

Changes of contacts become events of the node at a bounded rate.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from queue import SimpleQueue
from typing import Protocol

from mbd_sim.recordings.messages.events import Journal
from mbd_sim.recordings.messages.states import Due, Snapshot
from mbd_sim.ros.stepping.clock import Rates
from mbd_sim.simulation.run.events import Event, EventKind, Payload
from mbd_sim.simulation.run.simulation import BaseSimulation

Item = Snapshot | Event | None  # None ends the output


@dataclass
class Counters:
    """The stepping thread's counters: seconds spent in stepping, and snapshots that were dropped."""

    stepping: float = 0.0
    dropped: int = 0


MOST = 20  # changes of contacts to report in each second of real time; further ones are only counted


class ContactReports:
    """Which changes of contacts are reported, and how many were left out before."""

    def __init__(self) -> None:
        self._second, self._reported, self._omitted = 0, 0, 0

    def admitted(self, text: str) -> list[str]:
        """What to report of a change: nothing beyond `MOST` in a second; the number left out precedes the next one."""
        if (second := int(time.monotonic())) != self._second:
            self._second, self._reported = second, 0
        if self._reported >= MOST:
            self._omitted += 1
            return []
        texts = [f"{self._omitted} further changes", text] if self._omitted else [text]
        self._reported, self._omitted = self._reported + len(texts), 0
        return texts


class OutputWatch(Protocol):
    """What watches the run between steps."""

    def most_steps(self, steps: int) -> int:
        """These steps, or fewer, to take until it must be told."""

    def passed(self, steps: int) -> None:
        """Take that some more steps have been taken."""

    def notice(self, kind: EventKind, payload: Payload) -> None:
        """Take an event of the run."""


MAX_WAITING = 10_000  # snapshots that may wait at all; when publishing is that slow, further ones are dropped


class SteppingOutput:
    """The queue of snapshots and events; while it is `silent`, states and those that recordings wait for are held.

    It is the `RunListener` of the simulation, so that each change of the run becomes an event.
    """

    def __init__(self, simulation: BaseSimulation, *, silent: bool = False) -> None:
        self.queue: SimpleQueue[Item] = SimpleQueue()
        self.counters = Counters()
        self.last_emitted = -1  # the tick of the last state
        self.newest: Snapshot | None = None  # with a state
        self._simulation, self.journal = simulation, Journal(simulation)
        self._clock = self.journal.clock
        self._last_viewed = -1  # the tick of the last sample for the viewer
        self._emitted_at = 0.0  # s of the steady clock
        self._silent, self._held_moments = silent, 0
        self.shown, self.shows = self.journal.snapshot(), False  # the state for pages; whether they want a newer one
        self._contacts = ContactReports()
        self.watch: OutputWatch | None = None

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
        snapshot = self.journal.snapshot(due, repeated, time.perf_counter() if in_real_time else math.inf)
        if Due.STATE in due:
            self.newest = self.shown = snapshot
        self.queue.put(snapshot)

    def show(self) -> None:
        """Keep the present state for pages, if they want a newer one."""
        if self.shows:
            self.shown, self.shows = self.journal.snapshot(), False

    def parts_of(self, steps: int) -> Iterator[int]:
        """All steps at once, or in parts after which the watch is told; the clock goes on. See `RunListener`."""
        while self.watch is not None and steps > 0:
            part = self.watch.most_steps(steps)
            yield part
            self.journal.count_steps()
            steps -= part
            self.watch.passed(part)
        if steps > 0:
            yield steps
        self.journal.count_steps()

    def report(self, kind: EventKind, payload: Payload = None) -> Event:
        """Put an event into the queue, and return it; changes of contacts are put there at a bounded rate."""
        event = self.journal.event(kind, payload)
        if kind is EventKind.CONTACT:
            for text in self._contacts.admitted(str(payload)):
                self.queue.put(replace(event, payload=text))
        else:
            self.queue.put(event)
        if self.watch is not None:
            self.watch.notice(kind, payload)
        return event

    def put_moment(self) -> None:
        """Put the present state, for a recording, into the queue, or as soon as the output is no longer silent."""
        if self._silent:
            self._held_moments += 1
        else:
            self.queue.put(self.journal.snapshot(Due.RECORDING))

    def begin(self) -> None:
        """End the silence."""
        self._silent = False
        for _ in range(self._held_moments):
            self.queue.put(self.journal.snapshot(Due.RECORDING))
        self._held_moments = 0
