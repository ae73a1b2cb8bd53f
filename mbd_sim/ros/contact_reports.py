"""The changes of contacts as events of the node, at a bounded rate."""

from __future__ import annotations

import time
from collections.abc import Callable

from mbd_sim.simulation.events import EventKind
from mbd_sim.simulation.simulation import Simulation

MOST = 20  # reports in each second of real time; further changes are only counted


class ContactReports:
    """Reports what has happened at the contacts of a simulation since the last report."""

    def __init__(self, simulation: Simulation, report: Callable[[EventKind, str], object]) -> None:
        self._simulation, self._report_event = simulation, report
        self._seen = simulation.contact_event_count
        self._second, self._reported, self._omitted = 0, 0, 0

    def report(self) -> None:
        """Report all changes, or count those beyond `MOST` in a second."""
        new = self._simulation.contact_event_count - self._seen
        if new <= 0:
            return
        self._seen += new
        second = int(time.monotonic())
        if second != self._second:
            self._second, self._reported = second, 0
        for event in self._simulation.contact_events[-new:]:
            if self._reported >= MOST:
                self._omitted += 1
                continue
            if self._omitted:
                self._put(f"{self._omitted} further changes before {event.time:.6f} s")
                self._omitted = 0
            self._put(event.text)

    def _put(self, text: str) -> None:
        self._report_event(EventKind.CONTACT, text)
        self._reported += 1
