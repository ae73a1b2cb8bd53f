"""The end of an MCAP file: summary, index and footer (https://mcap.dev/spec)."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
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
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from mbd_sim.recording.mcap_scanner import MAGIC

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

    def file_end(self, position: int) -> bytes:
        """Return everything that follows the last chunk's message indexes, which end at byte `position`."""
        data_end = encoded(DataEnd(0))
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
