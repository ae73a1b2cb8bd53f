"""Repairs, in place, a recording that was truncated by a kill or a full disk.

Complete chunks are kept. The summary and the index, without which many tools refuse a file, are rebuilt from them.
"""

from __future__ import annotations

import contextlib
import errno
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

from mcap.opcode import Opcode
from mcap.records import Attachment, AttachmentIndex, Chunk, ChunkIndex, MessageIndex, Metadata, MetadataIndex

from mbd_sim.recording.mcap_scanner import (
    MAGIC,
    PARSE_ERRORS,
    RECORD_HEADER,
    BrokenRecordError,
    ByteSource,
    Definitions,
    FileBytes,
    chunk_content,
    data_stream,
    scan_messages,
    scan_records,
)
from mbd_sim.recording.mcap_summary import Summary, attachment_index, chunk_index, encoded

_DATA_SECTION = {
    Opcode.HEADER, Opcode.SCHEMA, Opcode.CHANNEL, Opcode.CHUNK, Opcode.MESSAGE_INDEX, Opcode.ATTACHMENT, Opcode.METADATA
}  # fmt: skip
_DISK_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


@dataclass
class _IndexedChunk:
    """A chunk, and the number of messages by channel in its message indexes."""

    index: ChunkIndex
    counts: dict[int, int] = field(default_factory=dict)


@dataclass
class _CompleteRecords:
    """The complete records of a file, and the byte at which they end."""

    end: int = len(MAGIC)
    definitions: Definitions = field(default_factory=Definitions)
    chunks: list[_IndexedChunk] = field(default_factory=list)
    attachments: list[AttachmentIndex] = field(default_factory=list)
    metadata: list[MetadataIndex] = field(default_factory=list)
    last_content: bytes = b""  # uncompressed records of the last chunk

    @property
    def counts(self) -> dict[int, int]:
        """The number of messages by channel."""
        total: Counter[int] = Counter()
        for chunk in self.chunks:
            total.update(chunk.counts)
        return dict(total)

    def add(self, opcode: int, start: int, end: int, content: bytes) -> None:
        """Add a record that begins at byte `start`.

        :raises PARSE_ERRORS: it is damaged.
        """
        length = end - start
        self.definitions.add(opcode, content)
        if opcode == Opcode.ATTACHMENT:
            attachment = Attachment.read(data_stream(content))
            self.attachments.append(attachment_index(attachment, start, length))
        elif opcode == Opcode.METADATA:
            name = Metadata.read(data_stream(content)).name
            self.metadata.append(MetadataIndex(offset=start, length=length, name=name))
        elif opcode == Opcode.CHUNK:
            self._add_chunk(Chunk.read(data_stream(content)), start, length)
        elif opcode == Opcode.MESSAGE_INDEX and self.chunks:
            index, last = MessageIndex.read(data_stream(content)), self.chunks[-1]
            last.index.message_index_offsets[index.channel_id] = start
            last.index.message_index_length += length
            last.counts[index.channel_id] = len(index.records)
        self.end = end

    def _add_chunk(self, chunk: Chunk, start: int, length: int) -> None:
        records = chunk_content(chunk.data, chunk.compression, chunk.uncompressed_size, chunk.uncompressed_crc)
        if not self.chunks:  # our recorder writes all definitions at the start of the first chunk
            for opcode, begin, end in scan_records(records):
                if opcode == Opcode.MESSAGE:
                    break
                self.definitions.add(opcode, records[begin:end])
        self.last_content = records
        self.chunks.append(_IndexedChunk(chunk_index(chunk, start, length)))

    def drop_last_chunk(self) -> None:
        """End before the last chunk."""
        self.end = self.chunks.pop().index.chunk_start_offset

    def summary(self) -> Summary:
        """Return the summary of a file that ends here."""
        indexes = [chunk.index for chunk in self.chunks]
        return Summary(
            schemas=list(self.definitions.schemas.values()),
            channels=list(self.definitions.channels.values()),
            attachments=self.attachments,
            metadata=self.metadata,
            chunks=b"".join(encoded(index) for index in indexes),
            chunk_count=len(indexes),
            counts=self.counts,
            first_ns=min((index.message_start_time for index in indexes), default=0),
            last_ns=max((index.message_end_time for index in indexes), default=0),
        )


def recover(path: Path) -> dict[str, int] | None:
    """End a file of our recorder after its last complete chunk, with a summary.

    On a full disk the summary takes the place of as many chunks as necessary. Returns the number of messages by topic,
    or None if the file is complete; it is not modified then.

    :raises ValueError: this is not an MCAP file.
    :raises OSError: the file cannot be read or written.
    """
    with path.open("r+b") as stream:
        data = FileBytes(stream)
        if data[: len(MAGIC)] != MAGIC:
            raise ValueError(
                "is not an MCAP file, or was cut off before anything was written. Nothing can be recovered."
            )
        if data[-len(MAGIC) :] == MAGIC and len(data) > 2 * len(MAGIC) + RECORD_HEADER.size:
            return None
        found = _complete_records(data)
        while True:
            stream.truncate(found.end)
            stream.seek(found.end)
            try:
                stream.write(found.summary().file_end(found.end))
                stream.flush()
                break
            except OSError as error:
                if error.errno not in _DISK_FULL or not found.chunks:
                    raise
                found.drop_last_chunk()
    counts = found.counts
    return {channel.topic: counts.get(number, 0) for number, channel in found.definitions.channels.items()}


def _complete_records(data: ByteSource) -> _CompleteRecords:
    """Scan up to the first record that is damaged, incomplete, or not of the data section."""
    found = _CompleteRecords()
    with contextlib.suppress(*PARSE_ERRORS):
        for opcode, begin, end in scan_records(data, len(MAGIC)):
            if opcode not in _DATA_SECTION:
                break
            found.add(opcode, begin - RECORD_HEADER.size, end, bytes(data[begin:end]))
    if found.chunks and not _is_indexed(found):
        found.drop_last_chunk()
    return found


def _is_indexed(found: _CompleteRecords) -> bool:
    """Whether the last chunk is followed by an index of all its messages."""
    try:
        messages = sum(1 for _ in scan_messages(found.last_content))
    except BrokenRecordError:
        return False
    return sum(found.chunks[-1].counts.values()) == messages
