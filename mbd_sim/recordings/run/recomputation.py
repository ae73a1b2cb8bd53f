"""Recomputes a recorded run: applies the recorded commands at the steps at which they took effect."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import assert_never

from mbd_sim.base.errors import CommandError, InputError, listed
from mbd_sim.base.geometry.pose import Array
from mbd_sim.files.checks.override import with_values
from mbd_sim.files.load import parse_mechanism
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.recordings.messages import cdr
from mbd_sim.recordings.messages.cdr import Message, RecordedFile
from mbd_sim.recordings.messages.events import parse_new_state
from mbd_sim.recordings.run.metadata import RecomputeError, read_run_start
from mbd_sim.recordings.run.reader import TopicRole, topic_roles
from mbd_sim.simulation.model.commands import parse_wrench
from mbd_sim.simulation.model.live_values import LARGEST_GAP, LiveValues
from mbd_sim.simulation.run.events import ChangedValues, EventKind, parse_event
from mbd_sim.simulation.run.simulation import BaseSimulation

__all__ = ["SEQUENCE_MODULUS", "LiveValueMismatch", "Recomputation", "RecomputeError"]

BOUNDARY = 1e-6  # part of a step by which a time may miss a boundary between steps, for rounding
SEQUENCE_MODULUS = 1 << 32  # sequence numbers are ticks modulo this


@dataclass(frozen=True, slots=True)
class LiveValueMismatch:
    """A live value in effect that differs from the one that a recorded event announced."""

    key: str
    recorded: float
    announced: float


class Recomputation:
    """The simulation of a recorded run, advanced from message to message.

    `tick` counts the steps since the node started; `steps_taken` counts those of this simulation, whose step may be
    another. With another method, step, or other values it is a changed run under the recorded commands.
    """

    def __init__(
        self,
        file: RecordedFile,
        *,
        method: str | None = None,
        step: float | None = None,
        changes: Mapping[str, float | str] | None = None,
    ) -> None:
        """Build the simulation in the state in which the recording begins.

        :param step: in s.
        :param changes: values of the mechanism's file to replace, see `with_values`. A changed run begins at the
            mechanism's own start, unless the recording begins later.
        :raises RecomputeError: the recording lacks something that is needed.
        :raises MechanismError: the mechanism cannot be built.
        """
        self.file, self.changes = file, dict(changes or {})
        start = self._start = read_run_start(file)
        try:
            self.simulation = BaseSimulation(
                self._mechanism(),
                method=method or start.method,
                step=step or start.step,
                wrenches=start.wrenches,
                live=[key for key in start.live if not self._is_changed(key)],  # a changed value stays fixed
            )
            # A tick at which the simulation's own number of steps is known: the start, or the last reset.
            self._reference_tick, self._reference_steps = start.tick, 0
            self._restore_start()
        except ValueError as error:
            reason = str(error).removesuffix(".")
            raise RecomputeError(f"{file.path}: its metadata does not fit its mechanism: {reason}.") from error
        self.roles = topic_roles(file.topics)
        self.first_tick = self.tick = start.tick
        self.steps_taken = 0
        self.step_ns = round(start.step * 1e9)
        self._clock_offset_ns: int | None = None if start.tick else 0
        if start.clock_ns is not None:
            self._clock_offset_ns = start.tick * self.step_ns - start.clock_ns
        self._announced = dict(self.simulation.live)  # live values according to the events

    @property
    def recorded_step(self) -> float:
        """The step of the recorded run in s."""
        return self._start.step

    @property
    def frame_prefix(self) -> str:
        """What precedes the names of frames in recorded messages."""
        return self._start.frame_prefix

    @property
    def as_recorded(self) -> bool:
        """Whether equations, method and step are those of the recording."""
        same_step = self.simulation.step_size == self._start.step
        return not self.changes and same_step and self.simulation.model.method_name == self._start.method

    def tick_of(self, message: Message) -> int:
        """Return the tick of a message, from its sequence number and the present tick."""
        return self.tick + (message.sequence - self.tick) % SEQUENCE_MODULUS

    def clock_ns(self, tick: int, message: Message) -> int:
        """Return the simulated clock at a tick; if the metadata does not give it, the first message sets it."""
        if self._clock_offset_ns is None:
            self._clock_offset_ns = tick * self.step_ns - message.time_ns
        return tick * self.step_ns - self._clock_offset_ns

    def sets_clock(self, message: Message) -> bool:
        """Whether a message is an event that sets the clock: to zero, as a reset may do, or to a followed clock."""
        if self.roles.get(message.topic) != TopicRole.EVENTS:
            return False
        kind = parse_event(cdr.text(message.payload)).kind
        at_zero = message.time_ns == 0 and kind in (EventKind.RESET, EventKind.CLOCK_RESET)
        return at_zero or kind is EventKind.CLOCK_SET

    def set_clock(self, tick: int, time_ns: int) -> None:
        """Let the simulated clock be `time_ns` at a tick."""
        self._clock_offset_ns = tick * self.step_ns - time_ns

    def advance(self, tick: int) -> None:
        """Step to a tick.

        :raises DivergedError: the motion becomes infinite.
        """
        since_reference = round((tick - self._reference_tick) * self.recorded_step / self.simulation.step_size)
        steps = max(0, self._reference_steps + since_reference - self.simulation.steps)
        self.simulation.step(steps)
        self.steps_taken += steps
        self.tick = tick

    def is_between_steps(self, tick: int) -> bool:
        """Whether a tick lies between two steps of the simulation, whose step may be another."""
        steps = (tick - self._reference_tick) * self.recorded_step / self.simulation.step_size
        return abs(steps - round(steps)) > BOUNDARY

    def apply(self, message: Message) -> list[LiveValueMismatch]:
        """Apply a recorded command from the present tick on; return live values that contradict the events.

        :raises CommandError: it cannot have been applied.
        """
        role = self.roles.get(message.topic)
        match role:
            case TopicRole.APPLIED_EFFORTS:
                self.simulation.set_efforts(cdr.multi_array(message.payload).values)
            case TopicRole.APPLIED_COMMANDS:
                self.simulation.apply_command_values(
                    self.simulation.command_map.checked(*cdr.multi_array(message.payload))
                )
            case TopicRole.APPLIED_WRENCHES:
                wrench = parse_wrench(*cdr.multi_array(message.payload))
                self.simulation.set_wrench(wrench.part, wrench.force, wrench.couple, at=wrench.point, axes=wrench.axes)
            case TopicRole.LIVE_VALUES:
                self._set_live(cdr.multi_array(message.payload))
            case TopicRole.NEW_STATES:
                self._continue_from(cdr.multi_array(message.payload))
            case TopicRole.EVENTS:
                return self._apply_event(cdr.text(message.payload))
            case TopicRole.JOINT_STATES | TopicRole.ENERGIES | TopicRole.CONSTRAINT_VIOLATION:
                pass
            case TopicRole.ACCELERATIONS | TopicRole.SENSORS | None:
                pass
            case _:
                assert_never(role)
        return []

    def live_value_mismatches(self) -> list[LiveValueMismatch]:
        """Return live values that differ from those that events announced; later ones are compared with the present."""
        live = self.simulation.live
        found = [
            LiveValueMismatch(key, live[key], value)
            for key, value in self._announced.items()
            if live.get(key, value) != value
        ]
        self._announced = dict(live)
        return found

    def _mechanism(self) -> Mechanism:
        if self.file.mechanism_text is None:
            raise RecomputeError(f"{self.file.path}: contains no mechanism.yaml, so it cannot be recomputed.")
        mechanism = parse_mechanism(self.file.mechanism_text, self._start.file)
        if not self.changes:
            return mechanism
        changed = with_values(mechanism, self.changes)
        own, others = ({*one.coordinate_names, *one.driven_names} for one in (mechanism, changed))
        if own != others:
            different = [*(f"'{name}' is added" for name in sorted(others - own))]
            different += [f"'{name}' is missing" for name in sorted(own - others)]
            raise RecomputeError(
                f"{self.file.path}: the change gives the mechanism other coordinates ({listed(different)}), so the "
                "commands and states of the recording do not fit",
                "Change values that keep the coordinates, or run the changed mechanism with 'mbd_sim run'.",
            )
        return changed

    def _is_changed(self, key: str) -> bool:
        return key in self.changes or key.removeprefix("parameters.") in self.changes

    def _restore_start(self) -> None:
        """Set the simulation to the state in which the recording begins.

        :raises ValueError: that does not fit the mechanism.
        """
        simulation, start = self.simulation, self._start
        live = self._live_of(start.live)
        if start.inputs is None or not self.as_recorded:
            changes = {key: value for key, value in live.items() if simulation.live[key] != value}
            if changes:
                simulation.set_live(changes, reassemble=True)
                simulation.reset()
        if self.as_recorded:
            rest = start.start_energy, live, start.samples, start.history
            simulation.restore(start.y, start.steps, start.inputs, *rest)
            self._reference_steps = start.steps
        elif start.tick or start.steps:
            self._restore_changed(start.y, round(start.steps * start.step / simulation.step_size), start.inputs)

    def _restore_changed(self, y: Array, steps: int, recorded: Array | None) -> None:
        """Continue a changed run from a recorded state, under the recorded efforts, wrenches and commands.

        :raises ValueError: the loops cannot be closed there.
        """
        simulation, values = self.simulation, self.simulation.model.input_layout.values
        if len(y) != simulation.y.size and simulation.mechanism.actuators:
            raise InputError(
                "with this change the delayed commands of actuators wait for another number of steps, or servos have "
                "other states, so that the run cannot continue from its middle",
                "Keep the step, and which gains are zero.",
            )
        inputs = simulation.inputs.copy()
        if recorded is not None:
            inputs[: values.start] = recorded[: values.start]
        simulation.restore(y, steps, inputs)
        if (gap := simulation.violation.position) > LARGEST_GAP:
            raise ValueError(f"with these changes its loops are open by {gap:.3g} in the middle of the run")
        simulation.restore(y, steps, start_energy=simulation.energies.total)
        self._reference_steps = steps

    def _continue_from(self, recorded: cdr.MultiArray) -> None:
        """Continue from a recorded state; in a changed run with its own live values, and with loops that stay closed.

        :raises CommandError: the message does not fit the mechanism, or the loops would open.
        """
        simulation = self.simulation
        try:
            new = parse_new_state(*recorded, simulation.y.size, simulation.inputs.size, simulation.history.size)
            if self.as_recorded:
                rest = new.start_energy, new.live, new.samples, new.history
                simulation.restore(new.state, new.steps, new.inputs, *rest)
                self._reference_steps = new.steps
            else:
                steps = round(new.steps * self.recorded_step / simulation.step_size)
                self._restore_changed(new.state, steps, new.inputs)
        except ValueError as error:
            raise CommandError(f"the recorded state cannot be set: {error}") from error
        self._reference_tick, self._announced = self.tick, dict(simulation.live)

    def _set_live(self, recorded: cdr.MultiArray) -> None:
        current = self.simulation.live
        known = self._live_of(dict(zip(recorded.labels, recorded.values.tolist(), strict=True)))
        if any(current[key] != value for key, value in known.items()):
            self.simulation.set_live(known, reassemble=True)  # if it was, at the time; else the loops stay closed

    def _live_of(self, recorded: Mapping[str, float]) -> dict[str, float]:
        """The live values of the simulation with recorded ones; in a changed run, those that had been given."""
        if self.changes:
            recorded = self._recorded_live.given_among(recorded)
        return {key: value for key, value in recorded.items() if key in self.simulation.live}

    @cached_property
    def _recorded_live(self) -> LiveValues:
        """The live values of the recorded mechanism."""
        assert self.file.mechanism_text is not None
        return LiveValues(parse_mechanism(self.file.mechanism_text, self._start.file), list(self._start.live))

    def _apply_event(self, text: str) -> list[LiveValueMismatch]:
        event = parse_event(text)
        if event.kind is EventKind.RESET:
            self.simulation.reset()
            self._reference_tick, self._reference_steps = self.tick, 0
        if not isinstance(event.payload, ChangedValues) or not self.as_recorded:
            return []
        self._announced |= event.payload.changes
        return self.live_value_mismatches()
