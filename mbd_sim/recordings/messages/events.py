"""The messages that are published with an event, and those that are published once at the start.

The message of a new state holds everything that the run depends on from there, in one labeled array.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.files.urdf.writer import ControlTopics, to_urdf
from mbd_sim.mechanism.contents import channel_names
from mbd_sim.recordings.messages.cdr import string_message
from mbd_sim.recordings.messages.states import labeled_array
from mbd_sim.simulation.model.commands import wrench_labels
from mbd_sim.simulation.model.model import Model
from mbd_sim.simulation.run.events import (
    AppliedCommands,
    AppliedEfforts,
    AppliedWrench,
    ChangedValues,
    Event,
    EventKind,
)
from mbd_sim.simulation.run.state import RunPoint

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


def applied_efforts(model: Model) -> EventWriter:
    """The efforts that act from the event's step on, labeled with the coordinates."""
    message, values = labeled_array(model.coordinate_names)

    def write(event: Event) -> bytes | None:
        if not isinstance(event.payload, AppliedEfforts):
            return None
        values[:] = event.payload.values
        return message.payload()

    return write


def no_efforts(model: Model) -> bytes:
    """The efforts that act after a reset: zero."""
    return labeled_array(model.coordinate_names)[0].payload()


def applied_commands(model: Model) -> EventWriter:
    """The commands of actuators that act from the event's step on, labeled with `actuator.channel`."""
    message, values = labeled_array(channel_names(model.mechanism.commanded))

    def write(event: Event) -> bytes | None:
        if not isinstance(event.payload, AppliedCommands):
            return None
        values[:] = event.payload.values
        return message.payload()

    return write


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

    def write(event: Event) -> bytes | None:
        return new_state_message(event.payload) if isinstance(event.payload, RunPoint) else None

    return write


def event_texts(model: Model) -> EventWriter:
    """The text of an event; commands have none, as their numbers are published."""

    def write(event: Event) -> bytes | None:
        return None if event.kind is EventKind.COMMAND else string_message(event.text)

    return write


def live_values_at_start(model: Model, live: Mapping[str, float]) -> bytes:
    """All live values, labeled with their keys."""
    message, values = labeled_array(list(live))
    values[:] = list(live.values())
    return message.payload()


def robot_description(model: Model, live: Mapping[str, float], control: ControlTopics | None = None) -> bytes:
    """The mechanism's spanning tree as URDF, with a block for ros2_control if its topics are given."""
    return string_message(to_urdf(model.mechanism, control))
