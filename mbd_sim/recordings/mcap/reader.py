"""Reads one MCAP file, whole, truncated or damaged: the description of the run, and blocks of messages."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Metadata, Schema, Statistics

from mbd_sim.recordings.mcap.scanner import (
    MAGIC,
    MESSAGE_HEADER,
    PARSE_ERRORS,
    BrokenRecordError,
    ByteSource,
    Definitions,
    FileBytes,
    StoredChunk,
    attachment_is_intact,
    chunk_content,
    data_stream,
    scan_messages,
    scan_records,
    stored_chunk,
)
from mbd_sim.recordings.messages.cdr import Block, DamagedError, Message, ReadingError, RecordedFile, RecordedTopic

_CHANNEL_NUMBER = struct.Struct("<H")
_CRC = struct.Struct("<I")


@dataclass
class _FileContents:
    """The results of one pass over the records of a file."""

    definitions: Definitions = field(default_factory=Definitions)
    attachments: dict[str, bytes] = field(default_factory=dict)
    metadata: dict[str, Mapping[str, str]] = field(default_factory=dict)
    statistics: Statistics | None = None
    chunks: list[StoredChunk] = field(default_factory=list)
    chunk_channels: dict[int, set[int]] = field(default_factory=dict)  # of chunks that have an index of messages
    problem: str = ""
    attachment_problem: str = ""  # damage that does not affect the records after it

    def read(self, data: ByteSource, opcode: int, begin: int, end: int) -> None:
        """Read a record outside of chunks.

        :raises PARSE_ERRORS: its content is damaged.
        """
        if opcode == Opcode.CHUNK:
            self.chunks.append(stored_chunk(data, begin, end))
        elif opcode == Opcode.MESSAGE:
            if end - begin < MESSAGE_HEADER.size:
                raise BrokenRecordError("a message is too short")
        elif opcode == Opcode.MESSAGE_INDEX:
            (channel,) = _CHANNEL_NUMBER.unpack(data[begin : begin + _CHANNEL_NUMBER.size])
            self.chunk_channels.setdefault(len(self.chunks) - 1, set()).add(channel)
        elif opcode == Opcode.STATISTICS:
            self.statistics = Statistics.read(data_stream(data[begin:end]))
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.METADATA, Opcode.ATTACHMENT):
            self.describe(opcode, data[begin:end])

    def describe(self, opcode: int, content: bytes | bytearray) -> None:
        """Read a schema, a channel, metadata or an attachment; other records are skipped.

        :raises PARSE_ERRORS: its content is damaged.
        """
        self.definitions.add(opcode, content)
        if opcode == Opcode.METADATA:
            record = Metadata.read(data_stream(content))
            self.metadata[record.name] = record.metadata
        elif opcode == Opcode.ATTACHMENT:
            attachment = Attachment.read(data_stream(content))
            if not attachment_is_intact(content):
                self.attachment_problem = f"damaged: the attachment '{attachment.name}' fails its CRC check"
            self.attachments[attachment.name] = attachment.data


def read_mcap(path: Path) -> RecordedFile:
    """Open a file and scan its records; the messages are read on demand.

    :raises ReadingError: the file cannot be read, or is not an MCAP file.
    """
    try:
        with path.open("rb") as stream:
            data = FileBytes(stream)
            found = _scan(path, data)
            counts = _message_counts(data, found)
    except OSError as error:
        raise ReadingError(f"{path}: cannot be read: {error.strerror}") from error
    topics = {
        number: _topic(found, channel, counts.get(number, 0)) for number, channel in found.definitions.channels.items()
    }
    names = {number: topic.name for number, topic in topics.items()}
    mechanism = found.attachments.get("mechanism.yaml")
    return RecordedFile(
        path=path,
        topics=_by_name(topics.values()),
        metadata=found.metadata,
        mechanism_text=None if mechanism is None else mechanism.decode("utf-8", "replace"),
        blocks=[
            _block(path, chunk, names, found.chunk_channels.get(number)) for number, chunk in enumerate(found.chunks)
        ],
        problem="; ".join(text for text in (found.problem, found.attachment_problem) if text),
    )


def _scan(path: Path, data: ByteSource) -> _FileContents:
    """Read all records outside of chunks, up to the first that is damaged."""
    found = _FileContents()
    if not len(data):
        raise ReadingError(f"{path}: the file is empty: its writer ended before the first record.")
    if (magic := bytes(data[: len(MAGIC)])) != MAGIC:
        raise ReadingError(
            f"{path}: is not an MCAP file: it begins with {magic!r}", "Give a recording, for example an .mcap file."
        )
    unchunked = 0  # start of a sequence of messages outside of chunks
    position = len(MAGIC)
    try:
        for opcode, begin, end in scan_records(data, position):
            if unchunked and opcode != Opcode.MESSAGE:
                found.chunks.append(_unchunked_messages(data, unchunked, position))
                unchunked = 0
            if opcode == Opcode.FOOTER:
                return found
            if opcode == Opcode.DATA_END and not _summary_is_intact(data, end):
                found.problem = "damaged: its summary fails its CRC check; mbd_sim recover rebuilds it"
                return found
            try:
                found.read(data, opcode, begin, end)
            except PARSE_ERRORS as error:
                raise BrokenRecordError(f"damaged: the record at byte {position} cannot be read ({error})") from error
            if opcode == Opcode.MESSAGE:
                unchunked = unchunked or position
            position = end
        found.problem = f"cut off: it ends at byte {len(data)} without an index"
    except BrokenRecordError as error:
        found.problem = str(error)
    if unchunked:
        found.chunks.append(_unchunked_messages(data, unchunked, position))
    return found


def _summary_is_intact(data: ByteSource, start: int) -> bool:
    """Whether the summary that begins at byte `start` agrees with the checksum in the footer (0: none).

    A file without a footer is truncated rather than damaged.
    """
    footer_end = len(data) - len(MAGIC)
    if start >= footer_end or data[footer_end:] != MAGIC:
        return True
    (crc,) = _CRC.unpack(data[footer_end - _CRC.size : footer_end])
    return not crc or zlib.crc32(data[start : footer_end - _CRC.size]) == crc


def _unchunked_messages(data: ByteSource, start: int, end: int) -> StoredChunk:
    """Return a sequence of messages outside of chunks as an uncompressed chunk."""
    times = [log_time for _, _, log_time, _ in scan_messages(bytes(data[start:end]))]
    return StoredChunk(start, end - start, min(times), max(times), end - start, 0, "")


def _message_counts(data: ByteSource, found: _FileContents) -> Mapping[int, int]:
    """Return the number of messages of each channel, from the statistics or by reading the chunks.

    Without statistics, which a truncated file lacks, this also drops the chunks from the first unreadable one on, and
    reads the definitions that only the chunks hold.
    """
    if found.statistics is not None and found.definitions.channels:
        return dict(found.statistics.channel_message_counts)
    counts: dict[int, int] = {}
    for number, chunk in enumerate(found.chunks):
        try:
            content = _chunk_records(data, chunk)
            for opcode, begin, end in scan_records(content):
                if opcode == Opcode.MESSAGE:
                    (channel,) = _CHANNEL_NUMBER.unpack_from(content, begin)
                    counts[channel] = counts.get(channel, 0) + 1
                else:
                    found.describe(opcode, content[begin:end])
        except PARSE_ERRORS as error:
            found.problem = f"{error}; the rest of the file is lost"
            del found.chunks[number:]
            break
    return counts


def _chunk_records(data: ByteSource, chunk: StoredChunk) -> bytes:
    """Return the uncompressed records of a chunk.

    :raises BrokenRecordError: they are damaged.
    """
    stored = bytes(data[chunk.offset : chunk.offset + chunk.length])
    try:
        return chunk_content(stored, chunk.compression, chunk.size, chunk.crc)
    except BrokenRecordError as error:
        start = chunk.start_ns * 1e-9
        raise BrokenRecordError(
            f"damaged: the chunk at byte {chunk.offset} (from t = {start:.9g} s) {error}"
        ) from error


def _block(path: Path, chunk: StoredChunk, names: Mapping[int, str], channels: set[int] | None) -> Block:
    def load() -> list[Message]:
        try:
            with path.open("rb") as stream:
                content = _chunk_records(FileBytes(stream), chunk)
            return [
                Message(names[channel], payload, time_ns, sequence)
                for channel, sequence, time_ns, payload in scan_messages(content)
            ]
        except BrokenRecordError as error:
            raise DamagedError(path, str(error)) from error
        except KeyError as error:
            raise DamagedError(path, f"damaged: a message belongs to channel {error}, which does not exist") from error

    topics = None if channels is None else frozenset(names[channel] for channel in channels if channel in names)
    return Block(chunk.start_ns, chunk.end_ns, topics, load)


def _topic(found: _FileContents, channel: Channel, count: int) -> RecordedTopic:
    schema = found.definitions.schemas.get(channel.schema_id) or Schema(id=0, data=b"", encoding="", name="")
    return RecordedTopic(
        name=channel.topic,
        type=schema.name,
        qos=channel.metadata.get("offered_qos_profiles", ""),
        definition=schema.data.decode("utf-8", "replace"),
        encoding=channel.message_encoding,
        count=count,
        hash=channel.metadata.get("topic_type_hash", ""),
    )


def _by_name(topics: Iterable[RecordedTopic]) -> dict[str, RecordedTopic]:
    """Return topics by name; one that several channels share counts the messages of all."""
    found: dict[str, RecordedTopic] = {}
    for topic in topics:
        earlier = found[topic.name].count if topic.name in found else 0
        found[topic.name] = replace(topic, count=topic.count + earlier)
    return found
