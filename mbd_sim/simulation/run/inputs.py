"""What a simulation exchanges with its caller: inputs from the next step on, and reports of a recorded run.

The inputs written here are efforts, wrenches and commands of actuators and drives. `Simulation.apply_live` writes live
values.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.errors import InputError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.simulation.kernel.memory import KernelMemory
from mbd_sim.simulation.model.commands import CommandMap, EffortMap, Efforts, WrenchMap
from mbd_sim.simulation.model.model import Model
from mbd_sim.simulation.run.arguments import ReadOnlyView
from mbd_sim.simulation.run.events import AppliedCommands, AppliedEfforts, AppliedWrench, EventKind, Payload


class RunListener(Protocol):
    """Follows a simulation; all methods are called between two steps."""

    def parts_of(self, steps: int) -> Iterator[int]:
        """Divide steps into parts, each of which is taken before the next is requested."""
        ...

    def report(self, kind: EventKind, payload: Payload = None) -> object:
        """Follow what acts from here on: a command that changes an input, a changed value, a reset, a new state.

        Changes of contacts are reported when the part of the steps has been taken in which they happened.
        """
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

    def report_contacts(self) -> None:
        """Report what has happened at contacts since the last report."""
        stepper = self._memory.stepper
        if self.listener is not None and stepper is not None:
            new, self._contacts_seen = stepper.count - self._contacts_seen, stepper.count
            for event in list(stepper.events)[-new:] if new > 0 else ():
                self.listener.report(EventKind.CONTACT, event.text)

    def report(self, kind: EventKind, payload: Payload = None) -> None:
        """Report an event."""
        if self.listener is not None:
            self.listener.report(kind, payload)

    def replace(self, inputs: Array, new: Array, payload: Payload, kind: EventKind = EventKind.COMMAND) -> None:
        """Replace inputs in place; a command that changes no bit of them is not reported."""
        repeated = self.listener is None or inputs.tobytes() == new.tobytes()
        inputs[:] = new
        if not repeated:
            self.report(kind, payload)


EffortWriter = Callable[[Efforts], None]


class RunInputs:
    """Writes the inputs of a kernel, and reports what changes them; `efforts`, `commands` and `values` are views."""

    def __init__(
        self, model: Model, mechanism: Mechanism, memory: KernelMemory, effort_map: EffortMap, reports: RunReports
    ) -> None:
        layout = model.input_layout
        self.all = memory.inputs
        self.efforts, self.commands, self.values = (
            memory.inputs[place] for place in (layout.efforts, layout.commands, layout.values)
        )
        self.wrench_map = WrenchMap(mechanism, layout)
        self.command_map = CommandMap(mechanism.commanded, layout)
        self.effort_map, self._reports = effort_map, reports

    def effort_writer(self, fallback: EffortWriter, signature: str) -> EffortWriter:
        """Compiled code that does without a listener what `set_efforts` does, and calls `fallback` if it cannot."""
        return effort_writer(self.efforts, self.effort_map, self._reports.unobserved, fallback, signature)

    def set_efforts(self, efforts: Efforts) -> None:
        """See `Simulation.set_efforts`."""
        new = self.effort_map.clamped(self.effort_map.merged(self.efforts, efforts))
        self._reports.replace(self.efforts, new, AppliedEfforts(new))

    def expire_efforts(self, names: Sequence[str]) -> None:
        """See `Simulation.expire_efforts`."""
        new = self.effort_map.merged(self.efforts, dict.fromkeys(names, 0.0))
        self._reports.replace(self.efforts, new, AppliedEfforts(new, tuple(names)), EventKind.EXPIRED)

    def set_wrench(self, part: str, numbers: Array, kind: EventKind = EventKind.COMMAND) -> None:
        """Apply the inputs (15,) of a wrench: see `WrenchMap.numbers`."""
        self._reports.replace(self.all[self.wrench_map.slices[part]], numbers, AppliedWrench(part, numbers), kind)

    def set_commands(self, values: Array) -> None:
        """Command all channels (n,), in the order of `command_map.names`."""
        self._reports.replace(self.commands, values, AppliedCommands(values.copy()))


def effort_writer(
    target: Array, efforts: EffortMap, unobserved: NDArray[np.int64], fallback: EffortWriter, signature: str
) -> EffortWriter:
    """Compiled code that writes efforts (nv,) within their limits to a target, and calls `fallback` if it cannot.

    :param unobserved: (1,) where this is 0, it always calls `fallback`.
    :param signature: for error messages.
    """
    from mbd_sim.compiler.python.bounded_write import bounded_writer

    return bounded_writer(target, efforts.limits, unobserved, fallback, signature, ReadOnlyView)
