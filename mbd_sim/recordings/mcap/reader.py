"""Reads one MCAP file, whole, truncated or damaged: the description of the run, and blocks of messages.

What is in a complete file is read from its summary, and in others record by record.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from mcap.opcode import Opcode
from mcap.records import Attachment, AttachmentIndex, Channel, Chunk, ChunkIndex, Metadata, MetadataIndex, Schema

from mbd_sim.recordings.mcap.contents import (
    MAGIC,
    PARSE_ERRORS,
    RECORD_HEADER,
    BrokenRecordError,
    ByteSource,
    Contents,
    FileBytes,
    Span,
    attachment_is_intact,
    chunk_index_of,
    counts_of,
    data_stream,
    scan_messages,
)
from mbd_sim.recordings.mcap.repair import chunk_records, read_data_section, read_summary, strictly_read
from mbd_sim.recordings.messages.cdr import (
    Block,
    DamagedError,
    Message,
    ReadingError,
    RecordedFile,
    RecordedTopic,
    topics_by_name,
)


def read_mcap(path: Path) -> RecordedFile:
    """Open a file and read what is in it; the messages are read on demand.

    :raises ReadingError: the file cannot be read, or is not an MCAP file.
    """
    problems: list[str] = []
    try:
        with path.open("rb") as stream:
            data = FileBytes(stream)
            _require_mcap(path, data)
            found = _contents(data, problems)
            attachments = [_record(data, Attachment, index, problems) for index in found.attachments]
            records = [_record(data, Metadata, index, problems) for index in found.metadata]
    except OSError as error:
        raise ReadingError(f"{path}: cannot be read: {error.strerror}") from error
    topics = {number: _topic(found, channel) for number, channel in found.definitions.channels.items()}
    names = {number: topic.name for number, topic in topics.items()}
    mechanism = next((one.data for one in attachments if one is not None and one.name == "mechanism.yaml"), None)
    return RecordedFile(
        path=path,
        topics=topics_by_name(topics.values()),
        metadata={record.name: record.metadata for record in records if record is not None},
        mechanism_text=None if mechanism is None else mechanism.decode("utf-8", "replace"),
        blocks=_blocks(path, found, names),
        problem="; ".join(problems),
    )


def _require_mcap(path: Path, data: ByteSource) -> None:
    if not len(data):
        raise ReadingError(f"{path}: the file is empty: its writer ended before the first record.")
    if (magic := bytes(data[: len(MAGIC)])) != MAGIC:
        raise ReadingError(
            f"{path}: is not an MCAP file: it begins with {magic!r}", "Give a recording, for example an .mcap file."
        )


def _contents(data: ByteSource, problems: list[str]) -> Contents:
    """What a file contains, by its summary if this fits the file."""
    try:
        summary = read_summary(data)
        if summary is not None and _fits(summary, data):
            return summary
    except BrokenRecordError as error:
        problems.append(f"damaged: {error}; mbd_sim recover rebuilds it")
    found = read_data_section(data)
    cut_off = "" if data[-len(MAGIC) :] == MAGIC else f"cut off: it ends at byte {len(data)} without an index"
    if (problem := found.problem or cut_off) and not problems:
        problems.append(problem)
    return found


def _fits(summary: Contents, data: ByteSource) -> bool:
    """Whether a summary has all messages, and each record begins where it says."""
    try:
        chunks = [chunk_index_of(record) for record in summary.chunks]
    except PARSE_ERRORS:
        return False
    places = [(Opcode.CHUNK, index.chunk_start_offset, index.chunk_length) for index in chunks]
    places += [(Opcode.ATTACHMENT, index.offset, index.length) for index in summary.attachments]
    places += [(Opcode.METADATA, index.offset, index.length) for index in summary.metadata]
    in_chunks = sum(map(counts_of, chunks), Counter[int]())
    return in_chunks == summary.statistics.counts and all(
        length >= RECORD_HEADER.size
        and data[start : start + RECORD_HEADER.size] == RECORD_HEADER.pack(opcode, length - RECORD_HEADER.size)
        for opcode, start, length in places
    )


def _record(data: ByteSource, kind: Any, index: AttachmentIndex | MetadataIndex, problems: list[str]) -> Any | None:
    """An attachment or metadata, None if it cannot be read."""
    content = bytes(data[index.offset + RECORD_HEADER.size : index.offset + index.length])
    try:
        record = kind.read(data_stream(content))
    except PARSE_ERRORS as error:
        problems.append(f"damaged: the record at byte {index.offset} cannot be read ({error})")
        return None
    if kind is Attachment and not attachment_is_intact(content):
        problems.append(f"damaged: the attachment '{record.name}' fails its CRC check")
    return record


def _blocks(path: Path, found: Contents, names: Mapping[int, str]) -> list[Block]:
    """The chunks, and messages outside of them; the topics of chunks are known if the messages have indexes."""
    blocks = []
    for index in map(chunk_index_of, found.chunks):
        known = [names[channel] for channel in index.message_index_offsets if channel in names]
        topics = frozenset(known) if index.message_index_length else None
        load = _loader(path, names, partial(_chunk_content, index))
        blocks.append((index.chunk_start_offset, Block(index.message_start_time, index.message_end_time, topics, load)))
    for span in found.outside:
        load = _loader(path, names, partial(_content_outside, span))
        blocks.append((span.begin, Block(span.first_ns, span.last_ns, None, load)))
    return [block for _, block in sorted(blocks, key=lambda placed: placed[0])]


def _loader(
    path: Path, names: Mapping[int, str], content: Callable[[ByteSource], bytes]
) -> Callable[[], list[Message]]:
    def load() -> list[Message]:
        try:
            with path.open("rb") as stream:
                records = content(FileBytes(stream))
            return [
                Message(names[channel], payload, time_ns, sequence)
                for channel, sequence, time_ns, payload in scan_messages(records)
            ]
        except BrokenRecordError as error:
            raise DamagedError(path, str(error)) from error
        except KeyError as error:
            raise DamagedError(path, f"damaged: a message belongs to channel {error}, which does not exist") from error

    return load


def _content_outside(span: Span, data: ByteSource) -> bytes:
    return bytes(data[span.begin : span.end])


def _chunk_content(index: ChunkIndex, data: ByteSource) -> bytes:
    """The uncompressed records of a chunk.

    :raises BrokenRecordError: they are damaged.
    """
    begin, start = index.chunk_start_offset, index.message_start_time * 1e-9
    try:
        content = bytes(data[begin + RECORD_HEADER.size : begin + index.chunk_length])
        return chunk_records(strictly_read(Chunk, content))
    except PARSE_ERRORS as error:
        reason = error if isinstance(error, BrokenRecordError) else f"cannot be read ({error})"
        raise BrokenRecordError(f"damaged: the chunk at byte {begin} (from t = {start:.9g} s) {reason}") from error


def _topic(found: Contents, channel: Channel) -> RecordedTopic:
    schema = found.definitions.schemas.get(channel.schema_id) or Schema(id=0, data=b"", encoding="", name="")
    return RecordedTopic(
        name=channel.topic,
        type=schema.name,
        qos=channel.metadata.get("offered_qos_profiles", ""),
        definition=schema.data.decode("utf-8", "replace"),
        encoding=channel.message_encoding,
        count=found.statistics.counts[channel.id],
        hash=channel.metadata.get("topic_type_hash", ""),
    )
