"""Writes an MCAP file in complete chunks, and ends it in whatever way the disk permits.

The recorder and the changed runs of `rerun-with` write with it. It replaces `mcap.writer.Writer`, which keeps a Python
object for each chunk: in runs of many hours the garbage collector traverses them all (18 ms for those of one hour)
while every thread waits. Here the index is kept in the encoded form in which it will be written.
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

from mbd_sim.recording.durable_file import DurableFile
from mbd_sim.recording.mcap_scanner import MAGIC
from mbd_sim.recording.mcap_summary import Summary, attachment_index, chunk_index, encoded
from mbd_sim.recording.recorded_file import RUN_METADATA
from mbd_sim.recording.recovery import recover
from mbd_sim.recording.rosbag2_metadata import FileStatistics

CHUNK_SIZE = 1 << 20  # bytes of messages after which a chunk is written
RESERVE = 1 << 20  # bytes left free on a disk, so that the end of the file still fits, and
INDEX_RESERVE = 256  # bytes of it for each chunk
ATTACHMENT = "mechanism.yaml"
_MESSAGE = struct.Struct("<BQHIQQ")  # a message's record up to its payload: 22 bytes of it follow opcode and length
_INDEX_ENTRY = struct.Struct("<QQ")  # log time, and offset in the chunk
_MESSAGE_INDEX = struct.Struct("<BQHI")  # its record up to the entries


class DiskNearlyFullError(OSError):
    """So little space is left on the disk that the file should be finished."""


class OutputFile(Protocol):
    """The file written to; see `DurableFile`."""

    def write(self, data: bytes, /) -> int:
        """Write all of the data."""
        ...

    def tell(self) -> int:
        """Return the number of bytes written."""
        ...

    def check(self) -> None:
        """Raise an error that occurred in the background."""
        ...

    def free(self) -> int | None:
        """Return the number of bytes left on the disk."""
        ...

    def sync(self) -> None:
        """Force the data to the disk."""
        ...

    def close(self) -> None:
        """Close the file."""
        ...


class WrittenTopic(Protocol):
    """The description of a topic in a file: see `Topic` and `RecordedTopic`."""

    @property
    def name(self) -> str:
        """The absolute name."""
        ...

    @property
    def type(self) -> str:
        """The type, such as `std_msgs/msg/String`."""
        ...

    @property
    def qos(self) -> str:
        """The offered QoS profiles in rosbag2's YAML."""
        ...

    @property
    def definition(self) -> str:
        """The definition of the type as in a `ros2msg` schema."""
        ...

    @property
    def hash(self) -> str:
        """The REP 2011 hash of the type, or ""."""
        ...


class McapWriter:
    """Writes the mechanism's file and the metadata first, so that they survive a kill; then chunks of messages."""

    def __init__(
        self, path: Path, topics: Sequence[WrittenTopic], open_file: Callable[[Path], OutputFile] = DurableFile
    ) -> None:
        """Open an empty file.

        :raises OSError: it cannot be opened.
        """
        self.path = path
        self.statistics = FileStatistics(path)
        self.size = 0
        self._file = open_file(path)
        self._topics = topics
        types = list(dict.fromkeys(topic.type for topic in topics))
        definitions = {topic.type: topic.definition.encode() for topic in topics}
        self._schemas = [Schema(n, definitions[name], "ros2msg", name) for n, name in enumerate(types, 1)]
        self._channels = [
            Channel(
                id=number,
                topic=topic.name,
                message_encoding="cdr",
                metadata={"offered_qos_profiles": topic.qos, "topic_type_hash": topic.hash},
                schema_id=types.index(topic.type) + 1,
            )
            for number, topic in enumerate(topics, 1)
        ]
        self._compressor = zstandard.ZstdCompressor()
        self._chunk, self._entries = bytearray(), [bytearray() for _ in topics]
        self._first_ns = self._last_ns = 0  # of the chunk
        self._empty = True  # apart from definitions, which alone are no reason to write a chunk
        self._index, self._chunk_count = bytearray(), 0
        self._summary: Callable[[], Summary]

    def begin(self, mechanism_text: str, metadata: Mapping[str, str]) -> None:
        """Write the header, the mechanism's file and the metadata.

        :raises OSError: they cannot be written.
        """
        now = time.time_ns()
        attachment = Attachment(now, now, ATTACHMENT, "application/yaml", mechanism_text.encode())
        head, attached = MAGIC + encoded(Header("ros2", "mbd_sim")), encoded(attachment)
        attachments = [attachment_index(attachment, len(head), len(attached))]
        described = encoded(Metadata(RUN_METADATA, dict(metadata)))
        metadata_index = [MetadataIndex(len(head) + len(attached), len(described), RUN_METADATA)]
        self._file.write(head + attached + described)  # in one call: a kill leaves all of it, or nothing
        for definition in (*self._schemas, *self._channels):
            self._chunk += encoded(definition)
        self._summary = lambda: Summary(
            schemas=self._schemas,
            channels=self._channels,
            attachments=attachments,
            metadata=metadata_index,
            chunks=bytes(self._index),
            chunk_count=self._chunk_count,
            counts={number + 1: count for number, count in self.statistics.counts.items()},
            first_ns=self.statistics.first_ns,
            last_ns=self.statistics.last_ns,
        )
        self._written()

    def add(self, topic: int, payload: bytes, time_ns: int, sequence: int) -> None:
        """Add a message of a topic, given by its number, to the chunk.

        :raises OSError: the chunk was full and cannot be written.
        :raises DiskNearlyFullError: the chunk was full and has been written, but little space is left.
        """
        if self._empty:
            self._first_ns = self._last_ns = time_ns
        elif time_ns > self._last_ns:
            self._last_ns = time_ns
        elif time_ns < self._first_ns:
            self._first_ns = time_ns
        chunk = self._chunk
        self._entries[topic] += _INDEX_ENTRY.pack(time_ns, len(chunk))
        chunk += _MESSAGE.pack(Opcode.MESSAGE, 22 + len(payload), topic + 1, sequence, time_ns, time_ns)
        chunk += payload
        self._empty = False
        if len(chunk) > CHUNK_SIZE:
            self.flush()

    def flush(self) -> None:
        """Write the chunk, so that its messages survive a kill.

        :raises OSError: it cannot be written.
        :raises DiskNearlyFullError: it has been written, but little space is left.
        """
        self._write_chunk()
        free = self._file.free()
        if free is not None and free < RESERVE + INDEX_RESERVE * self._chunk_count:
            raise DiskNearlyFullError(f"only {free / 1e6:.1f} MB are left on the disk")

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
        offset, length = self._file.tell(), len(record)
        index = chunk_index(chunk, offset, length)
        for number, entries in enumerate(self._entries):
            if entries:
                index.message_index_offsets[number + 1] = offset + len(record)
                record += _MESSAGE_INDEX.pack(Opcode.MESSAGE_INDEX, 2 + 4 + len(entries), number + 1, len(entries))
                record += entries
        index.message_index_length = len(record) - length
        self._file.write(bytes(record))
        self._index += encoded(index)
        self._chunk_count += 1
        counts = [len(entries) // _INDEX_ENTRY.size for entries in self._entries]
        self.statistics.add(counts, self._first_ns, self._last_ns)
        for entries in self._entries:
            entries.clear()
        self._chunk.clear()
        self._empty = True
        self._written()

    def sync(self) -> None:
        """Force the written data to the disk, however long it takes; from any thread."""
        self._file.sync()

    def finish(self) -> None:
        """Write the last chunk, the summary and the index.

        :raises OSError: they cannot be written; `abandon` then saves as much as possible.
        """
        self._write_chunk()
        self._file.write(self._summary().file_end(self._file.tell()))
        self._written()

    def close(self) -> None:
        """Force the file to the disk, however long it takes, and close it.

        :raises OSError: the disk refused it.
        """
        self._file.close()

    def abandon(self) -> int:
        """Close after an error, and end the file after its last complete chunk, with an index if it fits.

        Returns how many of the added messages are not in the file.
        """
        with contextlib.suppress(OSError):
            self._file.close()
        statistics = self.statistics
        added = statistics.messages + sum(len(entries) for entries in self._entries) // _INDEX_ENTRY.size
        with contextlib.suppress(OSError, McapError, ValueError):
            if self.path.is_file() and (kept := recover(self.path)) is not None:
                statistics.counts = {n: kept.get(topic.name, 0) for n, topic in enumerate(self._topics)}
        return added - statistics.messages

    def _written(self) -> None:
        self._file.check()
        self.size = self._file.tell()
