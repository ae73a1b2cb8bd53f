"""What ends an MCAP file: the summary, the index, and where they begin (https://mcap.dev/spec)."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import AttachmentIndex, Channel, DataEnd, Footer, MetadataIndex, Schema, Statistics, SummaryOffset

MAGIC = b"\x89MCAP0\r\n"


@dataclass(frozen=True)
class Summary:
    """What a file holds. `chunks` are the encoded records of its chunks' index, `counts` its messages by channel."""

    schemas: Sequence[Schema]
    channels: Sequence[Channel]
    attachments: Sequence[AttachmentIndex]
    metadata: Sequence[MetadataIndex]
    chunks: bytes
    chunk_count: int
    counts: Mapping[int, int]
    first_ns: int
    last_ns: int

    def tail(self, end: int) -> bytes:
        """All that follows the last chunk's index, which ends at `end`."""
        ended = encoded(DataEnd(0))
        start = end + len(ended)
        groups: list[tuple[Opcode, bytes]] = [
            (Opcode.SCHEMA, _joined(self.schemas)),
            (Opcode.CHANNEL, _joined(self.channels)),
            (Opcode.STATISTICS, encoded(self._statistics())),
            (Opcode.CHUNK_INDEX, self.chunks),
            (Opcode.ATTACHMENT_INDEX, _joined(self.attachments)),
            (Opcode.METADATA_INDEX, _joined(self.metadata)),
        ]
        written, offsets = b"", b""
        for opcode, group in groups:
            if group:
                offsets += encoded(SummaryOffset(opcode, start + len(written), len(group)))
                written += group
        offset_start = start + len(written)
        written += offsets
        # The check sum covers the summary and the footer up to the sum itself.
        head = struct.pack("<BQQQ", Opcode.FOOTER, 8 + 8 + 4, start, offset_start)
        footer = Footer(start, offset_start, zlib.crc32(head, zlib.crc32(written)))
        return ended + written + encoded(footer) + MAGIC

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
    """A record of `mcap.records` as it stands in a file."""
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())


def _joined(records: Iterable[Any]) -> bytes:
    return b"".join(encoded(record) for record in records)
