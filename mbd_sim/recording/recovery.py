"""A recording that was cut off, by a kill or a full disk, made whole again in its place.

What is kept are whole chunks; the summary and the index, without which many tools refuse a file, are made anew from
them.
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
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
)

from mbd_sim.recording.mcap_summary import MAGIC, Summary, encoded

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
            raise ValueError(f"'{path}' is no MCAP file, or was cut off before anything was written.")
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
            found.attachments.append(attachment_index(attachment, start, end - start))
        elif opcode == Opcode.METADATA:
            found.metadata.append(MetadataIndex(offset=start, length=end - start, name=Metadata.read(content).name))
        elif opcode == Opcode.CHUNK:
            chunk = Chunk.read(content)
            if not _take(chunk, found):
                break
            found.chunks.append(_Chunk(chunk_index(chunk, start, end - start)))
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


def attachment_index(attachment: Attachment, offset: int, length: int) -> AttachmentIndex:
    """What the index says of an attachment, from where its record stands."""
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
    """What the index says of a chunk, from where its record stands; without its messages' index."""
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
    return Summary(
        schemas=list(found.schemas.values()),
        channels=list(found.channels.values()),
        attachments=found.attachments,
        metadata=found.metadata,
        chunks=b"".join(encoded(chunk.index) for chunk in found.chunks),
        chunk_count=len(found.chunks),
        counts=_counts(found),
        first_ns=min((chunk.index.message_start_time for chunk in found.chunks), default=0),
        last_ns=max((chunk.index.message_end_time for chunk in found.chunks), default=0),
    ).tail(found.end)
