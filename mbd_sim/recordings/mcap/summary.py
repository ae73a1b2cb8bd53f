"""The end of an MCAP file: summary, index and footer (https://mcap.dev/spec), and the records that they describe.

While a file is being written, the index of its chunks is kept in the encoded form in which the file will contain it. It
holds no Python object for each chunk: in runs of many hours the garbage collector would traverse them all.
"""

from __future__ import annotations

import errno
import struct
import zlib
from array import array
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    MessageIndex,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from mbd_sim.recordings.mcap.scanner import MAGIC, Definitions

DISK_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
FREED_AT_MOST = 1 << 15  # bytes of chunks, besides its own size, that the end of a file may replace on a full disk
FREED_IN_VAIN = 1 << 13  # bytes after which the disk, if it still accepts nothing, is not merely full
_FOOTER_START = struct.Struct("<BQQQ")  # the footer's record up to the checksum


@dataclass(frozen=True)
class Summary:
    """The contents of a file: `chunks` are the encoded chunk indexes, `counts` the numbers of messages by channel."""

    schemas: Sequence[Schema]
    channels: Sequence[Channel]
    attachments: Sequence[AttachmentIndex]
    metadata: Sequence[MetadataIndex]
    chunks: bytes
    chunk_count: int
    counts: Mapping[int, int]
    first_ns: int
    last_ns: int

    def file_end(self, position: int, crc: int) -> bytes:
        """Return everything that follows the last chunk's message indexes, which end at byte `position`.

        `crc` is the CRC-32 of all bytes before, or 0 if it is not known.
        """
        data_end = encoded(DataEnd(crc))
        start = position + len(data_end)
        groups: list[tuple[Opcode, bytes]] = [
            (Opcode.SCHEMA, _concatenated(self.schemas)),
            (Opcode.CHANNEL, _concatenated(self.channels)),
            (Opcode.STATISTICS, encoded(self._statistics())),
            (Opcode.CHUNK_INDEX, self.chunks),
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

    def _statistics(self) -> Statistics:
        return Statistics(
            attachment_count=len(self.attachments),
            channel_count=len(self.channels),
            channel_message_counts=dict(self.counts),
            chunk_count=self.chunk_count,
            message_count=sum(self.counts.values()),
            metadata_count=len(self.metadata),
            message_start_time=self.first_ns,
            message_end_time=self.last_ns,
            schema_count=len(self.schemas),
        )


def may_replace_chunks(error: OSError, end_size: int, freed: int, accepted: int) -> bool:
    """Whether more chunks should make room for the end of a file of `end_size` bytes, after `freed` bytes of them.

    :param error: that of the last attempt to write the end, of which the disk accepted the first `accepted` bytes.
    """
    in_vain = not accepted and freed > FREED_IN_VAIN
    return error.errno in DISK_FULL and not in_vain and freed <= end_size + FREED_AT_MOST


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


@dataclass
class IndexedChunk:
    """A chunk as its index should describe it, and the number of its messages by channel."""

    index: ChunkIndex
    counts: dict[int, int]


@dataclass
class DataSection:
    """The undamaged records of a file; they end at byte `end`.

    If the file is cut off or damaged after the content of a chunk, `missing_indexes` are the indexes of the messages of
    that chunk, which belong at `end`.

    `index_problem` is damage that new indexes repair, `content_problem` damage that is confined to one record and
    cannot be repaired, and `problem` says why the records end before the end of the data section. All are "" if absent.
    """

    end: int = len(MAGIC)
    missing_indexes: bytes = b""
    definitions: Definitions = field(default_factory=Definitions)
    chunks: list[IndexedChunk] = field(default_factory=list)
    attachments: list[AttachmentIndex] = field(default_factory=list)
    metadata: list[MetadataIndex] = field(default_factory=list)
    unchunked: Counter[int] = field(default_factory=Counter)  # number of messages outside of chunks, by channel
    times: list[int] = field(default_factory=list)  # of the first and the last message outside of chunks
    index_problem: str = ""
    content_problem: str = ""
    problem: str = ""
    has_header: bool = False
    crc_agrees: bool = True

    @property
    def counts(self) -> dict[int, int]:
        """The number of messages by channel."""
        total = Counter(self.unchunked)
        for chunk in self.chunks:
            total.update(chunk.counts)
        return dict(total)

    def counts_by_topic(self) -> dict[str, int]:
        """Return the number of messages by topic."""
        counts, found = self.counts, Counter[str]()
        for number, channel in self.definitions.channels.items():
            found[channel.topic] += counts.get(number, 0)
        return dict(found)

    def drop_last_chunk(self) -> None:
        """End before the last chunk."""
        self.end, self.missing_indexes = self.chunks.pop().index.chunk_start_offset, b""

    def replace_last_indexes(self, entries: Mapping[int, list[tuple[int, int]]]) -> None:
        """End after the content of the last chunk; `entries` are times and offsets of its messages, by channel."""
        chunk = self.chunks[-1].index
        self.end = chunk.chunk_start_offset + chunk.chunk_length
        self.missing_indexes, chunk.message_index_offsets = b"", {}
        for channel, each in sorted(entries.items()):
            chunk.message_index_offsets[channel] = self.end + len(self.missing_indexes)
            self.missing_indexes += encoded(MessageIndex(channel, each))
        chunk.message_index_length = len(self.missing_indexes)

    def summary(self) -> Summary:
        """Return the summary of a file that ends here."""
        indexes = [chunk.index for chunk in self.chunks]
        filled = [chunk.index for chunk in self.chunks if chunk.counts]
        starts = [*self.times[:1], *(index.message_start_time for index in filled)]
        ends = [*self.times[1:], *(index.message_end_time for index in filled)]
        return Summary(
            schemas=list(self.definitions.schemas.values()),
            channels=list(self.definitions.channels.values()),
            attachments=self.attachments,
            metadata=self.metadata,
            chunks=b"".join(encoded(index) for index in indexes),
            chunk_count=len(indexes),
            counts=self.counts,
            first_ns=min(starts, default=0),
            last_ns=max(ends, default=0),
        )


_PLACE = struct.Struct("<QQQQQ")  # start and end in the file, end in the encoded index, first and last log time


class WrittenChunks:
    """The chunks that are completely in the file, with the number of messages of each topic."""

    def __init__(self, topic_count: int) -> None:
        self._topic_count = topic_count
        self._encoded = bytearray()
        self._places = bytearray()
        self._counts = array("I")  # by chunk, then by topic
        self.totals = [0] * topic_count
        self.first_ns = self.last_ns = 0  # log times of the earliest and the latest message

    def __len__(self) -> int:
        """Return the number of chunks."""
        return len(self._places) // _PLACE.size

    @property
    def index(self) -> bytes:
        """The encoded chunk index records."""
        return bytes(self._encoded)

    def add(self, index: ChunkIndex, counts: Sequence[int]) -> None:
        """Add a chunk, with its messages by topic number."""
        self._encoded += encoded(index)
        start, first_ns, last_ns = index.chunk_start_offset, index.message_start_time, index.message_end_time
        end = start + index.chunk_length + index.message_index_length
        self.first_ns = min(self.first_ns, first_ns) if len(self) else first_ns
        self.last_ns = max(self.last_ns, last_ns)
        self._places += _PLACE.pack(start, end, len(self._encoded), first_ns, last_ns)
        self._counts.extend(counts)
        self.totals = [total + count for total, count in zip(self.totals, counts, strict=True)]

    def drop_last(self) -> tuple[int, int]:
        """Forget the last chunk; return its start and end in the file."""
        start, end, _, _, _ = _PLACE.unpack_from(self._places, len(self._places) - _PLACE.size)
        del self._places[-_PLACE.size :]
        counts = self._counts[-self._topic_count :]
        del self._counts[-self._topic_count :]
        self.totals = [total - count for total, count in zip(self.totals, counts, strict=True)]
        places = list(_PLACE.iter_unpack(self._places))
        del self._encoded[places[-1][2] if places else 0 :]
        self.first_ns = min((first_ns for _, _, _, first_ns, _ in places), default=0)
        self.last_ns = max((last_ns for _, _, _, _, last_ns in places), default=0)
        return start, end
