"""Records of MCAP data (https://mcap.dev/spec), what a file contains, and its end: summary, index and footer.

The data are a file, whole, truncated or damaged, or the content of a chunk. This is the only place that steps from
record to record; `reader` and `repair` interpret the records.

The indexes of chunks are kept as the bytes that the file will contain, without a Python object for each chunk: in runs
of many hours the garbage collector would traverse them all (18 ms for those of one hour) while every thread waits.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import IO, Any, Protocol

from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from mbd_sim.base.operating_system import read_at

MAGIC = b"\x89MCAP0\r\n"
RECORD_HEADER = struct.Struct("<BQ")  # opcode, length of the content
MESSAGE_HEADER = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
PARSE_ERRORS = (McapError, ValueError, OverflowError, struct.error)  # raised for a record whose content is damaged
_CRC = struct.Struct("<I")
_PIECE = 1 << 22  # bytes that are read at once
MAX_LENGTH = 1 << 32  # bytes of a record; a greater length can only be a damaged one
_OPCODES = frozenset(int(opcode) for opcode in Opcode) | frozenset(range(0x80, 0x100))  # 0x80 and above are private
_MESSAGE = int(Opcode.MESSAGE)  # members of an enumeration are slow to look up


class BrokenRecordError(ValueError):
    """A record that is incomplete or damaged; the message says where and why, without the file's name."""


class ByteSource(Protocol):
    """Random access to bytes: `bytes`, `bytearray`, or `FileBytes`."""

    def __len__(self) -> int:
        """Return the number of bytes."""
        ...

    def __getitem__(self, span: slice, /) -> bytes | bytearray:
        """Return some of the bytes; a slice beyond the end is cut there, as for `bytes`."""
        ...


class FileBytes:
    """The bytes of an open file, read on access.

    A memory map would raise SIGBUS where the file shrinks or the disk fails; this raises `OSError`.
    """

    def __init__(self, stream: IO[bytes]) -> None:
        self._descriptor = stream.fileno()
        self._size = os.fstat(self._descriptor).st_size

    def __len__(self) -> int:
        """Return the size that the file had when this was made."""
        return self._size

    def __getitem__(self, span: slice, /) -> bytes:
        """Read some of the bytes.

        :raises OSError: they cannot be read, or the file has been truncated.
        """
        start, stop, _ = span.indices(self._size)
        found = read_at(self._descriptor, stop - start, start)
        if len(found) < stop - start:
            raise OSError(None, "the file was truncated while it was being read")
        return found


@dataclass
class Definitions:
    """Schemas and channels by their numbers."""

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)

    def add(self, opcode: int, content: bytes | bytearray) -> None:
        """Add a record if it is a schema or a channel.

        :raises PARSE_ERRORS: its content is damaged.
        """
        if opcode == Opcode.SCHEMA:
            schema = Schema.read(data_stream(content))
            self.schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
            channel = Channel.read(data_stream(content))
            self.channels[channel.id] = channel


def data_stream(content: bytes | bytearray) -> ReadDataStream:
    """Return the content of a record in the form in which `mcap.records` reads it."""
    return ReadDataStream(BytesIO(content), calculate_crc=True)


def scan_records(data: ByteSource, start: int = 0) -> Iterator[tuple[int, int, int]]:
    """Yield opcode, start and end of the content of each record, in order.

    Stops without an error where fewer bytes remain than the header of a record has.

    :raises BrokenRecordError: a record extends beyond the end of the data, or there is none where one should begin.
    """
    end, size, header_size = start, len(data), RECORD_HEADER.size
    read_header, opcodes, max_length = _header_reader(data), _OPCODES, MAX_LENGTH
    while (begin := end + header_size) <= size:
        opcode, length = read_header(end)
        end = begin + length
        if end > size or opcode not in opcodes or length > max_length:
            position = begin - header_size
            if opcode not in opcodes or length > max_length:
                raise BrokenRecordError(f"damaged: there is no valid record at byte {position}")
            raise BrokenRecordError(
                f"cut off: it ends at byte {size}, within the record that begins at byte {position}"
            )
        yield opcode, begin, end


def _header_reader(data: ByteSource) -> Callable[[int], tuple[int, int]]:
    """Return a function that reads opcode and length of the record at a position; the fastest for bytes."""
    if isinstance(data, bytes):
        return partial(RECORD_HEADER.unpack_from, data)
    return lambda position: RECORD_HEADER.unpack(data[position : position + RECORD_HEADER.size])


def scan_messages(data: bytes) -> Iterator[tuple[int, int, int, bytes]]:
    """Yield channel, sequence number, log time in ns and payload of each message in the content of a chunk.

    :raises BrokenRecordError: a record is incomplete.
    """
    unpack, header = MESSAGE_HEADER.unpack_from, MESSAGE_HEADER.size
    for opcode, begin, end in scan_records(data):
        if opcode == _MESSAGE:
            if end - begin < header:
                raise BrokenRecordError("damaged: a message is too short")
            channel, sequence, log_time, _ = unpack(data, begin)
            yield channel, sequence, log_time, data[begin + header : end]


def attachment_is_intact(content: bytes | bytearray) -> bool:
    """Whether the content of an attachment's record agrees with the CRC at its end (0: none)."""
    (crc,) = _CRC.unpack(content[-_CRC.size :])
    return not crc or zlib.crc32(content[: -_CRC.size]) == crc


def crc_of(data: ByteSource, end: int) -> int:
    """Return the CRC-32 of the first `end` bytes."""
    crc = 0
    for start in range(0, end, _PIECE):
        crc = zlib.crc32(data[start : min(start + _PIECE, end)], crc)
    return crc


def chunk_content(stored: bytes, compression: str, size: int, crc: int) -> bytes:
    """Decompress the records of a chunk; `size` and `crc` (0: none) are those of the uncompressed records.

    :raises BrokenRecordError: they cannot be decompressed, or the checksum differs.
    """
    try:
        content = _decompressed(stored, compression, size)
    except Exception as error:  # zstandard and lz4 raise their own errors
        raise BrokenRecordError(f"cannot be decompressed ({error})") from error
    if crc and zlib.crc32(content) != crc:
        raise BrokenRecordError("fails its CRC check")
    return content


def _decompressed(stored: bytes, compression: str, size: int) -> bytes:
    if compression == "zstd":
        import zstandard

        return bytes(zstandard.ZstdDecompressor().decompress(stored, max_output_size=size))
    if compression == "lz4":
        import lz4.frame

        return bytes(lz4.frame.decompress(stored))
    if compression:
        raise ValueError(f"compression '{compression}' is unknown")
    return stored


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
