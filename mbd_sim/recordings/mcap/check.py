"""Checks a complete MCAP file as strictly as its strictest reader: all checksums, offsets, indexes and statistics."""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mcap.opcode import Opcode
from mcap.records import (
    AttachmentIndex,
    Channel,
    ChunkIndex,
    Footer,
    McapRecord,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from mbd_sim.recordings.mcap.contents import (
    MAGIC,
    PARSE_ERRORS,
    RECORD_HEADER,
    ByteSource,
    Definitions,
    FileBytes,
    chunk_index_of,
    data_stream,
    scan_records,
)
from mbd_sim.recordings.mcap.message_definitions import definition_problem
from mbd_sim.recordings.mcap.repair import DataSection, read_data_section, strictly_read
from mbd_sim.recordings.messages.cdr import ReadingError

_FOOTER_SIZE = RECORD_HEADER.size + 8 + 8 + 4
_FOOTER_HEADER = RECORD_HEADER.pack(Opcode.FOOTER, 8 + 8 + 4)
_OFFSETS: dict[type[Any], str] = {
    ChunkIndex: "chunk_start_offset",
    AttachmentIndex: "offset",
    MetadataIndex: "offset",
}
_WORDS = {ChunkIndex: "index of chunks", AttachmentIndex: "index of attachments", MetadataIndex: "index of metadata"}
_RECORDS: dict[int, type[Any]] = {  # of a summary
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.STATISTICS: Statistics,
    Opcode.SUMMARY_OFFSET: SummaryOffset,
    Opcode.CHUNK_INDEX: ChunkIndex,
    Opcode.ATTACHMENT_INDEX: AttachmentIndex,
    Opcode.METADATA_INDEX: MetadataIndex,
}
_STATISTICS = {
    "the statistics and the file differ in the numbers of messages": ("channel_message_counts", "message_count"),
    "the statistics and the messages differ in their times": ("message_start_time", "message_end_time"),
    "the statistics differ from the contents of the file": (
        "schema_count", "channel_count", "chunk_count", "attachment_count", "metadata_count"
    ),
}  # fmt: skip


@dataclass(frozen=True)
class FileCheck:
    """Damage of a complete file: of its index, which `recover` repairs, and of its contents; "" if there is none."""

    index_problem: str = ""
    content_problem: str = ""


def check_file(path: Path) -> FileCheck:
    """Check a file; one that is truncated has no index to be checked.

    :raises ReadingError: it cannot be read.
    """
    try:
        with path.open("rb") as stream:
            data = FileBytes(stream)
            found = read_data_section(data)
            if data[len(data) - len(MAGIC) :] != MAGIC:
                return FileCheck()
            index_problem = found.problem or found.index_problem or summary_problem(data, found)
            content_problem = found.content_problem or definition_problem(found.definitions)
    except OSError as error:
        raise ReadingError(f"{path}: cannot be read: {error.strerror}") from error
    if not found.crc_agrees and not content_problem and not index_problem:
        content_problem = "the checksum of its data differs: something outside the messages was changed"
    return FileCheck(index_problem, content_problem)


def summary_problem(data: ByteSource, found: DataSection) -> str:
    """Return how the end of a file is damaged or contradicts its data section, or "" if it does not."""
    try:
        return _summary_problem(data, found)
    except PARSE_ERRORS as error:
        return f"the summary cannot be read ({str(error) or 'it is too short'})"


def _summary_problem(data: ByteSource, found: DataSection) -> str:
    size = len(data)
    if data[size - len(MAGIC) :] != MAGIC:
        return "the end of the file is missing"
    footer_start = size - len(MAGIC) - _FOOTER_SIZE
    footer_content = footer_start + RECORD_HEADER.size
    if footer_start < found.end or data[footer_start:footer_content] != _FOOTER_HEADER:
        return "the footer is damaged"
    footer = Footer.read(data_stream(bytes(data[footer_content : size - len(MAGIC)])))
    start = footer.summary_start or footer_start
    if not found.end <= start <= footer_start:
        return "the footer gives a wrong position of the summary"
    crc = zlib.crc32(bytes(data[start : size - len(MAGIC) - 4]))
    if footer.summary_crc and footer.summary_crc != crc:
        return "the summary fails its CRC check"
    if [opcode for opcode, _, _ in scan_records(bytes(data[found.end : start]))] != [Opcode.DATA_END]:
        return "the summary does not follow the data"
    if start == footer_start:
        return "" if not found.chunks else "there is no summary"
    return _contradiction(bytes(data[start:footer_start]), start, footer, found)


def _contradiction(summary: bytes, start: int, footer: Footer, found: DataSection) -> str:
    """Compare the records of a summary, which begins at byte `start`, with the data section."""
    definitions, indexes = Definitions(), {kind: dict[int, McapRecord]() for kind in _OFFSETS}
    spans: dict[int, tuple[int, int]] = {}
    statistics, offsets_start, end = None, 0, 0
    for opcode, begin, end in scan_records(summary):
        content, record_start = summary[begin:end], start + begin - RECORD_HEADER.size
        record = strictly_read(_RECORDS[opcode], content) if opcode in _RECORDS else None
        definitions.add(opcode, content)
        if isinstance(record, Statistics):
            statistics = record
        elif (kind := type(record)) in _OFFSETS:
            indexes[kind][getattr(record, _OFFSETS[kind])] = record
        elif isinstance(record, SummaryOffset):
            offsets_start = offsets_start or record_start
            if spans.get(record.group_opcode) != (record.group_start, record.group_length):
                return "an offset in the summary is wrong"
            continue
        first, length = spans.get(opcode, (record_start, 0))
        spans[opcode] = first, length + end - begin + RECORD_HEADER.size
    if end != len(summary):
        return "the summary ends within a record"
    if footer.summary_offset_start not in (0, offsets_start):
        return "the footer gives a wrong position of the summary's offsets"
    chunks = [chunk_index_of(record) for record in found.chunks]
    for kind, records in ((ChunkIndex, chunks), (AttachmentIndex, found.attachments), (MetadataIndex, found.metadata)):
        if indexes[kind] != {getattr(record, _OFFSETS[kind]): record for record in records}:
            return f"the {_WORDS[kind]} differs from the contents of the file"
    if definitions != found.definitions:
        return "the schemas and channels of the summary differ from those of the data"
    return _statistics_problem(statistics, found.statistics_record())


def _statistics_problem(recorded: Statistics | None, found: Statistics) -> str:
    if recorded is None:
        return "the statistics are missing"
    for one in (recorded, found):
        one.channel_message_counts = {number: count for number, count in one.channel_message_counts.items() if count}
    for words, names in _STATISTICS.items():
        if any(getattr(recorded, name) != getattr(found, name) for name in names):
            return words
    return ""
