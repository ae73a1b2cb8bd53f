"""One MCAP file while it is written: whole chunks only, and finished in whatever way the disk permits.

`mcap.writer.Writer` would do, but for runs of many hours: it keeps an object for each chunk, and the garbage collector,
which everybody waits for, looks at all of them (18 ms for those of an hour). Here the index is kept as it will be
written.
"""

from __future__ import annotations

import contextlib
import struct
import time
import zlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Protocol

import zstandard
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Header, Metadata, MetadataIndex, Schema

from mbd_sim.recording.durable_file import Stream
from mbd_sim.recording.mcap_summary import MAGIC, Summary, encoded
from mbd_sim.recording.recorded_topic import Topic
from mbd_sim.recording.recovery import attachment_index, chunk_index, recover
from mbd_sim.recording.rosbag2_metadata import Contents

CHUNK = 1 << 20  # bytes of messages in a chunk at most
RESERVE = 1 << 20  # bytes that are left free on a disk: what comes at the end of a file must find room, and
INDEX = 256  # bytes of it for each chunk
_MESSAGE = struct.Struct("<BQHIQQ")  # a message's record up to its payload: 22 bytes of it follow opcode and length
_ENTRY = struct.Struct("<QQ")  # of an index of messages: time, and place in the chunk
_INDEX = struct.Struct("<BQHI")  # its record up to the entries
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
        self._stream = open_stream(path)
        self._topics = topics
        kinds = list(dict.fromkeys(topic.type for topic in topics))
        definitions = {topic.type: topic.definition.encode() for topic in topics}
        self._schemas = [Schema(n, definitions[kind], "ros2msg", kind) for n, kind in enumerate(kinds, 1)]
        self._channels = [
            Channel(
                id=number,
                topic=topic.name,
                message_encoding="cdr",
                metadata={"offered_qos_profiles": topic.qos, "topic_type_hash": topic.hash},
                schema_id=kinds.index(topic.type) + 1,
            )
            for number, topic in enumerate(topics, 1)
        ]
        self._compressor = zstandard.ZstdCompressor()
        self._chunk, self._entries = bytearray(), [bytearray() for _ in topics]
        self._first_ns = self._last_ns = 0  # of the chunk
        self._empty = True  # but for definitions, which are no reason to write it
        self._index, self._chunks = bytearray(), 0
        self._summary: Callable[[], Summary]

    def begin(self, mechanism_text: str, metadata: Mapping[str, str]) -> None:
        """Write what everything else needs.

        :raises OSError: it cannot be written.
        """
        now = time.time_ns()
        attachment = Attachment(now, now, ATTACHMENT, "application/yaml", mechanism_text.encode())
        head, record = MAGIC + encoded(Header("ros2", "mbd_sim")), encoded(attachment)
        attachments = [attachment_index(attachment, len(head), len(record))]
        about = encoded(Metadata(ABOUT, dict(metadata)))
        described = [MetadataIndex(len(head) + len(record), len(about), ABOUT)]
        self._stream.write(head + record + about)  # in one go: all of it survives a kill, or nothing
        for definition in (*self._schemas, *self._channels):
            self._chunk += encoded(definition)
        self._summary = lambda: Summary(
            schemas=self._schemas,
            channels=self._channels,
            attachments=attachments,
            metadata=described,
            chunks=bytes(self._index),
            chunk_count=self._chunks,
            counts={number + 1: count for number, count in self.contents.counts.items()},
            first_ns=self.contents.first_ns,
            last_ns=self.contents.last_ns,
        )
        self._written()

    def add(self, topic: int, payload: bytes, time_ns: int, sequence: int) -> None:
        """Put a message of a topic, by its number, into the chunk.

        :raises OSError: the chunk was full and cannot be written; or `NoRoomError`, then it has been.
        """
        if self._empty:
            self._first_ns = self._last_ns = time_ns
        elif time_ns > self._last_ns:
            self._last_ns = time_ns
        elif time_ns < self._first_ns:
            self._first_ns = time_ns
        chunk = self._chunk
        self._entries[topic] += _ENTRY.pack(time_ns, len(chunk))
        chunk += _MESSAGE.pack(Opcode.MESSAGE, 22 + len(payload), topic + 1, sequence, time_ns, time_ns)
        chunk += payload
        self._empty = False
        if len(chunk) > CHUNK:
            self.flush()

    def flush(self) -> None:
        """Write the chunk, so that a kill cannot take it away any more.

        :raises OSError: it cannot be written; or `NoRoomError`, then it has been.
        """
        self._write_chunk()
        free = self._stream.free()
        if free is not None and free < RESERVE + INDEX * self._chunks:
            raise NoRoomError(f"only {free / 1e6:.1f} MB are left on the disk")

    def _write_chunk(self) -> None:
        if self._empty:
            return
        content = bytes(self._chunk)
        chunk = Chunk(
            compression="zstd",
            data=self._compressor.compress(content),
            message_start_time=self._first_ns,
            message_end_time=self._last_ns,
            uncompressed_crc=zlib.crc32(content),
            uncompressed_size=len(content),
        )
        record = bytearray(encoded(chunk))
        at, length = self._stream.tell(), len(record)
        index = chunk_index(chunk, at, length)
        for number, entries in enumerate(self._entries):
            if entries:
                index.message_index_offsets[number + 1] = at + len(record)
                record += _INDEX.pack(Opcode.MESSAGE_INDEX, 2 + 4 + len(entries), number + 1, len(entries)) + entries
        index.message_index_length = len(record) - length
        self._stream.write(bytes(record))
        self._index += encoded(index)
        self._chunks += 1
        self.contents.take([len(entries) // _ENTRY.size for entries in self._entries], self._first_ns, self._last_ns)
        for entries in self._entries:
            entries.clear()
        self._chunk.clear()
        self._empty = True
        self._written()

    def sync(self) -> None:
        """Put on the disk what has been written, however long it takes; from any thread."""
        self._stream.sync()

    def finish(self) -> None:
        """Write the last chunk, the summary and the index.

        :raises OSError: that was not possible; `give_up` then leaves what can be left.
        """
        self._write_chunk()
        self._stream.write(self._summary().tail(self._stream.tell()))
        self._written()

    def close(self) -> None:
        """Put it on the disk, however long that takes, and close.

        :raises OSError: the disk refused it.
        """
        self._stream.close()

    def give_up(self) -> int:
        """Close after an error, and end the file after its last whole chunk, with an index where there is room for it.

        Returns how many messages were taken that are not in the file.
        """
        with contextlib.suppress(OSError):
            self._stream.close()
        contents = self.contents
        before = contents.messages + sum(len(entries) for entries in self._entries) // _ENTRY.size
        with contextlib.suppress(OSError, McapError, ValueError):
            if self.path.is_file() and (kept := recover(self.path)) is not None:
                contents.counts = {n: kept.get(topic.name, 0) for n, topic in enumerate(self._topics)}
        return before - contents.messages

    def _written(self) -> None:
        self._stream.check()
        self.size = self._stream.tell()
