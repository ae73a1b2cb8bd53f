"""One MCAP file while it is written: whole chunks only, and finished in whatever way the disk permits."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Protocol

from mcap.exceptions import McapError
from mcap.writer import CompressionType, Writer

from mbd_sim.recording.recover import recover
from mbd_sim.recording.rosbag2 import Contents
from mbd_sim.recording.stream import Stream
from mbd_sim.recording.topics import Topic

CHUNK = 1 << 20  # bytes of messages in a chunk at most
RESERVE = 1 << 20  # bytes that are left free on a disk: what comes at the end of a file must find room, and
INDEX = 256  # bytes of it for each chunk
ATTACHMENT = "mechanism.yaml"
ABOUT = "mbd_sim"


class NoRoomError(OSError):
    """So little is left on the disk that the file should be finished."""


class Writable(Protocol):
    """What a file is written to; see `Stream`."""

    def write(self, data: bytes, /) -> int:
        """Write all of it."""
        ...

    def tell(self) -> int:
        """Bytes written."""
        ...

    def flush(self) -> None:
        """Hold nothing back."""
        ...

    def check(self) -> None:
        """Raise what went wrong in the background."""
        ...

    def free(self) -> int | None:
        """Bytes that are left."""
        ...

    def sync(self) -> None:
        """Put it on the disk."""
        ...

    def close(self) -> None:
        """End."""
        ...


class McapFile:
    """The mechanism's file and the metadata first, so that they survive a kill; then messages in compressed chunks."""

    def __init__(self, path: Path, topics: Sequence[Topic], open_stream: Callable[[Path], Writable] = Stream) -> None:
        """Open it, empty.

        :raises OSError: it cannot be opened.
        """
        self.path = path
        self.contents = Contents(path)
        self.size = 0
        self._topics = topics
        self._stream = open_stream(path)
        # Chunks are finished here, and not by size in the middle of a message.
        self._writer = Writer(self._stream, chunk_size=1 << 62, compression=CompressionType.ZSTD)
        self._channels: list[int] = []
        self._pending = self._chunks = 0

    def begin(self, mechanism_text: str, metadata: Mapping[str, str]) -> None:
        """Write what everything else needs.

        :raises OSError: it cannot be written.
        """
        now = time.time_ns()
        self._writer.start(profile="ros2", library="mbd_sim")
        self._writer.add_attachment(now, now, ATTACHMENT, "application/yaml", mechanism_text.encode())
        self._writer.add_metadata(ABOUT, dict(metadata))
        for topic in self._topics:
            schema = self._writer.register_schema(topic.type, "ros2msg", topic.definition.encode())
            about = {"offered_qos_profiles": topic.qos, "topic_type_hash": topic.hash}
            self._channels.append(self._writer.register_channel(topic.name, "cdr", schema, about))
        self._written()

    def add(self, topic: int, payload: bytes, time_ns: int, sequence: int) -> None:
        """Put a message of a topic, by its number, into the chunk.

        :raises OSError: the chunk was full and cannot be written; or `NoRoomError`, then it has been.
        """
        self._writer.add_message(
            channel_id=self._channels[topic],
            log_time=time_ns,
            publish_time=time_ns,
            sequence=sequence,
            data=payload,
        )
        contents = self.contents
        if topic not in contents.counts:
            if not contents.counts:
                contents.first_ns = contents.last_ns = time_ns
            contents.counts[topic] = 0
        contents.counts[topic] += 1
        if time_ns > contents.last_ns:
            contents.last_ns = time_ns
        elif time_ns < contents.first_ns:
            contents.first_ns = time_ns
        self._pending += len(payload) + 31
        if self._pending > CHUNK:
            self.flush()

    def flush(self) -> None:
        """Write the chunk, so that a kill cannot take it away any more.

        :raises OSError: it cannot be written; or `NoRoomError`, then it has been.
        """
        if not self._pending:
            return
        self._writer.flush()
        self._pending, self._chunks = 0, self._chunks + 1
        self._written()
        free = self._stream.free()
        if free is not None and free < RESERVE + INDEX * self._chunks:
            raise NoRoomError(f"only {free / 1e6:.1f} MB are left on the disk")

    def sync(self) -> None:
        """Put on the disk what has been written, however long it takes; from any thread."""
        self._stream.sync()

    def finish(self) -> None:
        """Write the last chunk, the summary and the index, and close.

        :raises OSError: that was not possible; `give_up` then leaves what can be left.
        """
        self._writer.finish()
        self._stream.check()
        self.size = self._stream.tell()
        self._stream.close()

    def give_up(self) -> int:
        """Close after an error, and end the file after its last whole chunk, with an index where there is room for it.

        Returns how many messages were taken that are not in the file.
        """
        with contextlib.suppress(OSError):
            self._stream.close()
        before, contents = self.contents.messages, self.contents
        contents.counts = dict.fromkeys(contents.counts, 0) if not self.size else contents.counts
        with contextlib.suppress(OSError, McapError, ValueError):
            if self.path.is_file() and (kept := recover(self.path)) is not None:
                contents.counts = {n: kept.get(topic.name, 0) for n, topic in enumerate(self._topics)}
        return before - contents.messages

    def _written(self) -> None:
        self._stream.check()
        self.size = self._stream.tell()
