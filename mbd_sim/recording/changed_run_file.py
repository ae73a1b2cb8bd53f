"""Writes a changed run as a recording: the messages of the recorded run with other numbers. Needs no ROS."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from mbd_sim.errors import InputError, MbdSimError
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism_file.yaml_writer import mechanism_text
from mbd_sim.recording import cdr
from mbd_sim.recording.mcap_writer import McapWriter
from mbd_sim.recording.recomputation import SEQUENCE_MODULUS, Recomputation
from mbd_sim.recording.recorded_file import Message
from mbd_sim.recording.run_metadata import run_metadata
from mbd_sim.recording.topic_roles import COMMANDS, TopicRole


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
