"""The events of a run: commands, pauses, resets, changed values, warnings, failures.

The node publishes and records the text of each event (`~/events`); programs work with its kind and payload.
`parse_event` reads a recorded text back. A listener follows the events of a simulation.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol

from mbd_sim.base.errors import InputError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.simulation.kernel.memory import AT_ONCE, KernelMemory
from mbd_sim.simulation.run.run_point import RunPoint


class EventKind(StrEnum):
    """The kinds of events; the text of an event begins with these words."""

    COMMAND = "command"  # new efforts, or a new wrench, act from this step on
    EXPIRED = "commands expired"  # no command within the timeout
    PAUSED = "paused"
    RUNNING = "running"
    RESET = "reset"  # back to the start state, or to the given one at time zero
    NEW_STATE = "new state"  # the run continues from a given state
    CLOCK_RESET = "clock set to zero"  # the state stays as it is
    CLOCK_SET = "clock set"  # to the time of a clock that the node follows; the state stays as it is
    LIVE_VALUES = "live values"
    CONTACT = "contact"  # a contact has closed, opened, begun to stick or to slide, or there was an impact
    WARNING = "warning"
    DIVERGED = "diverged"  # the motion became infinite; the simulation is paused
    FAILED = "failed"  # an error of the program; the simulation is paused until a reset
    NOTE = "note"  # any other text, such as one from a user of the viewer


RESTARTS = frozenset({EventKind.RESET, EventKind.NEW_STATE})  # after which the motion is another one
ERRORS = frozenset({EventKind.DIVERGED, EventKind.FAILED})
_WITH_MESSAGE = frozenset({EventKind.CLOCK_SET, EventKind.CONTACT, EventKind.WARNING, *ERRORS})
_WITHOUT_PAYLOAD = frozenset(
    {
        EventKind.COMMAND,
        EventKind.PAUSED,
        EventKind.RUNNING,
        EventKind.RESET,
        EventKind.NEW_STATE,
        EventKind.CLOCK_RESET,
    }
)


@dataclass(frozen=True, eq=False, slots=True)
class AppliedEfforts:
    """The efforts (nv,) in N and N·m that act from the event's step on; None where only its text was recorded.

    `expired` are the coordinates whose efforts were set to zero, where commands expired; empty: all of them.
    """

    values: Array | None = None
    expired: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False, slots=True)
class AppliedCommands:
    """The commands (n,) of all actuators that act from the event's step on, in the order of `CommandMap.names`."""

    values: Array


@dataclass(frozen=True, eq=False, slots=True)
class AppliedWrench:
    """The wrench on a part from the event's step on, as its part of the inputs of the equations, see `InputLayout`.

    `inputs` is None where only the event's text was recorded.
    """

    part: str
    inputs: Array | None = None


@dataclass(frozen=True, slots=True)
class ChangedValues:
    """Live values by key, in SI units: those that changed, and all of them where they are known."""

    changes: Mapping[str, float]
    all_values: Mapping[str, float] | None = None


# A point is the state from which the run continues; a string is a message for people.
Payload = AppliedEfforts | AppliedCommands | AppliedWrench | ChangedValues | RunPoint | str | None


@dataclass(frozen=True, eq=False, slots=True)
class Event:
    """Something that happened between two steps.

    `ticks` counts the steps since the node started; `clock_ns` is the node's simulated clock.
    """

    kind: EventKind
    payload: Payload = None
    ticks: int = 0
    clock_ns: int = 0

    @property
    def text(self) -> str:
        """The event for people, on one line."""
        match self.kind, self.payload:
            case EventKind.NOTE, str(message):
                return message
            case EventKind.EXPIRED, AppliedEfforts(_, expired):
                return f"{self.kind}: effort of {', '.join(expired)} set to zero" if expired else _ALL_EXPIRED
            case EventKind.EXPIRED, AppliedWrench(part):
                return f"{self.kind}: wrench on {part} set to zero"
            case EventKind.LIVE_VALUES, ChangedValues(changes):
                return f"{self.kind}: " + ", ".join(f"{key} = {value!r}" for key, value in changes.items())
            case _, str(message):
                return f"{self.kind}: {message}"
        return str(self.kind)


_KINDS = {kind.value: kind for kind in EventKind}
_NUMBER = r"[-+]?(?:\d[\d.]*(?:e[-+]?\d+)?|inf|nan)"
_CHANGE = re.compile(rf"(\S.*?) = ({_NUMBER})(?:, |$)")
_ALL_EXPIRED = f"{EventKind.EXPIRED}: efforts set to zero"
_EXPIRED_EFFORTS = re.compile(r"effort of (.+) set to zero")
_EXPIRED_WRENCH = re.compile(r"wrench on (.+) set to zero")


def parse_event(text: str, ticks: int = 0, clock_ns: int = 0) -> Event:
    """The event with a recorded text, in the wording of any version; a text that is none of them is a `NOTE`.

    `parse_event(event.text).text` is `event.text`.
    """
    kind, payload = _parse(text)
    return Event(kind, payload, ticks, clock_ns)


def _parse(text: str) -> tuple[EventKind, Payload]:
    head, colon, message = text.partition(": ")
    kind = _KINDS.get(head, EventKind.NOTE)
    if not colon and kind in _WITHOUT_PAYLOAD:
        return kind, None
    if colon and kind in _WITH_MESSAGE:
        return kind, message
    if kind is EventKind.EXPIRED:
        if text == _ALL_EXPIRED:
            return kind, AppliedEfforts()
        if found := _EXPIRED_EFFORTS.fullmatch(message):
            return kind, AppliedEfforts(None, tuple(found[1].split(", ")))
        if found := _EXPIRED_WRENCH.fullmatch(message):
            return kind, AppliedWrench(found[1])
    if kind is EventKind.LIVE_VALUES and (changes := _parse_changes(message)):
        return kind, ChangedValues(changes)
    return EventKind.NOTE, text


def _parse_changes(text: str) -> dict[str, float]:
    """Changed values by key; none where the text is not a list of them."""
    changes: dict[str, float] = {}
    position = 0
    while position < len(text):
        if (found := _CHANGE.match(text, position)) is None:
            return {}
        changes[found[1]] = float(found[2])
        position = found.end()
    return changes


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
    """The `listener` of a run, if there is one."""

    def __init__(self, memory: KernelMemory) -> None:
        self.listener: RunListener | None = None
        self._memory, self._contacts_seen = memory, 0

    def listen(self, listener: RunListener | None) -> None:
        """Report to a listener from here on; see `Simulation.listen`."""
        if listener is not None and self.listener is not None:
            raise InputError("this simulation is being recorded already", "Close the other recording first.")
        self.listener, self._contacts_seen = listener, self._memory.contact_count
        self._memory.leave_to_python(listener is not None)

    def parts_of(self, steps: int) -> Iterator[int] | Sequence[int]:
        """Steps in the parts that the listener wants; Ctrl-C is noticed between parts."""
        if self.listener is not None:
            return self.listener.parts_of(steps)
        return (steps,) if steps <= AT_ONCE else (min(AT_ONCE, steps - done) for done in range(0, steps, AT_ONCE))

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
        self._memory.require_rest()
        repeated = self.listener is None or inputs.tobytes() == new.tobytes()
        inputs[:] = new
        if not repeated:
            self.report(kind, payload)
