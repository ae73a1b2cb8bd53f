"""The messages that are published with an event, and those that are published once at the start."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from mbd_sim.mechanism.channels import channel_names
from mbd_sim.messages.new_state import new_state_message
from mbd_sim.messages.serialized_message import string_message
from mbd_sim.messages.state_messages import labeled_array
from mbd_sim.simulation.compiled_model import Model
from mbd_sim.simulation.events import (
    AppliedCommands,
    AppliedEfforts,
    AppliedWrench,
    ChangedValues,
    Event,
    EventKind,
)
from mbd_sim.simulation.snapshot import RunPoint
from mbd_sim.simulation.wrench_layout import wrench_labels
from mbd_sim.urdf.ros2_control import ControlTopics
from mbd_sim.urdf.urdf_writer import to_urdf

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
