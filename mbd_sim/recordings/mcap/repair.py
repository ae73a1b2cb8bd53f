"""The data section of an MCAP file, read strictly: its undamaged records, and the problems with the others.

The section is all that precedes the summary, and is read up to the first damage.
"""

from __future__ import annotations

import contextlib
import struct
import zlib
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Header,
    McapRecord,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)

from mbd_sim.recordings.mcap.contents import (
    MAGIC,
    MESSAGE_HEADER,
    PARSE_ERRORS,
    RECORD_HEADER,
    BrokenRecordError,
    ByteSource,
    Contents,
    Definitions,
    FileStatistics,
    Span,
    attachment_index,
    attachment_is_intact,
    chunk_content,
    chunk_index,
    crc_of,
    data_stream,
    encoded,
    scan_records,
)
from mbd_sim.recordings.mcap.message_definitions import repair_definitions
from mbd_sim.recordings.messages.cdr import RUN_METADATA

_SUMMARY_ONLY = {
    Opcode.STATISTICS, Opcode.CHUNK_INDEX, Opcode.ATTACHMENT_INDEX, Opcode.METADATA_INDEX, Opcode.SUMMARY_OFFSET
}  # fmt: skip
_FOOTER = struct.Struct("<QQI")  # start of the summary and of its offsets, checksum
Entries = dict[int, list[tuple[int, int]]]  # log time and offset of messages, by channel


@dataclass
class DataSection(Contents):
    """The undamaged records of a file, up to the end of its data section or the first damage.

    If the file is cut off or damaged after the content of a chunk, `missing_indexes` are the indexes of the messages of
    that chunk, which belong at `end`.

    `index_problem` is damage that new indexes repair, `content_problem` damage that is confined to one record and
    cannot be repaired, and `problem` says why the records end before the end of the data section. All are "" if absent.
    """

    end: int = len(MAGIC)
    missing_indexes: bytes = b""
    index_problem: str = ""
    content_problem: str = ""
    problem: str = ""
    has_header: bool = False
    crc_agrees: bool = True


def read_data_section(data: ByteSource) -> DataSection:
    """Read and check all records up to the end of the data section or the first damage.

    Damaged definitions of a recorded run are replaced by those of its topics, unless summary and data agree on them.
    """
    trusted = _checked_definitions(data)
    found = _read_records(data, trusted)
    is_run = any(record.name == RUN_METADATA for record in found.metadata)
    if is_run and (found.index_problem or not trusted.channels):
        found.index_problem = repair_definitions(found.definitions) or found.index_problem
    return found


def _read_records(data: ByteSource, trusted: Definitions) -> DataSection:
    found = DataSection(FileStatistics(Path()))
    reader = _DataSectionReader(data, found, trusted)
    try:
        for opcode, begin, end in scan_records(data, len(MAGIC)):
            start = begin - RECORD_HEADER.size
            try:
                if opcode in (Opcode.DATA_END, Opcode.FOOTER):
                    reader.finish(opcode, start, bytes(data[begin:end]))
                    return found
                reader.read(opcode, start, bytes(data[begin:end]))
            except PARSE_ERRORS as error:
                reason = str(error) or "it is too short"
                raise BrokenRecordError(f"damaged: the record at byte {start} cannot be read ({reason})") from error
            found.end = end
        found.problem = f"cut off: it ends at byte {len(data)} without an index"
    except BrokenRecordError as error:
        found.problem = str(error)
    reader.end_truncated()
    return found


class _DataSectionReader:
    """Adds record after record to a `DataSection`."""

    def __init__(self, data: ByteSource, found: DataSection, trusted: Definitions) -> None:
        self._data, self._found, self._trusted = data, found, trusted
        self._chunk: ChunkIndex | None = None  # while the indexes of its messages follow
        self._entries: Entries = {}  # of the messages of this chunk
        self._indexed: Entries = {}

    def read(self, opcode: int, start: int, content: bytes) -> None:
        """Read a record that begins at byte `start`.

        :raises PARSE_ERRORS: it is damaged.
        """
        found, length = self._found, len(content) + RECORD_HEADER.size
        if opcode == Opcode.MESSAGE_INDEX:
            self._read_message_index(start, content)
            return
        self.end_chunk()
        if start == len(MAGIC):
            found.has_header = opcode == Opcode.HEADER and _is_ros_header(content)
            if not found.has_header:
                self._add_index_problem("the header is damaged")
        elif opcode in _SUMMARY_ONLY or opcode == Opcode.HEADER:
            raise BrokenRecordError(f"a record of kind {opcode} is out of place")
        self._define_outside(opcode, content)
        if opcode == Opcode.ATTACHMENT:
            attachment = Attachment.read(data_stream(content))
            if not attachment_is_intact(content):
                found.content_problem = f"the attachment '{attachment.name}' fails its CRC check"
            found.attachments.append(attachment_index(attachment, start, length))
        elif opcode == Opcode.METADATA:
            name = strictly_read(Metadata, content).name
            found.metadata.append(MetadataIndex(offset=start, length=length, name=name))
        elif opcode == Opcode.CHUNK:
            self._read_chunk(start, content)
        elif opcode == Opcode.MESSAGE:
            channel, time_ns = self._message(content, 0, len(content))
            found.statistics.add({channel: 1}, time_ns, time_ns)
            span = Span(start, start, time_ns, time_ns)
            if found.outside and found.outside[-1].end == start:
                span = found.outside.pop()
            first_ns, last_ns = min(span.first_ns, time_ns), max(span.last_ns, time_ns)
            found.outside.append(Span(span.begin, start + length, first_ns, last_ns))

    def _define_outside(self, opcode: int, content: bytes) -> None:
        """Add a schema or a channel that is not in a chunk, which has no checksum: the summary's copy prevails."""
        found, trusted = self._found, self._trusted
        if opcode not in (Opcode.SCHEMA, Opcode.CHANNEL) or not trusted.channels:
            try:
                self._define(opcode, content)
            except PARSE_ERRORS:
                if opcode != Opcode.SCHEMA:
                    raise
                self._add_index_problem("a definition cannot be read")  # it is repaired, or said to be missing
            return
        known = trusted.schemas if opcode == Opcode.SCHEMA else trusted.channels
        if content not in [encoded(record)[RECORD_HEADER.size :] for record in known.values()]:
            self._add_index_problem("a definition in the data differs from that in the summary")
        found.definitions.schemas |= trusted.schemas
        found.definitions.channels |= trusted.channels

    def _define(self, opcode: int, content: bytes) -> None:
        """Add a record if it is a schema or a channel."""
        if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            strictly_read(Schema if opcode == Opcode.SCHEMA else Channel, content)
            self._found.definitions.add(opcode, content)

    def _message(self, data: bytes, begin: int, end: int) -> tuple[int, int]:
        """Return channel and log time of a message."""
        if end - begin < MESSAGE_HEADER.size:
            raise BrokenRecordError("a message is too short")
        channel, _, time_ns, _ = MESSAGE_HEADER.unpack_from(data, begin)
        if channel not in self._found.definitions.channels:
            raise BrokenRecordError(f"a message belongs to channel {channel}, which does not exist")
        return channel, time_ns

    def _read_chunk(self, start: int, content: bytes) -> None:
        chunk = strictly_read(Chunk, content)
        entries = self._message_entries(chunk_records(chunk))
        index = chunk_index(chunk, start, len(content) + RECORD_HEADER.size)
        times = [time_ns for channel in entries.values() for time_ns, _ in channel] or [0]
        index.message_start_time, index.message_end_time = min(times), max(times)
        if times != [0] and (chunk.message_start_time, chunk.message_end_time) != (min(times), max(times)):
            self._add_index_problem(f"the times of the chunk at byte {start} differ from those of its messages")
        self._chunk, self._entries, self._indexed = index, entries, {}

    def _message_entries(self, records: bytes) -> Entries:
        """Return times and offsets of the messages of a chunk; add its definitions."""
        entries: Entries = {}
        end = 0
        for opcode, begin, end in scan_records(records):
            if opcode == Opcode.MESSAGE:
                channel, time_ns = self._message(records, begin, end)
                entries.setdefault(channel, []).append((time_ns, begin - RECORD_HEADER.size))
            else:
                self._define(opcode, records[begin:end])
        if end != len(records):
            raise BrokenRecordError("the last record of the chunk is incomplete")
        return entries

    def _read_message_index(self, start: int, content: bytes) -> None:
        index = strictly_read(MessageIndex, content)
        if self._chunk is None:
            raise BrokenRecordError("an index of messages does not follow a chunk")
        self._chunk.message_index_offsets[index.channel_id] = start
        self._chunk.message_index_length += len(content) + RECORD_HEADER.size
        self._indexed[index.channel_id] = list(index.records)

    def end_chunk(self) -> None:
        """Compare the indexes of messages that follow the last chunk with its messages."""
        if self._chunk is None:
            return
        if not self._is_indexed:
            start = self._chunk.chunk_start_offset
            self._add_index_problem(f"the index of messages does not fit the chunk at byte {start}")
        self._found.add_chunk(self._chunk, {channel: len(each) for channel, each in self._entries.items()})
        self._chunk = None

    def end_truncated(self) -> None:
        """End a file that is cut off or damaged here; the indexes of the last chunk may be incomplete."""
        found, chunk = self._found, self._chunk
        if chunk is not None and not self._is_indexed:
            found.end = chunk.chunk_start_offset + chunk.chunk_length
            chunk.message_index_offsets = {}
            for channel, each in sorted(self._entries.items()):
                chunk.message_index_offsets[channel] = found.end + len(found.missing_indexes)
                found.missing_indexes += encoded(MessageIndex(channel, each))
            chunk.message_index_length, self._indexed = len(found.missing_indexes), self._entries
        self.end_chunk()

    @property
    def _is_indexed(self) -> bool:
        return _sorted(self._entries) == _sorted(self._indexed)

    def finish(self, opcode: int, start: int, content: bytes) -> None:
        """End the data section at byte `start`, where its last record or the footer begins."""
        self.end_chunk()
        self._found.end = start
        if opcode == Opcode.DATA_END:
            crc = strictly_read(DataEnd, content).data_section_crc
            self._found.crc_agrees = not crc or crc == crc_of(self._data, start)

    def _add_index_problem(self, problem: str) -> None:
        self._found.index_problem = self._found.index_problem or problem


def read_summary(data: ByteSource, *, needs_checksum: bool = False) -> Contents | None:
    """What the summary of a complete file says; None without one.

    :raises BrokenRecordError: its checksum differs, or a record in it is damaged.
    """
    end = len(data) - len(MAGIC)
    content = end - _FOOTER.size
    if content < 0 or data[end:] != MAGIC:
        return None
    start, _, crc = _FOOTER.unpack(data[content:end])
    if not start or (needs_checksum and not crc):
        return None
    if start >= content or (crc and zlib.crc32(data[start : end - 4]) != crc):
        raise BrokenRecordError("its summary fails its CRC check")
    found, summary = Contents(FileStatistics(Path())), bytes(data[start : content - RECORD_HEADER.size])
    try:
        for opcode, begin, record_end in scan_records(summary):
            record = summary[begin:record_end]
            found.definitions.add(opcode, record)
            if opcode == Opcode.ATTACHMENT_INDEX:
                found.attachments.append(AttachmentIndex.read(data_stream(record)))
            elif opcode == Opcode.METADATA_INDEX:
                found.metadata.append(MetadataIndex.read(data_stream(record)))
            elif opcode == Opcode.CHUNK_INDEX:
                found.chunks.append(summary[begin - RECORD_HEADER.size : record_end])
            elif opcode == Opcode.STATISTICS:
                found.statistics.counts = Counter(Statistics.read(data_stream(record)).channel_message_counts)
    except PARSE_ERRORS as error:
        raise BrokenRecordError(f"its summary cannot be read ({error})") from error
    return found


def _checked_definitions(data: ByteSource) -> Definitions:
    """The schemas and channels of the summary if its checksum is valid, else none."""
    with contextlib.suppress(BrokenRecordError):
        if (summary := read_summary(data, needs_checksum=True)) is not None:
            return summary.definitions
    return Definitions()


_Record = TypeVar("_Record", bound=McapRecord)


def strictly_read(kind: type[_Record], content: bytes) -> _Record:
    """Read a record of which every byte must be understood.

    :raises PARSE_ERRORS: it is damaged.
    """
    record: _Record = kind.read(data_stream(content))
    if encoded(record)[RECORD_HEADER.size :] != content:
        raise BrokenRecordError(f"its lengths contradict each other: {kind.__name__}")
    return record


def _is_ros_header(content: bytes) -> bool:
    try:
        return bool(strictly_read(Header, content).profile == "ros2")
    except PARSE_ERRORS:
        return False


def chunk_records(chunk: Chunk) -> bytes:
    """Return the uncompressed records of a chunk.

    :raises BrokenRecordError: they are damaged.
    """
    records = chunk_content(chunk.data, chunk.compression, chunk.uncompressed_size, chunk.uncompressed_crc)
    if len(records) != chunk.uncompressed_size:
        raise BrokenRecordError("the size of the uncompressed chunk is wrong")
    return records


def _sorted(entries: Entries) -> Entries:
    return {channel: sorted(each) for channel, each in entries.items() if each}
