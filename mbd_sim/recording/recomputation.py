"""A recorded run computed again: the recorded commands at the steps at which they took effect."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from mbd_sim.geometry.pose import Array
from mbd_sim.load import parse_mechanism
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.mechanism_file.override import with_values
from mbd_sim.recording import cdr
from mbd_sim.recording.contents import Message, Part, RecordedTopic
from mbd_sim.recording.reader import ABOUT
from mbd_sim.recording.run_start import RecomputeError, beginning
from mbd_sim.simulation.compiled_model import Model
from mbd_sim.simulation.live_values import LARGEST_GAP
from mbd_sim.simulation.simulation import Simulation

__all__ = ["Mismatch", "Recomputation", "RecomputeError", "is_run", "joint_rows", "roles"]

STATES, ENERGIES, VIOLATION = "joint_states", "energies", "constraint_violation"
EFFORTS, WRENCHES, LIVE, EVENTS = "applied_efforts", "applied_wrenches", "live_values", "events"
ROLES = {
    STATES: "sensor_msgs/msg/JointState",
    EVENTS: "std_msgs/msg/String",
    **dict.fromkeys((ENERGIES, VIOLATION, EFFORTS, WRENCHES, LIVE), "std_msgs/msg/Float64MultiArray"),
}
COMMANDS = (EFFORTS, WRENCHES, LIVE, EVENTS)
_AROUND = 1 << 32  # of the ticks, only the remainder by this is recorded
_TOLD = re.compile(r"(\S+) = ([^,]+)(?:, |$)")


class Mismatch(NamedTuple):
    """Two records of one thing that do not agree."""

    name: str
    recorded: float
    expected: float


class Recomputation:
    """The simulation of a recorded run, led through it message by message.

    `tick` counts the steps since the node started. With another method, step, or other values than the recorded ones it
    is another run under the same commands.
    """

    def __init__(
        self,
        part: Part,
        *,
        method: str | None = None,
        step: float | None = None,
        changes: Mapping[str, float | str] | None = None,
    ) -> None:
        """Build the simulation as it was at the beginning of the recording.

        :param changes: values of the mechanism's file to replace, see `with_values`. A run that is changed, or has
            another step or method, begins at the mechanism's own start unless the recording began later.
        :raises RecomputeError: the recording does not say what is needed.
        :raises MechanismError: the mechanism cannot be built.
        """
        self.part, self.changes = part, dict(changes or {})
        begin = self._recorded = beginning(part)
        try:
            self.simulation = Simulation(
                self._mechanism(),
                method=method or begin.method,
                step=step or begin.step,
                wrenches=begin.wrenches,
                live=[key for key in begin.live if not self._changed(key)],  # what is changed stays so
            )
            self._base_tick, self._base_step = begin.tick, 0  # at which the mechanism's own steps are known
            self._begin()
        except ValueError as error:
            raise RecomputeError(f"{part.path}: its metadata does not fit its mechanism: {error}.") from error
        self.roles = roles(part.topics)
        self.first_tick = self.tick = begin.tick
        self.taken = 0  # steps of the simulation, which are others than the ticks where its step is another
        self.step_ns = round(begin.step * 1e9)
        self._offset_ns: int | None = None if begin.tick else 0
        if begin.clock_ns is not None:
            self._offset_ns = begin.tick * self.step_ns - begin.clock_ns
        self._told = dict(self.simulation.live)  # the live values as the events say them, word for word

    @property
    def recorded_step(self) -> float:
        """The step of the recorded run in s."""
        return self._recorded.step

    @property
    def as_recorded(self) -> bool:
        """Whether nothing is changed: equations, method and step are those of the recording."""
        same_step = self.simulation.step_size == self._recorded.step
        return not self.changes and same_step and self.simulation.model.method.name == self._recorded.method

    def behind(self, message: Message) -> int:
        """The tick of a message: the recorded sequence counts on from the present tick."""
        return self.tick + (message.sequence - self.tick) % _AROUND

    def clock_ns(self, tick: int, message: Message) -> int:
        """What the node's clock shows at a tick; a recording's first message sets it where nothing else does."""
        if self._offset_ns is None:
            self._offset_ns = tick * self.step_ns - message.time_ns
        return tick * self.step_ns - self._offset_ns

    def rewound(self, tick: int, message: Message) -> bool:
        """Whether a message sets the clock back to zero, which it shows from then on."""
        if self.rewinds(message):
            self._offset_ns = tick * self.step_ns
            return True
        return False

    def rewinds(self, message: Message) -> bool:
        """Whether a message tells that the clock was set back to zero, as a reset may do."""
        if message.time_ns or self.roles.get(message.topic) != EVENTS:
            return False
        return cdr.text(message.payload) in ("reset", "clock set to zero")

    def advance(self, tick: int) -> None:
        """Step to a tick.

        :raises DivergedError: the motion becomes infinite.
        """
        wanted = self._base_step + round((tick - self._base_tick) * self.recorded_step / self.simulation.step_size)
        steps = max(0, wanted - self.simulation.steps)
        self.simulation.step(steps)
        self.taken += steps
        self.tick = tick

    def apply(self, message: Message) -> list[Mismatch]:
        """Let a recorded command act from the present tick on; returns where records of it contradict each other.

        :raises CommandError: it cannot have been applied.
        """
        role = self.roles.get(message.topic)
        if role == EFFORTS:
            self.simulation.set_efforts(cdr.numbers(message.payload).values)
        elif role == WRENCHES:
            self._set_wrench(cdr.numbers(message.payload))
        elif role == LIVE:
            self._set_live(cdr.numbers(message.payload))
        elif role == EVENTS:
            return self._event(cdr.text(message.payload))
        return []

    def _mechanism(self) -> Mechanism:
        if self.part.mechanism_text is None:
            raise RecomputeError(f"{self.part.path}: holds no mechanism.yaml, so that it cannot be computed again.")
        mechanism = parse_mechanism(self.part.mechanism_text, self._recorded.file)
        return with_values(mechanism, self.changes) if self.changes else mechanism

    def _changed(self, key: str) -> bool:
        return key in self.changes or key.removeprefix("parameters.") in self.changes

    def _begin(self) -> None:
        """Bring the simulation to where the recording begins.

        :raises ValueError: that does not fit the mechanism.
        """
        simulation, begin = self.simulation, self._recorded
        live = {key: value for key, value in begin.live.items() if key in simulation.live}
        if begin.inputs is None or not self.as_recorded:
            changes = {key: value for key, value in live.items() if simulation.live[key] != value}
            if changes:
                simulation.set_live(changes)
                simulation.reset()
        if self.as_recorded:
            simulation.restore(begin.start, begin.steps, begin.inputs, begin.start_energy, live)
            self._base_step = begin.steps
        elif begin.tick or begin.steps:
            self._begin_later(begin.start, begin.inputs, round(begin.steps * begin.step / simulation.step_size))

    def _begin_later(self, start: Array, recorded: Array | None, steps: int) -> None:
        """A changed run that begins in the middle: at the recorded state, under the recorded efforts and wrenches.

        :raises ValueError: the loops cannot be closed there.
        """
        simulation, values = self.simulation, self.simulation.model.equations.inputs.of_values
        inputs = simulation.inputs.copy()
        if recorded is not None:
            inputs[: values.start] = recorded[: values.start]
        simulation.restore(start, steps, inputs)
        if (gap := simulation.violation.position) > LARGEST_GAP:
            raise ValueError(f"with these changes its loops are open by {gap:.3g} in the middle of the run")
        simulation.restore(start, steps, inputs, simulation.energies.total)
        self._base_step = steps

    def _set_wrench(self, given: cdr.Numbers) -> None:
        part = given.labels[0].rsplit(".", 2)[0] if given.labels else ""
        force, couple, own_force, own_couple, point = given.values.reshape(5, 3)
        if np.any(own_force) or np.any(own_couple):
            self.simulation.set_wrench(part, own_force, own_couple, at=point, axes="part")
        else:
            self.simulation.set_wrench(part, force, couple, at=point)

    def _set_live(self, given: cdr.Numbers) -> None:
        current = self.simulation.live
        changes = dict(zip(given.labels, given.values.tolist(), strict=True))
        known = {key: value for key, value in changes.items() if key in current and not self._changed(key)}
        if any(current[key] != value for key, value in known.items()):
            self.simulation.set_live(known)

    def _event(self, text: str) -> list[Mismatch]:
        if text == "reset":
            self.simulation.reset()
            self._base_tick, self._base_step = self.tick, 0
        if not text.startswith("live values: ") or not self.as_recorded:
            return []
        self._told |= {key: float(value) for key, value in _TOLD.findall(text.removeprefix("live values: "))}
        return self.contradictions()

    def contradictions(self) -> list[Mismatch]:
        """Live values that are others than what the events said; from then on they count as said."""
        live = self.simulation.live
        found = [Mismatch(key, live[key], value) for key, value in self._told.items() if live.get(key, value) != value]
        self._told = dict(live)
        return found


def roles(topics: Mapping[str, RecordedTopic]) -> dict[str, str]:
    """What the topics of a run are, by the last word of their names and their types, in any namespace."""
    found = {
        name: role
        for name, topic in topics.items()
        if ROLES.get(role := name.rsplit("/", 1)[-1]) == topic.type and topic.encoding == "cdr"
    }
    states = [name for name, topic in topics.items() if topic.type == ROLES[STATES]]
    if STATES not in found.values() and len(states) == 1:  # another name, by a remapping
        found[states[0]] = STATES
    return found


def joint_rows(model: Model, time: float, y: Array, inputs: Array) -> tuple[Array, Array, Array]:
    """Positions, speeds and efforts as `joint_states` tells them: the driven coordinates last, with their drives."""
    position, velocity, effort = model.coordinates(y), y[model.u_range], inputs[: model.layout.nv]
    if not model.driven_names:
        return position, velocity, effort
    drives = model.drives(time, y, inputs)
    return (
        np.concatenate([position, drives[0]]),
        np.concatenate([velocity, drives[1]]),
        np.concatenate([effort, drives[2]]),
    )


def is_run(part: Part) -> bool:
    """Whether a file says what is needed to compute it again."""
    return ABOUT in part.metadata
