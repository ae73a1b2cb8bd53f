"""The end of an MCAP file: summary, index and footer (https://mcap.dev/spec)."""

from __future__ import annotations

import errno
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
