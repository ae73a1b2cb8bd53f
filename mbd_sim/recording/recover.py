"""A recording that was cut off, by a kill or a full disk, made whole again in its place.

What is kept are whole chunks; the summary and the index, without which many tools refuse a file, are made anew from
them (the layout is that of https://mcap.dev/spec).
"""

from __future__ import annotations

import errno
import mmap
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Any

import zstandard
from mcap.data_stream import ReadDataStream, RecordBuilder
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
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

MAGIC = b"\x89MCAP0\r\n"
_HEAD = struct.Struct("<BQ")  # opcode and length of a record
_DATA = {Opcode.HEADER, Opcode.SCHEMA, Opcode.CHANNEL, Opcode.CHUNK, Opcode.MESSAGE_INDEX, Opcode.ATTACHMENT}
_DATA |= {Opcode.METADATA}
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


@dataclass
class _Chunk:
    index: ChunkIndex
    counts: dict[int, int] = field(default_factory=dict)


@dataclass
class _Found:
    """What is whole in a file, and where it ends."""

    end: int = len(MAGIC)
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    chunks: list[_Chunk] = field(default_factory=list)
    attachments: list[AttachmentIndex] = field(default_factory=list)
    metadata: list[MetadataIndex] = field(default_factory=list)


def recover(path: Path) -> dict[str, int] | None:
    """End a file of our recorder after its last whole chunk, with a summary; where need be with fewer chunks.

    Returns how many messages it holds by topic, or None where it was whole: then it stays as it is.

    :raises ValueError: this is no MCAP file.
    :raises OSError: it cannot be read or written.
    """
    with path.open("r+b") as stream:
        if stream.read(len(MAGIC)) != MAGIC:
            raise ValueError(f"'{path}' is no MCAP file.")
        with mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data:
            if data[-len(MAGIC) :] == MAGIC and len(data) > 2 * len(MAGIC) + _HEAD.size:
                return None
            found = _scan(data)
        while True:
            stream.truncate(found.end)
            stream.seek(found.end)
            try:
                stream.write(_tail(found))
                stream.flush()
                break
            except OSError as error:
                if error.errno not in _FULL or not found.chunks:
                    raise
                found.end = found.chunks.pop().index.chunk_start_offset
    counts = _counts(found)
    return {channel.topic: counts.get(number, 0) for number, channel in found.channels.items()}


def _records(data: Any, start: int = 0) -> Iterator[tuple[int, int, int]]:
    """Opcode, begin and end of the content of each whole record."""
    while start + _HEAD.size <= len(data):
        opcode, length = _HEAD.unpack_from(data, start)
        end = start + _HEAD.size + length
        if end > len(data):
            return
        yield opcode, start + _HEAD.size, end
        start = end


def _scan(data: Any) -> _Found:
    found = _Found()
    for opcode, begin, end in _records(data, len(MAGIC)):
        if opcode not in _DATA:
            break
        start = begin - _HEAD.size
        content = ReadDataStream(BytesIO(data[begin:end]))
        if opcode == Opcode.ATTACHMENT:
            attachment = Attachment.read(content)
            found.attachments.append(_attachment_index(attachment, start, end - start))
        elif opcode == Opcode.METADATA:
            found.metadata.append(MetadataIndex(offset=start, length=end - start, name=Metadata.read(content).name))
        elif opcode == Opcode.CHUNK:
            chunk = Chunk.read(content)
            if not _take(chunk, found):
                break
            found.chunks.append(_Chunk(_chunk_index(chunk, start, end - start)))
        elif opcode == Opcode.MESSAGE_INDEX and found.chunks:
            index, last = MessageIndex.read(content), found.chunks[-1]
            last.index.message_index_offsets[index.channel_id] = start
            last.index.message_index_length += end - start
            last.counts[index.channel_id] = len(index.records)
        found.end = end
    if found.chunks:
        _complete(found, data)
    return found


def _take(chunk: Chunk, found: _Found) -> bool:
    """Collect the schemas and channels of a chunk; whether it is what was written."""
    try:
        content = _content(chunk)
    except zstandard.ZstdError:
        return False
    if chunk.uncompressed_crc and zlib.crc32(content) != chunk.uncompressed_crc:
        return False
    if found.chunks:  # the first chunk brings them all
        return True
    for opcode, begin, end in _records(content):
        if opcode == Opcode.MESSAGE:
            break
        record = ReadDataStream(BytesIO(content[begin:end]))
        if opcode == Opcode.SCHEMA:
            schema = Schema.read(record)
            found.schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
            channel = Channel.read(record)
            found.channels[channel.id] = channel
    return True


def _content(chunk: Chunk) -> bytes:
    if chunk.compression == "zstd":
        return bytes(zstandard.decompress(chunk.data, max_output_size=chunk.uncompressed_size))
    return bytes(chunk.data)


def _complete(found: _Found, data: Any) -> None:
    """The last chunk may be whole and its index not: leave the chunk out then."""
    last = found.chunks[-1]
    start = last.index.chunk_start_offset
    content = _content(Chunk.read(ReadDataStream(BytesIO(data[start + _HEAD.size : start + last.index.chunk_length]))))
    messages = sum(opcode == Opcode.MESSAGE for opcode, _, _ in _records(content))
    if sum(last.counts.values()) != messages:
        found.chunks.pop()
        found.end = start


def _attachment_index(attachment: Attachment, offset: int, length: int) -> AttachmentIndex:
    return AttachmentIndex(
        offset=offset,
        length=length,
        create_time=attachment.create_time,
        log_time=attachment.log_time,
        data_size=len(attachment.data),
        name=attachment.name,
        media_type=attachment.media_type,
    )


def _chunk_index(chunk: Chunk, offset: int, length: int) -> ChunkIndex:
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


def _counts(found: _Found) -> dict[int, int]:
    counts: dict[int, int] = {}
    for chunk in found.chunks:
        for channel, count in chunk.counts.items():
            counts[channel] = counts.get(channel, 0) + count
    return counts


def _tail(found: _Found) -> bytes:
    """What follows the last chunk: the end of the data, the summary, and where its parts begin."""
    counts = _counts(found)
    statistics = Statistics(
        attachment_count=len(found.attachments),
        channel_count=len(found.channels),
        channel_message_counts=counts,
        chunk_count=len(found.chunks),
        message_count=sum(counts.values()),
        metadata_count=len(found.metadata),
        message_start_time=min((chunk.index.message_start_time for chunk in found.chunks), default=0),
        message_end_time=max((chunk.index.message_end_time for chunk in found.chunks), default=0),
        schema_count=len(found.schemas),
    )
    data_end = RecordBuilder()
    DataEnd(0).write(data_end)
    ended = data_end.end()
    start = found.end + len(ended)
    summary = RecordBuilder()
    offsets = []
    groups: list[tuple[Opcode, list[Any]]] = [
        (Opcode.SCHEMA, list(found.schemas.values())),
        (Opcode.CHANNEL, list(found.channels.values())),
        (Opcode.STATISTICS, [statistics]),
        (Opcode.CHUNK_INDEX, [chunk.index for chunk in found.chunks]),
        (Opcode.ATTACHMENT_INDEX, found.attachments),
        (Opcode.METADATA_INDEX, found.metadata),
    ]
    for opcode, records in groups:
        group_start = summary.count
        for record in records:
            record.write(summary)
        if records:
            offsets.append(SummaryOffset(opcode, start + group_start, summary.count - group_start))
    offset_start = start + summary.count
    for offset in offsets:
        offset.write(summary)
    written = summary.end()
    footer = RecordBuilder()
    # The check sum covers the summary and the footer up to the sum itself.
    head = struct.pack("<BQQQ", Opcode.FOOTER, 8 + 8 + 4, start, offset_start)
    Footer(start, offset_start, zlib.crc32(head, zlib.crc32(written))).write(footer)
    return bytes(ended + written + footer.end() + MAGIC)
