"""Records the run of a `Simulation` in a script, in the format of `sim_node`'s recordings. Needs no ROS."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

from mbd_sim.base.errors import InputError, nearest
from mbd_sim.base.operating_system import OPEN_FILES
from mbd_sim.base.short_repr import short_repr
from mbd_sim.files.text.yaml_text import mechanism_text
from mbd_sim.recordings.mcap.writer import DiskNearlyFullError, McapWriter
from mbd_sim.recordings.messages.definitions import Topic, offered_qos_profiles
from mbd_sim.recordings.messages.events import EventWriter, Journal, publication_schedule
from mbd_sim.recordings.messages.states import AccelerationMessages, StateWriter
from mbd_sim.recordings.messages.topics import (
    ACCELERATIONS,
    CONSTRAINT_VIOLATION,
    CONTACT_FORCES,
    CONTACT_STATES,
    JOINT_REACTIONS,
    PART_POSES,
    SENSORS,
    TOPICS,
    OutputTopic,
    Recorded,
    SensorSerializer,
    absolute_name,
    for_accelerations,
    for_each_part,
    for_each_sensor,
    is_vital,
)
from mbd_sim.recordings.run.metadata import run_metadata
from mbd_sim.recordings.run.paths import RecordingError
from mbd_sim.simulation.run.events import RESTARTS, EventKind, Payload
from mbd_sim.simulation.run.simulation import BaseSimulation

SUFFIX = ".mcap"
DEFAULT_RATE = 100.0  # Hz, as `publish_rate` of the node
ALL = "*"
FLUSH_PERIOD = 0.2  # s of real time between chunks: the most that is lost if the process is killed


class RunRecorder:
    """Records a simulation to an MCAP file until it is closed; `Simulation.recording` makes one.

    The file contains the mechanism, the state at its start, the states at `rate`, and each command, change of live
    values, reset and restored state at the step at which it took effect. So it replays, verifies and shows like a
    recording of the node. While a simulation is recorded, a `step(n)` that diverges leaves it at the last recorded
    state, not at the one before the call.
    """

    __repr__ = short_repr

    def __init__(
        self,
        simulation: BaseSimulation,
        path: str | Path,
        *,
        rate: float | None = None,
        reactions: bool = False,
        contact_forces: bool = False,
        violation: bool = False,
        poses: Sequence[str] = (),
        accelerations: Sequence[str] = (),
    ) -> None:
        """Begin the file with the present state; an existing file is replaced.

        :param rate: states per second of simulated time, at most one for each step; by default 100 or one for each
            step. The first and the last state are always recorded.
        :param reactions: also record the force and moment that each joint transmits,
        :param contact_forces: the point, the normal and the force vector of each contact,
        :param violation: the violation of loops and constraints,
        :param poses: the poses of these parts; `["*"]` are all,
        :param accelerations: and the accelerations of the `coordinates`, of parts and of points; `["*"]` are all. A
            single name may be given by itself, here and in `poses`.
        :raises InputError: the file does not end in .mcap, or its folder does not exist; the rate is not possible; a
            part or a point does not exist; or the simulation is being recorded already.
        :raises RecordingError: the file cannot be written.
        """
        self.path, self._simulation = Path(path), simulation
        self.states = self.events = 0  # that have been recorded
        self._schedule = publication_schedule(_possible_rate(rate, simulation.step_size), simulation.step_size)
        poses, accelerations = ([one] if isinstance(one, str) else one for one in (poses, accelerations))
        wanted = {
            JOINT_REACTIONS.name: reactions,
            CONTACT_STATES.name: bool(simulation.model.contact_readings.entry_names()),
            CONTACT_FORCES.name: contact_forces,
            CONSTRAINT_VIOLATION.name: violation,
        }
        requested = _requested(simulation, wanted, poses, accelerations)
        _require_path(self.path)
        self._journal = Journal(simulation, first_tick=simulation.steps)
        self._clock = self._journal.clock
        self._last_state = -1  # the tick of the last state that was recorded
        self._flushed, self._closed = time.monotonic(), False
        model = simulation.model
        self._numbers = {topic.name: number for number, topic in enumerate(requested)}
        self._state_writers: dict[str, StateWriter] = {t.name: t.on_state(model, "") for t in requested if t.on_state}
        self._event_writers: dict[str, EventWriter] = {t.name: t.on_event(model) for t in requested if t.on_event}
        self._sensors = SensorSerializer(model, simulation.step_size)
        simulation.listen(self)
        try:
            self._writer = McapWriter(self.path, [_described(topic) for topic in requested])
            metadata = run_metadata(simulation, self._journal.snapshot())
            self._writer.begin(mechanism_text(simulation.mechanism.source), metadata)
            for topic in requested:
                if topic.at_start is not None:
                    self._put(topic.name, topic.at_start(model, simulation.live))
        except OSError as error:
            simulation.listen(None)
            raise RecordingError(f"cannot record to '{self.path}': {error.strerror or error}.") from error
        self._add_state()
        self._add_measurements()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close(str(error) if isinstance(error, Exception) else "")

    def close(self, problem: str = "") -> None:
        """Record the last state, and complete the file; from then on the simulation is not recorded.

        :param problem: why the run ends, recorded as an event.
        :raises RecordingError: the file cannot be completed.
        """
        if self._closed:
            return
        self._journal.count_steps()
        if self._last_state != self._clock.ticks:
            self._add_state()
        if problem:
            self.report(EventKind.WARNING, " ".join(problem.split()))
        self._end()
        try:
            self._writer.finish()
            self._writer.close()
        except OSError as error:
            raise self._failed(error) from error

    def parts_of(self, steps: int) -> Iterator[int]:
        """Divide steps at the states to record; see `RunListener`.

        :raises RecordingError: the disk is full or fails; the simulation continues to work, without a recording.
        """
        self._journal.count_steps()
        while steps > 0:
            part = steps
            if not self._closed:
                part = self._simulation.steps_to_arrival(at_most=steps)
                if self._schedule is not None:
                    part = min(part, self._schedule.next_tick(self._clock.ticks) - self._clock.ticks)
            yield part
            steps -= part
            self._journal.count_steps()
            if not self._closed:
                if self._schedule is not None and self._schedule.is_due(self._clock.ticks):
                    self._add_state()
                self._add_measurements()

    def report(self, kind: EventKind, payload: Payload = None) -> None:
        """Record a command, a changed value, a reset or a new state; see `RunListener`.

        :raises RecordingError: the disk is full or fails.
        """
        event = self._journal.event(kind, payload)
        if self._closed:
            return
        self.events += 1
        for name, write in self._event_writers.items():
            message = write(event)
            if message is not None:
                self._put(name, message)
        if kind in RESTARTS:
            self._add_state()
            self._add_measurements()

    def _add_state(self) -> None:
        snapshot, energies = self._journal.snapshot(), self._simulation.energies
        for name, writer in self._state_writers.items():
            self._put(name, writer.payload(snapshot, energies))
        self._last_state = self._clock.ticks
        self.states += 1

    def _add_measurements(self) -> None:
        for one in self._sensors.measured(self._simulation.arrivals, self._clock.ns):
            self._put(one.topic, one.payload)

    def _put(self, name: str, payload: bytes) -> None:
        if self._closed:
            return
        try:
            self._writer.add(self._numbers[name], payload, self._clock.ns, self._clock.ticks & 0xFFFFFFFF)
            if (now := time.monotonic()) - self._flushed > FLUSH_PERIOD:
                self._flushed = now
                self._writer.flush()
        except OSError as error:
            self._end()
            raise self._failed(error) from error

    def _end(self) -> None:
        self._closed = True
        self._simulation.listen(None)

    def _failed(self, error: OSError) -> RecordingError:
        """Save what is possible, and say why the recording ends."""
        try:
            if not isinstance(error, DiskNearlyFullError):
                raise error
            self._writer.finish()
            self._writer.close()
        except OSError:
            self._writer.abandon()
        return RecordingError(
            f"recording to '{self.path}' ends at t = {1e-9 * self._clock.ns:.9g} s: {error.strerror or error}."
        )


def _possible_rate(rate: float | None, step_size: float) -> float:
    most = 1.0 / step_size
    if rate is None:
        return min(DEFAULT_RATE, most)
    if not 0.0 < rate <= most * (1.0 + 1e-9):
        raise InputError(
            f"a rate of {rate:g} Hz cannot be recorded: the state changes {most:g} times a second, with each step of "
            f"{step_size:g} s",
            f"Choose a rate above 0 and up to {most:g} Hz, or a smaller step.",
        )
    return rate


def _requested(
    simulation: BaseSimulation, wanted: Mapping[str, bool], poses: Sequence[str], accelerations: Sequence[str]
) -> list[OutputTopic]:
    """The topics to record: all that the node records, but those that are not `wanted`."""
    parts = simulation.model.part_names
    for part in poses:
        if part not in (*parts, ALL):
            raise InputError(f"poses: there is no part '{part}'", nearest(part, parts))
    AccelerationMessages(simulation.model, accelerations)  # refuses unknown names
    found: list[OutputTopic] = []
    for topic in TOPICS:
        if topic is SENSORS:
            found += for_each_sensor(simulation.mechanism.sensors)
        elif topic is ACCELERATIONS:
            found += [for_accelerations(accelerations)] if accelerations else []
        elif topic is PART_POSES:
            found += for_each_part(topic, parts, parts if ALL in poses else list(dict.fromkeys(poses)))
        elif topic.recorded is not Recorded.NO and wanted.get(topic.name, True):
            found.append(topic)
    return found


def _described(topic: OutputTopic) -> Topic:
    profiles = offered_qos_profiles(topic.qos)
    return Topic(absolute_name(topic), topic.message_type, profiles, is_vital(topic))


def _require_path(path: Path) -> None:
    if path.suffix != SUFFIX and path.parent != OPEN_FILES:
        raise InputError(f"{path}: a run is recorded to an {SUFFIX} file", f"Write for example {path.stem}{SUFFIX}.")
    if not path.parent.is_dir():
        raise InputError(f"{path}: there is no folder {path.parent}", "Create it, or choose another file.")
