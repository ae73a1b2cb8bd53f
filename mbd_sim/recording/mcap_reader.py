"""One MCAP file, whole, cut off or damaged: what it says about the run, and blocks of messages."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from io import BytesIO
from pathlib import Path
from typing import IO, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Header, Metadata, Schema, Statistics

from mbd_sim.recording.contents import (
    Block,
    DamagedError,
    Message,
    Part,
    ReadingError,
    RecordedTopic,
)

MAGIC = b"\x89MCAP0\r\n"
_RECORD = struct.Struct("<BQ")  # opcode, and length of what follows
_CHUNK = struct.Struct("<QQQII")  # first and last time, size, CRC, length of the name of the compression
_MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
_MOST = 1 << 32  # bytes of one record, beyond which its length must be a damaged one
_KNOWN = frozenset(int(opcode) for opcode in Opcode)


class _Chunk(NamedTuple):
    """Where a chunk stands in the file; `size` and `crc` are those of its uncompressed records."""

    offset: int
    length: int
    start_ns: int
    end_ns: int
    size: int
    crc: int
    compression: str


@dataclass
class _Found:
    """What one walk through a file finds."""

    profile: str = ""
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    attachments: dict[str, bytes] = field(default_factory=dict)
    metadata: dict[str, Mapping[str, str]] = field(default_factory=dict)
    statistics: Statistics | None = None
    chunks: list[_Chunk] = field(default_factory=list)
    held: dict[int, set[int]] = field(default_factory=dict)  # channels of each chunk by its number
    problem: str = ""
    remark: str = ""  # on what is damaged without hiding what comes behind


def read_mcap(path: Path) -> Part:
    """Open a file and walk through its records; messages are read when they are asked for.

    :raises ReadingError: the file cannot be read, or is no MCAP file.
    """
    try:
        with path.open("rb") as stream:
            found = _walk(path, stream)
    except OSError as error:
        raise ReadingError(f"{path}: cannot be read: {error.strerror}") from error
    counts: dict[int, int] = {}
    if found.statistics is not None and found.channels:
        counts = dict(found.statistics.channel_message_counts)
        chunks = found.chunks
    else:
        chunks = _counted(path, found, counts)
    topics = {
        number: RecordedTopic(
            name=channel.topic,
            type=_schema(found, channel).name,
            qos=channel.metadata.get("offered_qos_profiles", ""),
            definition=_schema(found, channel).data.decode("utf-8", "replace"),
            encoding=channel.message_encoding,
            count=counts.get(number, 0),
        )
        for number, channel in found.channels.items()
    }
    names = {number: topic.name for number, topic in topics.items()}
    blocks = [_block(path, chunk, names, found.held.get(number)) for number, chunk in enumerate(chunks)]
    text = found.attachments.get("mechanism.yaml")
    return Part(
        path=path,
        topics=_by_name(topics.values()),
        metadata=found.metadata,
        mechanism_text=None if text is None else text.decode("utf-8", "replace"),
        blocks=blocks,
        problem="; ".join(text for text in (found.problem, found.remark) if text),
    )


def _by_name(topics: Iterable[RecordedTopic]) -> dict[str, RecordedTopic]:
    """Topics by name: one that several channels share counts the messages of all."""
    found: dict[str, RecordedTopic] = {}
    for topic in topics:
        before = found[topic.name].count if topic.name in found else 0
        found[topic.name] = replace(topic, count=topic.count + before)
    return found


def _walk(path: Path, stream: IO[bytes]) -> _Found:
    """All records outside of chunks."""
    found = _Found()
    size = path.stat().st_size
    magic = stream.read(len(MAGIC))
    if not size:
        raise ReadingError(f"{path}: is empty: whoever wrote it ended before the first record.")
    if magic != MAGIC:
        raise ReadingError(f"{path}: is no MCAP file: it begins with {magic!r}.")
    loose = 0  # where a run of messages outside of chunks begins
    position = len(MAGIC)
    while True:
        head = stream.read(_RECORD.size)
        if len(head) < _RECORD.size:
            found.problem = f"cut off: it ends at byte {size} without an index"
            break
        opcode, length = _RECORD.unpack(head)
        if (opcode not in _KNOWN and opcode < 0x80) or length > _MOST:
            found.problem = f"damaged: no record begins at byte {position}; what comes behind is lost"
            break
        end = position + _RECORD.size + length
        if end > size:
            found.problem = f"cut off: it ends at byte {size}, within the record that begins at byte {position}"
            break
        if opcode == Opcode.MESSAGE:
            loose = loose or position
        elif loose:
            found.chunks.append(_loose(stream, loose, position))
            loose = 0
        stream.seek(position + _RECORD.size)
        try:
            if opcode == Opcode.FOOTER:
                return found
            _take(found, stream, opcode, length, position + _RECORD.size)
        except (McapError, ValueError, OverflowError, struct.error) as error:
            found.problem = f"damaged: the record at byte {position} cannot be read ({error})"
            break
        stream.seek(end)
        position = end
    if loose:
        found.chunks.append(_loose(stream, loose, position))
    return found


def _take(found: _Found, stream: IO[bytes], opcode: int, length: int, position: int) -> None:
    """Read a record of those that matter outside of chunks."""
    if opcode == Opcode.CHUNK:
        start, end, size, crc, name = _CHUNK.unpack(stream.read(_CHUNK.size))
        compression = stream.read(name).decode()
        (data,) = struct.unpack("<Q", stream.read(8))
        found.chunks.append(_Chunk(stream.tell(), data, start, end, size, crc, compression))
    elif opcode == Opcode.MESSAGE_INDEX:
        (channel,) = struct.unpack("<H", stream.read(2))
        found.held.setdefault(len(found.chunks) - 1, set()).add(channel)
    elif opcode == Opcode.STATISTICS:
        found.statistics = Statistics.read(_data(stream.read(length)))
    elif opcode == Opcode.HEADER:
        found.profile = Header.read(_data(stream.read(length))).profile
    elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.METADATA, Opcode.ATTACHMENT):
        _describe(found, opcode, stream.read(length))


def _describe(found: _Found, opcode: int, content: bytes) -> None:
    """Take what says something about the messages or the run."""
    if opcode == Opcode.SCHEMA:
        schema = Schema.read(_data(content))
        found.schemas[schema.id] = schema
    elif opcode == Opcode.CHANNEL:
        channel = Channel.read(_data(content))
        found.channels[channel.id] = channel
    elif opcode == Opcode.METADATA:
        about = Metadata.read(_data(content))
        found.metadata[about.name] = about.metadata
    elif opcode == Opcode.ATTACHMENT:
        attachment = Attachment.read(_data(content))
        (crc,) = struct.unpack("<I", content[-4:])
        if crc and zlib.crc32(content[:-4]) != crc:
            found.remark = f"damaged: its attachment '{attachment.name}' is not what was written (its CRC differs)"
        found.attachments[attachment.name] = attachment.data


def _data(content: bytes) -> ReadDataStream:
    return ReadDataStream(BytesIO(content), calculate_crc=True)


def _schema(found: _Found, channel: Channel) -> Schema:
    return found.schemas.get(channel.schema_id) or Schema(id=0, data=b"", encoding="", name="")


def _loose(stream: IO[bytes], start: int, end: int) -> _Chunk:
    """A run of messages outside of chunks, as if it were one without compression."""
    stream.seek(start)
    times = [log_time for _, _, log_time, _ in _messages(stream.read(end - start))]
    return _Chunk(start, end - start, min(times), max(times), end - start, 0, "")


def _counted(path: Path, found: _Found, counts: dict[int, int]) -> list[_Chunk]:
    """The chunks up to the first that cannot be read; counts messages and takes what describes them."""
    with path.open("rb") as stream:
        for number, chunk in enumerate(found.chunks):
            try:
                data = _records(path, stream, chunk)
            except DamagedError as error:
                found.problem = f"{error.what}; what comes behind is lost"
                return found.chunks[:number]
            for opcode, start, end in _split(data):
                if opcode == Opcode.MESSAGE:
                    (channel,) = struct.unpack_from("<H", data, start)
                    counts[channel] = counts.get(channel, 0) + 1
                else:
                    _describe(found, opcode, data[start:end])
    return found.chunks


def _block(path: Path, chunk: _Chunk, names: Mapping[int, str], held: set[int] | None) -> Block:
    def load() -> list[Message]:
        with path.open("rb") as stream:
            data = _records(path, stream, chunk)
        return [
            Message(names[channel], content, time_ns, order) for channel, order, time_ns, content in _messages(data)
        ]

    topics = None if held is None else frozenset(names[channel] for channel in held if channel in names)
    return Block(chunk.start_ns, chunk.end_ns, topics, load)


def _records(path: Path, stream: IO[bytes], chunk: _Chunk) -> bytes:
    """The uncompressed records of a chunk.

    :raises DamagedError: they are not what was written.
    """
    stream.seek(chunk.offset)
    stored = stream.read(chunk.length)
    where = f"the chunk at byte {chunk.offset} (from t = {chunk.start_ns * 1e-9:.9g} s)"
    try:
        data = _decompressed(stored, chunk)
    except Exception as error:  # zstandard and lz4 have errors of their own
        raise DamagedError(path, f"damaged: {where} cannot be unpacked ({error})") from error
    if chunk.crc and zlib.crc32(data) != chunk.crc:
        raise DamagedError(path, f"damaged: {where} is not what was written (its CRC differs)")
    return data


def _decompressed(stored: bytes, chunk: _Chunk) -> bytes:
    if chunk.compression == "zstd":
        import zstandard

        return zstandard.ZstdDecompressor().decompress(stored, max_output_size=chunk.size)
    if chunk.compression == "lz4":
        import lz4.frame

        return bytes(lz4.frame.decompress(stored))
    if chunk.compression:
        raise ValueError(f"compression '{chunk.compression}' is unknown")
    return stored


def _split(data: bytes) -> Iterator[tuple[int, int, int]]:
    """Opcode, begin and end of each record."""
    position, size, record, head = 0, len(data), _RECORD.unpack_from, _RECORD.size
    while position + head <= size:
        opcode, length = record(data, position)
        begin = position + head
        position = begin + length
        yield opcode, begin, position


def _messages(data: bytes) -> Iterator[tuple[int, int, int, bytes]]:
    """Channel, sequence, log time and content of each message."""
    message, head = _MESSAGE.unpack_from, _MESSAGE.size
    for opcode, begin, end in _split(data):
        if opcode == 5:  # Opcode.MESSAGE: an enumeration's member is slow to look up
            channel, sequence, log_time, _ = message(data, begin)
            yield channel, sequence, log_time, data[begin + head : end]
