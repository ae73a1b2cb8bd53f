"""Repairs a recording that was truncated by a kill or a full disk, or whose bytes were damaged.

Complete chunks up to the first damage are kept. The summary and the index, without which many tools refuse a file, are
rebuilt from them.
"""

from __future__ import annotations

import contextlib
import os
import zlib
from pathlib import Path
from typing import IO

from mcap.opcode import Opcode
from mcap.records import Chunk, Header, MessageIndex

from mbd_sim.recording.data_section import DataSection
from mbd_sim.recording.definition_check import definition_problem
from mbd_sim.recording.mcap_check import summary_problem
from mbd_sim.recording.mcap_contents import chunk_records, read_data_section
from mbd_sim.recording.mcap_scanner import (
    MAGIC,
    MESSAGE_HEADER,
    RECORD_HEADER,
    ByteSource,
    FileBytes,
    crc_of,
    data_stream,
    scan_records,
)
from mbd_sim.recording.mcap_summary import encoded, may_replace_chunks

_REWRITTEN = {Opcode.MESSAGE_INDEX, Opcode.HEADER, Opcode.SCHEMA, Opcode.CHANNEL}
_CHUNK_MARK = b"\x04\x00\x00\x00zstd"  # in the header of each of our chunks
_LARGEST_END = 1 << 22  # bytes of an incomplete record at the end of a truncated file


def recover(path: Path) -> dict[str, int] | None:
    """End a file after its last undamaged chunk, with a summary and indexes of its messages.

    A truncated file is repaired in place; on a full disk the summary takes the place of the last chunks. Where other
    records are damaged, a new file takes its place; the original is kept as `damaged_original`, unless only indexes
    were damaged. Returns the number of messages by topic, or None if the file is complete and undamaged; it is not
    modified then.

    :raises ValueError: this is not an MCAP file, or its damage cannot be repaired.
    :raises OSError: the file cannot be read or written.
    """
    with path.open("r+b") as stream:
        data = FileBytes(stream)
        if data[: len(MAGIC)] != MAGIC:
            raise ValueError(
                "is not an MCAP file, or was cut off before anything was written. Nothing can be recovered."
            )
        found = read_data_section(data)
        if undefined := definition_problem(found.definitions):
            raise ValueError(f"is damaged: {undefined}. That cannot be repaired.")
        if not found.problem and not found.index_problem and not summary_problem(data, found):
            if found.content_problem:
                raise ValueError(f"is damaged: {found.content_problem}. That cannot be repaired.")
            if found.crc_agrees:
                return None
        if found.has_header and not found.index_problem and found.crc_agrees and _is_truncation(data, found.end):
            _end_in_place(stream, data, found)
        else:
            _rewrite(path, data, found)
    return found.counts_by_topic()


def damaged_original(path: Path) -> Path:
    """Return the path under which the original of a damaged file is kept, where recovery removes some of it."""
    return path.with_name(f"{path.name}.damaged")


def _is_truncation(data: ByteSource, end: int) -> bool:
    """Whether all that follows byte `end` is one incomplete record, zeros, or an end without messages."""
    tail = bytes(data[end : end + _LARGEST_END])
    if not any(tail) or tail[0] in (Opcode.DATA_END, Opcode.FOOTER):
        return True
    chunks = 1 if tail[0] == Opcode.CHUNK else 0
    return len(data) - end <= _LARGEST_END and tail.count(_CHUNK_MARK) <= chunks


def _end_in_place(stream: IO[bytes], data: ByteSource, found: DataSection) -> None:
    """Replace everything after the undamaged records by a summary.

    :raises OSError: it cannot be written.
    """
    freed = 0
    while True:
        indexes = found.missing_indexes
        crc = zlib.crc32(indexes, crc_of(data, found.end))
        end = indexes + found.summary().file_end(found.end + len(indexes), crc)
        try:
            os.ftruncate(stream.fileno(), found.end)
            _write_at(stream.fileno(), end, found.end)
            return
        except OSError as error:
            accepted = os.fstat(stream.fileno()).st_size - found.end
            if not found.chunks or not may_replace_chunks(error, len(end), freed, accepted):
                with contextlib.suppress(OSError):
                    os.ftruncate(stream.fileno(), found.end)
                raise
        before = found.end
        found.drop_last_chunk()
        freed += before - found.end


def _write_at(descriptor: int, data: bytes, position: int) -> None:
    while data:
        written = os.pwrite(descriptor, data, position)
        data, position = data[written:], position + written


def _rewrite(path: Path, data: ByteSource, found: DataSection) -> None:
    """Write the undamaged records into a new file, with new indexes, and let it take the place of this one.

    :raises ValueError: a chunk contains damaged definitions; the file is not modified then.
    :raises OSError: it cannot be written; the file is not modified then.
    """
    draft = path.with_name(f".{path.name}.recovered")
    only_indexes = not found.problem and found.crc_agrees
    try:
        with draft.open("w+b") as stream:
            _copy_records(stream, data, found)
            copied = FileBytes(stream)
            copy = read_data_section(copied)
            if copy.index_problem:
                raise ValueError(f"is damaged: {copy.index_problem}, within a chunk. That cannot be repaired.")
            _end_in_place(stream, copied, copy)
            os.fsync(stream.fileno())
        if not only_indexes:
            path.rename(damaged_original(path))
        draft.replace(path)
    finally:
        draft.unlink(missing_ok=True)


def _copy_records(stream: IO[bytes], data: ByteSource, found: DataSection) -> None:
    """Copy the undamaged records, with a new header, definitions, and times and indexes of the chunks."""
    stream.write(MAGIC + encoded(Header("ros2", "mbd_sim")))
    definitions = found.definitions
    for definition in (*definitions.schemas.values(), *definitions.channels.values()):
        stream.write(encoded(definition))
    for opcode, begin, end in scan_records(data[: found.end], len(MAGIC)):
        if opcode == Opcode.CHUNK:
            stream.write(_indexed_chunk(bytes(data[begin:end])))
        elif opcode not in _REWRITTEN:
            stream.write(bytes(data[begin - RECORD_HEADER.size : end]))
    stream.flush()


def _indexed_chunk(content: bytes) -> bytes:
    """Return a chunk with its true times, and indexes of its messages."""
    chunk = Chunk.read(data_stream(content))
    records = chunk_records(chunk)
    entries: dict[int, list[tuple[int, int]]] = {}
    for opcode, begin, _ in scan_records(records):
        if opcode == Opcode.MESSAGE:
            channel, _, time_ns, _ = MESSAGE_HEADER.unpack_from(records, begin)
            entries.setdefault(channel, []).append((time_ns, begin - RECORD_HEADER.size))
    times = [time_ns for each in entries.values() for time_ns, _ in each] or [0]
    chunk.message_start_time, chunk.message_end_time = min(times), max(times)
    indexes = [MessageIndex(channel, each) for channel, each in sorted(entries.items())]
    return encoded(chunk) + b"".join(encoded(index) for index in indexes)
