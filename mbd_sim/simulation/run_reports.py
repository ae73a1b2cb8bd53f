"""What a simulation reports while its run is recorded."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mbd_sim.geometry.pose import Array
from mbd_sim.simulation.events import (
    AppliedCommands,
    AppliedEfforts,
    AppliedWrench,
    ChangedValues,
    EventKind,
    NewState,
    Payload,
)
from mbd_sim.simulation.sensor_readings import SensorReadings


class RunListener(Protocol):
    """Follows a simulation; all methods are called between two steps."""

    def parts_of(self, steps: int) -> Iterator[int]:
        """Divide steps into parts, each of which is taken before the next is requested."""
        ...

    def report(self, kind: EventKind, payload: Payload = None) -> None:
        """Follow a command that changes an input, a changed value, a reset or a new state, which acts from here on."""
        ...


class RunReports(SensorReadings):
    """The part of a simulation that reports to a listener, if there is one."""

    _listener: RunListener | None = None
    _contacts_seen: int = 0

    @cached_property
    def _unobserved(self) -> NDArray[np.int64]:
        """(1,), for compiled code: 1 without a listener, 0 with one."""
        return np.ones(1, dtype=np.int64)

    @property
    def _contact_count(self) -> int:
        contacts = self._memory.contacts
        return 0 if contacts is None else contacts.count

    def _report_contacts(self) -> None:
        """Report what has happened at contacts since the last report."""
        if self._listener is not None and self._memory.contacts is not None:
            new, self._contacts_seen = self._contact_count - self._contacts_seen, self._contact_count
            for event in list(self._memory.contacts.events)[-new:] if new > 0 else ():
                self._listener.report(EventKind.CONTACT, event.text)

    def _report(self, kind: EventKind, payload: Payload) -> None:
        if self._listener is not None:
            self._listener.report(kind, payload)

    def _is_repeated(self, inputs: Array, command: Array) -> bool:
        """Whether a command changes no bit of the inputs in effect, and so is not reported, as in a node."""
        return self._listener is None or inputs.tobytes() == command.tobytes()

    def _report_efforts(self, efforts: Array) -> None:
        self._report(EventKind.COMMAND, AppliedEfforts(efforts.copy()))

    def _report_commands(self, values: Array) -> None:
        self._report(EventKind.COMMAND, AppliedCommands(values.copy()))

    def _report_wrench(self, part: str, inputs: Array) -> None:
        self._report(EventKind.COMMAND, AppliedWrench(part, inputs))

    def _report_live_values(self, changes: Mapping[str, float]) -> None:
        self._report(EventKind.LIVE_VALUES, ChangedValues(changes, dict(self._live.current)))

    def _report_reset(self, *, to_start: bool) -> None:
        if to_start:
            self._report(EventKind.RESET, None)
        else:
            self._report_new_state()

    def _report_new_state(self) -> None:
        if self._listener is not None:
            memory, live = self._memory, dict(self._live.current)
            rest = self.start_energy, live, self.samples, self.history
            new = NewState(memory.steps, memory.y.copy(), memory.inputs.copy(), *rest)
            self._report(EventKind.NEW_STATE, new)
