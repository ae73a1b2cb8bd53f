"""Recomputes a recorded run with other values, another method or another step, under the same commands.

The changed run is written as a recording: the messages of the recorded run with other numbers. This needs no ROS.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mbd_sim.base.errors import CommandError, DivergedError, InputError, MbdSimError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.files.text.yaml_text import mechanism_text
from mbd_sim.recordings.mcap.writer import McapWriter
from mbd_sim.recordings.messages import cdr
from mbd_sim.recordings.messages.cdr import Message
from mbd_sim.recordings.run.metadata import run_metadata
from mbd_sim.recordings.run.reader import COMMANDS, TopicRole
from mbd_sim.recordings.run.recomputation import SEQUENCE_MODULUS, Recomputation
from mbd_sim.simulation.run.run_point import joint_state_arrays, joint_state_names

QUANTITIES = ("position", "velocity", "effort")

MessageWriter = Callable[[Message, Sequence[Array]], None]


@dataclass(frozen=True, slots=True)
class ComparedSeries:
    """One quantity over the time in s since the start of the recording, as recorded and in the changed run."""

    name: str
    times: Array
    recorded: Array
    changed: Array

    @property
    def largest_deviation(self) -> tuple[float, float]:
        """The largest deviation and the time at which it occurs; both 0 if the series is empty."""
        if not len(self.times):
            return 0.0, 0.0
        deviations = np.abs(self.changed - self.recorded)
        index = int(np.argmax(deviations))
        return float(deviations[index]), float(self.times[index])


@dataclass(frozen=True)
class ChangedRun:
    """Two runs under the same commands: `coordinates` by quantity, and `energies`, over the same times.

    `ended` says why the changed run ends before the recorded one, or is "". `left_out` recorded states are not
    compared, because they lie between two steps of the changed run.
    """

    recomputation: Recomputation
    coordinates: Mapping[str, Sequence[ComparedSeries]]
    energies: Sequence[ComparedSeries]
    ended: str = ""
    left_out: int = 0


@dataclass(frozen=True, slots=True)
class _Row:
    """The numbers of one message, as recorded and in the changed run."""

    time: float
    recorded: Array
    changed: Array


def compute_changed_run(
    recomputation: Recomputation,
    progress: Callable[[float], None] | None = None,
    write: MessageWriter | None = None,
) -> ChangedRun:
    """Advance a changed simulation through the recorded commands.

    :param progress: called with the completed fraction, from 0 to 1.
    :param write: called with each message, and the arrays that it would contain in the changed run.
    :raises DamagedError: the recording is damaged.
    """
    rows: dict[TopicRole, list[_Row]] = {TopicRole.JOINT_STATES: [], TopicRole.ENERGIES: []}
    between: dict[TopicRole, list[_Row]] = {role: [] for role in rows}
    ended = ""
    blocks = recomputation.file.blocks
    try:
        for number, block in enumerate(blocks):
            if progress is not None:
                progress(number / len(blocks))
            for message in block.load():
                _process(recomputation, message, rows, between, write)
    except (DivergedError, CommandError) as error:
        ended = str(error)
    if progress is not None:
        progress(1.0)
    simulation = recomputation.simulation
    names = joint_state_names(simulation.model)
    labels = [f"{name} {quantity}" for quantity in QUANTITIES for name in names]
    series = _series(rows[TopicRole.JOINT_STATES], labels)
    count = len(names)
    coordinates = {quantity: series[n * count :][:count] for n, quantity in enumerate(QUANTITIES)}
    energies = _series(rows[TopicRole.ENERGIES], simulation.energies._fields)
    return ChangedRun(recomputation, coordinates, energies, ended, len(between[TopicRole.JOINT_STATES]))


def _process(
    recomputation: Recomputation,
    message: Message,
    rows: Mapping[TopicRole, list[_Row]],
    between: Mapping[TopicRole, list[_Row]],
    write: MessageWriter | None,
) -> None:
    """Advance to a message; apply it, or add a row, to those `between` two steps if it lies there."""
    role = recomputation.roles.get(message.topic)
    tick = recomputation.tick_of(message)
    if tick != recomputation.tick:
        recomputation.advance(tick)
    arrays: Sequence[Array] = ()
    if role in COMMANDS:
        recomputation.apply(message)
    elif role is not None and role in rows:
        simulation = recomputation.simulation
        if role is TopicRole.JOINT_STATES:
            arrays = joint_state_arrays(simulation.model, simulation.time, simulation.y, simulation.inputs)
            recorded = np.concatenate(cdr.joint_states(message.payload)[3:])
        else:
            arrays = (np.array(simulation.energies),)
            recorded = cdr.multi_array(message.payload).values
        time = (tick - recomputation.first_tick) * recomputation.recorded_step
        row = _Row(time, recorded, np.concatenate(arrays))
        (between if recomputation.is_between_steps(tick) else rows)[role].append(row)
    if write is not None:
        write(message, arrays)


def _series(rows: Sequence[_Row], names: Sequence[str]) -> list[ComparedSeries]:
    if not rows:
        return [ComparedSeries(name, np.empty(0), np.empty(0), np.empty(0)) for name in names]
    times = np.array([row.time for row in rows])
    recorded, changed = np.array([row.recorded for row in rows]).T, np.array([row.changed for row in rows]).T
    return [ComparedSeries(*values) for values in zip(names, [times] * len(names), recorded, changed, strict=True)]


class ChangedRunFile:
    """Writes the messages that `compute_changed_run` reports; the file can be verified like any other recording.

    Only states, energies and commands are written: other topics would show the recorded run.
    """

    def __init__(self, path: Path, recomputation: Recomputation) -> None:
        """Begin the file, with the simulation at the start of the run.

        :raises InputError: the file is the recording itself.
        :raises MbdSimError: it cannot be written.
        """
        recorded = recomputation.file
        if path.exists() and path.samefile(recorded.path):
            raise InputError(f"{path} is the recording itself", "Choose another file for --out.")
        self._path, self._recomputation = path, recomputation
        self._step_ns = round(recomputation.simulation.step_size * 1e9)
        self._steps_at_reset = 0
        kept = COMMANDS | {TopicRole.JOINT_STATES, TopicRole.ENERGIES}
        topics = [name for name, role in recomputation.roles.items() if role in kept]
        self._numbers = {name: number for number, name in enumerate(topics)}
        simulation = recomputation.simulation
        try:
            self._writer = McapWriter(path, [recorded.topics[name] for name in self._numbers])
            self._writer.begin(mechanism_text(simulation.mechanism.source), run_metadata(simulation))
        except OSError as error:
            raise self._failed(error) from error

    def add(self, message: Message, arrays: Sequence[Array]) -> None:
        """Write a message, with `arrays` in place of its own unless they are empty.

        :raises MbdSimError: it cannot be written.
        """
        recomputation = self._recomputation
        topic = recomputation.file.topics[message.topic]
        if message.topic not in self._numbers or not (arrays or recomputation.roles[message.topic] in COMMANDS):
            return
        if recomputation.sets_clock(message):
            self._steps_at_reset = recomputation.steps_taken
        time_ns = (recomputation.steps_taken - self._steps_at_reset) * self._step_ns
        payload = cdr.with_arrays(topic, message.payload, arrays, time_ns) if arrays else message.payload
        sequence = recomputation.steps_taken % SEQUENCE_MODULUS
        try:
            self._writer.add(self._numbers[message.topic], payload, time_ns, sequence)
        except OSError as error:
            raise self._failed(error) from error

    def close(self) -> None:
        """Write the index and close the file.

        :raises MbdSimError: it cannot be written.
        """
        try:
            self._writer.finish()
            self._writer.close()
        except OSError as error:
            self._writer.abandon()
            raise self._failed(error) from error

    def _failed(self, error: OSError) -> MbdSimError:
        return MbdSimError(f"{self._path} cannot be written: {error.strerror or error}")
