"""A changed run as a recording of its own: the messages of the recorded one with other numbers. Needs no ROS."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from pathlib import Path

from mcap.writer import Writer

from mbd_sim.errors import MbdSimError
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism_file.yaml_writer import yaml_text
from mbd_sim.recording import cdr
from mbd_sim.recording.contents import Message
from mbd_sim.recording.recomputation import Recomputation
from mbd_sim.recording.run_metadata import run_metadata
from mbd_sim.simulation.simulation import Simulation


class ChangedFile:
    """Writes what `what_if` tells it; such a file can be verified like any other.

    Topics that are neither states, energies nor commands are left out: they would be those of the recorded run.
    """

    def __init__(self, path: Path, replica: Recomputation) -> None:
        """Begin the file, with the simulation at the beginning of the run.

        :raises MbdSimError: it cannot be written.
        """
        if path.exists() and path.samefile(replica.part.path):
            raise MbdSimError(f"{path} is the recording itself. Choose another file for --out.")
        self._path, self._replica = path, replica
        self._step_ns = round(replica.simulation.step_size * 1e9)
        self._rewound = 0
        try:
            self._stream = path.open("wb")
        except OSError as error:
            raise MbdSimError(f"{path} cannot be written: {error.strerror}") from error
        self._writer = Writer(self._stream)
        self._writer.start(profile="ros2", library="mbd_sim")
        text = yaml_text(replica.simulation.mechanism.source.data).encode()
        now = time.time_ns()
        self._writer.add_attachment(now, now, "mechanism.yaml", "application/yaml", text)
        self._writer.add_metadata("mbd_sim", run_metadata(replica.simulation) | _moment(replica.simulation))
        self._channels = {name: self._channel(name) for name in replica.roles}

    def take(self, message: Message, arrays: Sequence[Array]) -> None:
        """Write a message, with these arrays in place of its own where there are any."""
        topic = self._replica.part.topics[message.topic]
        if message.topic not in self._channels or (topic.type == cdr.JOINT_STATE and not arrays):
            return
        if self._replica.rewinds(message):
            self._rewound = self._replica.taken
        stamp = (self._replica.taken - self._rewound) * self._step_ns
        payload = cdr.rewritten(topic, message.payload, arrays, stamp) if arrays else message.payload
        self._writer.add_message(self._channels[message.topic], stamp, payload, stamp, self._replica.taken % (1 << 32))

    def close(self) -> None:
        """Write the index."""
        self._writer.finish()
        self._stream.close()

    def _channel(self, name: str) -> int:
        topic = self._replica.part.topics[name]
        schema = self._writer.register_schema(topic.type, "ros2msg", topic.definition.encode())
        return int(self._writer.register_channel(name, "cdr", schema, {"offered_qos_profiles": topic.qos}))


def _moment(simulation: Simulation) -> dict[str, str]:
    """What the run begins with, exact; ticks and clock count from its beginning."""
    return {
        "start": json.dumps([value.hex() for value in simulation.y.tolist()]),
        "inputs": json.dumps([value.hex() for value in simulation.inputs.tolist()]),
        "start_energy": float(simulation.start_energy).hex(),
        "first_tick": "0",
        "first_clock": "0",
        "first_step": str(simulation.steps),
    }
