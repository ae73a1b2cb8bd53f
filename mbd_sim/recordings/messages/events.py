"""The events and ticks of a run with their times, and the messages that are published with an event or at the start.

The message of a new state holds everything that the run depends on from there, in one labeled array. At which ticks
messages of a rate are due is counted in steps, so that no rate drifts or depends on when it was set.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache

import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.files.urdf.writer import ControlTopics, to_urdf
from mbd_sim.mechanism.contents import channel_names
from mbd_sim.recordings.messages.cdr import string_message
from mbd_sim.recordings.messages.states import Due, Snapshot, labeled_array
from mbd_sim.simulation.model.commands import wrench_labels
from mbd_sim.simulation.model.model import Model
from mbd_sim.simulation.run.events import (
    RESTARTS,
    AppliedCommands,
    AppliedEfforts,
    AppliedWrench,
    ChangedValues,
    Event,
    EventKind,
    Payload,
)
from mbd_sim.simulation.run.run_point import RunPoint
from mbd_sim.simulation.run.simulation import BaseSimulation

HISTORY, SAMPLES = "history", "samples"  # after the live values, in this order, if there are any
LABELS = ("steps", "start_energy", "state", "inputs")  # before those of the live values


def new_state_message(new: RunPoint) -> bytes:
    """The state as a `std_msgs/msg/Float64MultiArray`; live values are labeled with their keys."""
    labels, sizes = [*LABELS, *new.live], [1, 1, len(new.state), len(new.inputs), *[1] * len(new.live)]
    numbers = [new.steps, new.start_energy, *new.state, *new.inputs, *new.live.values()]
    for label, array in ((HISTORY, new.history), (SAMPLES, new.samples)):
        if array.size:
            labels, sizes, numbers = [*labels, label], [*sizes, array.size], [*numbers, *array.ravel()]
    message, values = labeled_array(labels, sizes)
    values[:] = numbers
    return message.payload()


def parse_new_state(
    labels: Sequence[str], values: Array, state_size: int, input_size: int, history_size: int
) -> RunPoint:
    """The state from the labels and the numbers of its message.

    :raises ValueError: they do not fit a state, inputs and a history of these sizes.
    """
    keys = [label for label in labels[len(LABELS) :] if label not in (HISTORY, SAMPLES)]
    kept, width = history_size if HISTORY in labels else 0, 1 + state_size + input_size
    sizes = [1, 1, state_size, input_size, len(keys), kept]
    samples = values[sum(sizes) :]
    if tuple(labels[: len(LABELS)]) != LABELS or len(values) < sum(sizes) or len(samples) % width:
        raise ValueError(f"a new state of {len(values)} numbers does not fit: {sum(sizes)} are needed")
    steps, energy, state, inputs, live, history = np.split(values[: sum(sizes)], np.cumsum(sizes)[:-1])
    by_key = dict(zip(keys, live.tolist(), strict=True))
    return RunPoint(int(steps[0]), state, inputs, float(energy[0]), by_key, samples.reshape(-1, width), history)


EventWriter = Callable[[Event], bytes | None]  # the serialized message of an event; None if it has none


def _array_of(labels: Sequence[str], payload: type[AppliedEfforts | AppliedCommands]) -> EventWriter:
    """The values of one kind of payload, labeled."""
    message, values = labeled_array(labels)

    def write(event: Event) -> bytes | None:
        if not isinstance(event.payload, payload):
            return None
        values[:] = event.payload.values
        return message.payload()

    return write


def applied_efforts(model: Model) -> EventWriter:
    """The efforts that act from the event's step on, labeled with the coordinates."""
    return _array_of(model.coordinate_names, AppliedEfforts)


def no_efforts(model: Model) -> bytes:
    """The efforts that act after a reset: zero."""
    return labeled_array(model.coordinate_names)[0].payload()


def applied_commands(model: Model) -> EventWriter:
    """The commands of actuators that act from the event's step on, labeled with `actuator.channel`."""
    return _array_of(channel_names(model.mechanism.commanded), AppliedCommands)


def start_commands(model: Model) -> bytes:
    """The commands of actuators that act after a reset."""
    message, values = labeled_array(channel_names(model.mechanism.commanded))
    values[:] = model.inputs[model.input_layout.commands]
    return message.payload()


def applied_wrenches(model: Model) -> EventWriter:
    """The wrench on one part that acts from the event's step on, labeled with the part."""
    arrays = {part: labeled_array(wrench_labels(part)) for part in model.input_layout.loaded}

    def write(event: Event) -> bytes | None:
        if not isinstance(event.payload, AppliedWrench):
            return None
        message, values = arrays[event.payload.part]
        values[:] = event.payload.inputs
        return message.payload()

    return write


def live_values(model: Model) -> EventWriter:
    """All live values after a change, labeled with their keys."""

    def write(event: Event) -> bytes | None:
        if not isinstance(event.payload, ChangedValues) or event.payload.all_values is None:
            return None
        return live_values_at_start(model, event.payload.all_values)

    return write


def new_states(model: Model) -> EventWriter:
    """The state from which the run continues."""
    return lambda event: new_state_message(event.payload) if isinstance(event.payload, RunPoint) else None


def event_texts(model: Model) -> EventWriter:
    """The text of an event; commands have none, as their numbers are published."""
    return lambda event: None if event.kind is EventKind.COMMAND else string_message(event.text)


def live_values_at_start(model: Model, live: Mapping[str, float]) -> bytes:
    """All live values, labeled with their keys."""
    message, values = labeled_array(list(live))
    values[:] = list(live.values())
    return message.payload()


def robot_description(model: Model, live: Mapping[str, float], control: ControlTopics | None = None) -> bytes:
    """The mechanism's spanning tree as URDF, with a block for ros2_control if its topics are given."""
    return string_message(to_urdf(model.mechanism, control))


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

    def __init__(self, simulation: BaseSimulation, first_tick: int = 0) -> None:
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


_TOLERANCE = 1_000_000  # a message is due up to this fraction of a step early, for rates and steps that are rounded


@dataclass(frozen=True)
class PublicationSchedule:
    """Message k of a rate r (Hz) is due at the first step at or after the time k / r; tick 0 has message 0.

    `each_tick` is the number of messages for each step, at most 1. With 333 Hz and steps of 1 ms, messages are due
    after 4, 7, 10, 13 … steps: 333 in each second.
    """

    each_tick: Fraction

    def is_due(self, tick: int) -> bool:
        """Whether a message is due after this number of steps."""
        return self._count(tick) > self._count(tick - 1)

    def next_tick(self, tick: int) -> int:
        """The number of steps after which the next message is due, greater than `tick`."""
        p, q = self.each_tick.numerator, self.each_tick.denominator
        number = self._count(tick) + 1
        return -((p - number * q * _TOLERANCE) // (p * _TOLERANCE))

    def _count(self, tick: int) -> int:
        """How many messages after the first are due up to this tick."""
        p, q = self.each_tick.numerator, self.each_tick.denominator
        return (p * (tick * _TOLERANCE + 1)) // (q * _TOLERANCE)


@lru_cache(maxsize=64)
def publication_schedule(rate: float, step_size: float) -> PublicationSchedule | None:
    """The schedule of a rate (Hz) for steps of `step_size` (s); None for rate 0, which is never due."""
    if not rate > 0.0:
        return None
    # Decimal digits give the numbers that the user wrote: the float 0.001 is a little more than a thousandth.
    return PublicationSchedule(min(Fraction(repr(float(rate))) * Fraction(repr(float(step_size))), Fraction(1)))


def attained_rate(rate: float, step_size: float) -> float:
    """The messages per second (Hz) at a rate asked: at most one for each step of `step_size` (s)."""
    return min(rate, 1.0 / step_size)


def rate_remark(name: str, rate: float, step_size: float) -> str:
    """A sentence if a rate (Hz) exceeds one message for each step of `step_size` (s), or ""."""
    attained = attained_rate(rate, step_size)
    if attained * (1.0 + 1e-9) >= rate:
        return ""
    return (
        f"{name} is {rate:g} Hz, but the state changes only with each step of {step_size:g} s: "
        f"messages are sent at {attained:g} Hz. Lower {name}, or choose a smaller step."
    )
