"""A run to an MCAP file that any ROS 2 tool opens, written off the simulation's thread."""

from __future__ import annotations

import contextlib
import queue
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import IO

from mcap.writer import Writer

from mbd_sim.errors import MbdSimError
from mbd_sim.recording.schemas import definition, type_hash

QUEUED = 20_000  # messages that may wait for a slow disk before display topics are dropped
CHUNK = 0.25  # seconds of messages that a chunk holds, and
FLUSHED = 0.1  # seconds between flushes to the system: a killed process loses both at most


class RecordingError(MbdSimError):
    """A recording that cannot be started."""


@dataclass(frozen=True)
class Topic:
    """A recorded topic: its absolute name, type such as `std_msgs/msg/String`, and offered QoS in rosbag2's YAML.

    Messages of a `vital` topic are never dropped: what is needed to compute the run again.
    """

    name: str
    type: str
    qos: str
    vital: bool = False


@dataclass(frozen=True)
class _Message:
    topic: int
    payload: bytes
    time_ns: int
    sequence: int


def new_file(folder: Path, name: str) -> Path:
    """A path that does not exist yet, from a name and the time, in a folder that is made where it is missing.

    :raises RecordingError: the folder cannot be made or written.
    """
    stamp = datetime.now().astimezone().strftime("%Y%m%d_%H%M%S")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for count in range(1000):
            path = folder / (f"{name}_{stamp}.mcap" if not count else f"{name}_{stamp}_{count}.mcap")
            with contextlib.suppress(FileExistsError):
                path.open("xb").close()
                return path
    except OSError as error:
        raise RecordingError(f"cannot record to '{folder}': {error.strerror}. Choose another record_dir.") from error
    raise RecordingError(f"'{folder}' already holds a thousand recordings of this second.")


class Recorder:
    """Writes messages in a thread of its own; `put` never waits for the disk.

    The mechanism's file is the first thing in the recording, so that it survives a kill. Messages carry the
    simulation's clock as log time and the tick (steps since the node started) as sequence.
    """

    def __init__(
        self,
        path: Path,
        topics: Mapping[str, Topic],
        mechanism_text: str,
        metadata: Mapping[str, str],
        bytes_per_second: float,
    ) -> None:
        """Open the file; `bytes_per_second` is the expected rate, from which the size of the chunks follows.

        :raises RecordingError: the file cannot be opened.
        """
        self.path = path
        self.written = self.dropped = 0
        self.failure = ""
        self._topics = list(topics.values())
        self._number = {key: number for number, key in enumerate(topics)}
        try:
            self._stream: IO[bytes] = path.open("wb")
        except OSError as error:
            raise RecordingError(f"cannot record to '{path}': {error.strerror}.") from error
        chunk_size = int(min(max(bytes_per_second * CHUNK, 1024), 65536))
        self._writer = Writer(self._stream, chunk_size=chunk_size)
        self._channels: list[int] = []
        try:
            self._begin(mechanism_text, metadata)
        except OSError as error:
            self._stream.close()
            raise RecordingError(f"cannot record to '{path}': {error.strerror}.") from error
        self._queue: queue.SimpleQueue[_Message | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._write_all, name="recorder", daemon=True)
        self._thread.start()

    def put(self, key: str, payload: bytes, time_ns: int, sequence: int) -> None:
        """Queue one serialized message of the topic that was given under `key`."""
        number = self._number[key]
        if self._queue.qsize() >= QUEUED and not self._topics[number].vital:
            self.dropped += 1
            return
        self._queue.put(_Message(number, payload, time_ns, sequence & 0xFFFFFFFF))

    def close(self) -> None:
        """Write what waits, the summary and the index."""
        if self._thread.is_alive():
            self._queue.put(None)
            self._thread.join()

    def _begin(self, mechanism_text: str, metadata: Mapping[str, str]) -> None:
        now = time.time_ns()
        self._writer.start(profile="ros2", library="mbd_sim")
        self._writer.add_attachment(now, now, "mechanism.yaml", "application/yaml", mechanism_text.encode())
        self._writer.add_metadata("mbd_sim", dict(metadata))
        for topic in self._topics:
            schema = self._writer.register_schema(topic.type, "ros2msg", definition(topic.type).encode())
            about = {"offered_qos_profiles": topic.qos, "topic_type_hash": type_hash(topic.type)}
            self._channels.append(self._writer.register_channel(topic.name, "cdr", schema, about))

    def _write_all(self) -> None:
        flushed = time.monotonic()
        while (message := self._queue.get()) is not None:
            if self.failure:
                self.dropped += 1
                continue
            try:
                self._writer.add_message(
                    channel_id=self._channels[message.topic],
                    log_time=message.time_ns,
                    publish_time=message.time_ns,
                    sequence=message.sequence,
                    data=message.payload,
                )
                self.written += 1
                if time.monotonic() - flushed > FLUSHED:
                    self._stream.flush()
                    flushed = time.monotonic()
            except OSError as error:
                self.failure = f"recording to '{self.path}' stopped: {error.strerror}"
                self.dropped += 1
        try:
            if not self.failure:
                self._writer.finish()
                self._stream.flush()
        except OSError as error:
            self.failure = f"recording to '{self.path}' could not be finished: {error.strerror}"
        with contextlib.suppress(OSError):
            self._stream.close()
