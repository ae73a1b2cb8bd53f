"""What an MCAP file contains, and its end, which says so: summary, index and footer (https://mcap.dev/spec).

The indexes of chunks are kept as the bytes that the file will contain, without a Python object for each chunk: in runs
of many hours the garbage collector would traverse them all (18 ms for those of one hour) while every thread waits.
"""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    MetadataIndex,
    Statistics,
    SummaryOffset,
)

from mbd_sim.recordings.mcap.scanner import MAGIC, RECORD_HEADER, Definitions, data_stream

_FOOTER_START = struct.Struct("<BQQQ")  # the footer's record up to the checksum
_CHUNK_TIMES = struct.Struct("<QQQQI")  # an index of a chunk: first and last time, offset, length, size of the offsets
_MESSAGE_INDEX, _ENTRY = RECORD_HEADER.size + 2 + 4, 8 + 8  # bytes of an index of messages, and of each entry


@dataclass
class FileStatistics:
    """The number of messages in one file, by channel, and the log times of the first and the last in ns."""

    path: Path
    counts: Counter[int] = field(default_factory=Counter)
    first_ns: int = 0
    last_ns: int = 0

    @property
    def messages(self) -> int:
        """The number of all messages."""
        return self.counts.total()

    def add(self, counts: Mapping[int, int], first_ns: int, last_ns: int) -> None:
        """Count more messages, by channel, with the times of the earliest and the latest of them."""
        if not any(counts.values()):
            return
        if not self.messages:
            self.first_ns, self.last_ns = first_ns, last_ns
        self.first_ns, self.last_ns = min(self.first_ns, first_ns), max(self.last_ns, last_ns)
        self.counts = self.counts + Counter(counts)  # another one, since other threads read it


@dataclass
class Span:
    """Consecutive messages outside of chunks: where they begin and end in the file, and their log times in ns."""

    begin: int
    end: int
    first_ns: int
    last_ns: int


@dataclass
class Contents:
    """The complete records of a file, which end at byte `end`.

    `chunks` are the encoded indexes of its chunks, `outside` the messages that are in none.
    """

    statistics: FileStatistics
    end: int = 0
    definitions: Definitions = field(default_factory=Definitions)
    attachments: list[AttachmentIndex] = field(default_factory=list)
    metadata: list[MetadataIndex] = field(default_factory=list)
    chunks: list[bytes] = field(default_factory=list)
    outside: list[Span] = field(default_factory=list)

    def add_chunk(self, index: ChunkIndex, counts: Mapping[int, int]) -> None:
        """Add a chunk, with its messages by channel."""
        self.chunks.append(encoded(index))
        self.statistics.add(counts, index.message_start_time, index.message_end_time)

    def drop_last_chunk(self) -> int:
        """End before the last chunk; return how many bytes that frees."""
        index = chunk_index_of(self.chunks.pop())
        places = [_CHUNK_TIMES.unpack_from(record, RECORD_HEADER.size) for record in self.chunks]
        first_ns = [*(first for first, *_, size in places if size), *(span.first_ns for span in self.outside)]
        last_ns = [*(last for _, last, *_, size in places if size), *(span.last_ns for span in self.outside)]
        self.statistics.counts = self.statistics.counts - counts_of(index)
        self.statistics.first_ns, self.statistics.last_ns = min(first_ns, default=0), max(last_ns, default=0)
        freed: int = self.end - index.chunk_start_offset
        self.end -= freed
        return freed

    def counts_by_topic(self) -> dict[str, int]:
        """Return the number of messages by topic."""
        found = Counter[str]()
        for number, channel in self.definitions.channels.items():
            found[channel.topic] += self.statistics.counts[number]
        return dict(found)

    def file_end(self, position: int, crc: int) -> bytes:
        """Return everything that follows the last chunk's message indexes, which end at byte `position`.

        `crc` is the CRC-32 of all bytes before, or 0 if it is not known.
        """
        data_end = encoded(DataEnd(crc))
        start = position + len(data_end)
        groups = [
            (Opcode.SCHEMA, _concatenated(self.definitions.schemas.values())),
            (Opcode.CHANNEL, _concatenated(self.definitions.channels.values())),
            (Opcode.STATISTICS, encoded(self.statistics_record())),
            (Opcode.CHUNK_INDEX, b"".join(self.chunks)),
            (Opcode.ATTACHMENT_INDEX, _concatenated(self.attachments)),
            (Opcode.METADATA_INDEX, _concatenated(self.metadata)),
        ]
        summary, offsets = b"", b""
        for opcode, group in groups:
            if group:
                offsets += encoded(SummaryOffset(opcode, start + len(summary), len(group)))
                summary += group
        offsets_start = start + len(summary)
        summary += offsets
        # The checksum covers the summary, and the footer up to the checksum itself.
        footer_start = _FOOTER_START.pack(Opcode.FOOTER, 8 + 8 + 4, start, offsets_start)
        footer = Footer(start, offsets_start, zlib.crc32(footer_start, zlib.crc32(summary)))
        return data_end + summary + encoded(footer) + MAGIC

    def statistics_record(self) -> Statistics:
        """The record of the statistics in the summary."""
        return Statistics(
            attachment_count=len(self.attachments),
            channel_count=len(self.definitions.channels),
            channel_message_counts=dict(sorted(self.statistics.counts.items())),
            chunk_count=len(self.chunks),
            message_count=self.statistics.messages,
            metadata_count=len(self.metadata),
            message_start_time=self.statistics.first_ns,
            message_end_time=self.statistics.last_ns,
            schema_count=len(self.definitions.schemas),
        )


def chunk_index_of(record: bytes) -> ChunkIndex:
    """Decode the index of a chunk."""
    return ChunkIndex.read(data_stream(record[RECORD_HEADER.size :]))


def counts_of(index: ChunkIndex) -> Counter[int]:
    """The messages of a chunk by channel, by the lengths of their indexes."""
    counts, end = Counter[int](), index.chunk_start_offset + index.chunk_length + index.message_index_length
    for channel, start in sorted(index.message_index_offsets.items(), key=lambda item: -item[1]):
        counts[channel], end = (end - start - _MESSAGE_INDEX) // _ENTRY, start
    return counts


def encoded(record: Any) -> bytes:
    """Encode a record of `mcap.records`."""
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())


def attachment_index(attachment: Attachment, offset: int, length: int) -> AttachmentIndex:
    """Return the index entry of an attachment whose record begins at `offset` and has `length` bytes."""
    return AttachmentIndex(
        offset=offset,
        length=length,
        create_time=attachment.create_time,
        log_time=attachment.log_time,
        data_size=len(attachment.data),
        name=attachment.name,
        media_type=attachment.media_type,
    )


def chunk_index(chunk: Chunk, offset: int, length: int) -> ChunkIndex:
    """Return the index entry of a chunk whose record begins at `offset`, still without its message indexes."""
    return ChunkIndex(
        message_start_time=chunk.message_start_time,
        message_end_time=chunk.message_end_time,
        chunk_start_offset=offset,
        chunk_length=length,
        message_index_offsets={},
        message_index_length=0,
        compression=chunk.compression,
        compressed_size=len(chunk.data),
        uncompressed_size=chunk.uncompressed_size,
    )


def _concatenated(records: Iterable[Any]) -> bytes:
    return b"".join(encoded(record) for record in records)
