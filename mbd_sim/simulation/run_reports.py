"""What a simulation reports while its run is recorded."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Protocol

import numpy as np

from mbd_sim.errors import InputError
from mbd_sim.geometry.pose import Array
from mbd_sim.simulation.events import EventKind, Payload
from mbd_sim.simulation.kernel_memory import KernelMemory


class RunListener(Protocol):
    """Follows a simulation; all methods are called between two steps."""

    def parts_of(self, steps: int) -> Iterator[int]:
        """Divide steps into parts, each of which is taken before the next is requested."""
        ...

    def report(self, kind: EventKind, payload: Payload = None) -> None:
        """Follow a command that changes an input, a changed value, a reset or a new state, which acts from here on."""
        ...


class RunReports:
    """The `listener` of a run, if there is one; `unobserved` (1,) says for compiled code: 1 without a listener."""

    def __init__(self, memory: KernelMemory) -> None:
        self.listener: RunListener | None = None
        self.unobserved = np.ones(1, dtype=np.int64)
        self._memory, self._contacts_seen = memory, 0

    def listen(self, listener: RunListener | None) -> None:
        """Report to a listener from here on; see `Simulation.listen`."""
        if listener is not None and self.listener is not None:
            raise InputError("this simulation is being recorded already", "Close the other recording first.")
        self.listener, self._contacts_seen = listener, self._memory.contact_count
        self.unobserved[0] = listener is None

    def parts_of(self, steps: int) -> Iterator[int] | Sequence[int]:
        """Steps in the parts that the listener wants."""
        return (steps,) if self.listener is None else self.listener.parts_of(steps)

    def contacts(self) -> None:
        """Report what has happened at contacts since the last report."""
        contacts = self._memory.contacts
        if self.listener is not None and contacts is not None:
            new, self._contacts_seen = contacts.count - self._contacts_seen, contacts.count
            for event in list(contacts.events)[-new:] if new > 0 else ():
                self.listener.report(EventKind.CONTACT, event.text)

    def report(self, kind: EventKind, payload: Payload = None) -> None:
        """Report an event."""
        if self.listener is not None:
            self.listener.report(kind, payload)

    def replace(self, inputs: Array, new: Array, payload: Payload) -> None:
        """Replace inputs in place; a command that changes no bit of them is not reported."""
        repeated = self.listener is None or inputs.tobytes() == new.tobytes()
        inputs[:] = new
        if not repeated:
            self.report(EventKind.COMMAND, payload)
