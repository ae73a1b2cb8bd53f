"""Repairs a recording that was truncated by a kill or a full disk, or whose bytes were damaged.

Complete chunks up to the first damage are kept. The summary and the index, without which many tools refuse a file, are
rebuilt from them. In a rosbag2 folder each of the MCAP files is repaired, then `metadata.yaml`.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import IO, Any

import yaml
from mcap.opcode import Opcode
from mcap.records import Chunk, Header, MessageIndex

from mbd_sim.base.errors import InputError
from mbd_sim.recordings.mcap.check import summary_problem
from mbd_sim.recordings.mcap.contents import (
    MAGIC,
    MESSAGE_HEADER,
    RECORD_HEADER,
    ByteSource,
    FileBytes,
    FileStatistics,
    crc_of,
    data_stream,
    encoded,
    scan_records,
)
from mbd_sim.recordings.mcap.message_definitions import definition_problem
from mbd_sim.recordings.mcap.reader import read_mcap
from mbd_sim.recordings.mcap.repair import DataSection, chunk_records, read_data_section
from mbd_sim.recordings.mcap.rosbag2 import FILE_NAME, bag_text, read_bag_metadata, write_metadata
from mbd_sim.recordings.mcap.writer import DurableFile, write_end
from mbd_sim.recordings.messages.cdr import RecordedFile
from mbd_sim.recordings.messages.definitions import Topic
from mbd_sim.recordings.run.paths import natural_order

UNREPAIRABLE, NOTHING = "That cannot be repaired.", "Nothing can be recovered."
_REWRITTEN = {Opcode.MESSAGE_INDEX, Opcode.HEADER, Opcode.SCHEMA, Opcode.CHANNEL}
_CHUNK_MARK = b"\x04\x00\x00\x00zstd"  # in the header of each of our chunks
_LARGEST_END = 1 << 22  # bytes of an incomplete record at the end of a truncated file


def recover(path: Path) -> dict[str, int] | None:
    """End a file after its last undamaged chunk, with a summary and indexes of its messages.

    A truncated file is repaired in place; on a full disk the summary takes the place of the last chunks. Where other
    records are damaged, a new file takes its place; the original is kept as `damaged_original`, unless only indexes
    were damaged. Returns the number of messages by topic, or None if the file is complete and undamaged; it is not
    modified then.

    :raises InputError: this is not an MCAP file, or its damage cannot be repaired.
    :raises OSError: the file cannot be read or written.
    """
    with path.open("r+b") as stream:
        data = FileBytes(stream)
        if data[: len(MAGIC)] != MAGIC:
            raise InputError("is not an MCAP file, or was cut off before anything was written", NOTHING)
        found = read_data_section(data)
        if undefined := definition_problem(found.definitions):
            raise InputError(f"is damaged: {undefined}", UNREPAIRABLE)
        if not found.problem and not found.index_problem and not summary_problem(data, found):
            if found.content_problem:
                raise InputError(f"is damaged: {found.content_problem}", UNREPAIRABLE)
            if found.crc_agrees:
                return None
        if found.has_header and not found.index_problem and found.crc_agrees and _is_truncation(data, found.end):
            _end(path, data, found)
        else:
            found = _rewrite(path, data, found)
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


def _end(path: Path, data: ByteSource, found: DataSection) -> None:
    """Replace everything after the undamaged records by a summary.

    :raises OSError: it cannot be written.
    """
    file = DurableFile(path, existing=True)
    try:
        write_end(file, found, zlib.crc32(found.missing_indexes, crc_of(data, found.end)), found.missing_indexes)
    finally:
        file.close()


def _rewrite(path: Path, data: ByteSource, found: DataSection) -> DataSection:
    """Write the undamaged records into a new file, with new indexes, and let it take the place of this one.

    :raises InputError: a chunk contains damaged definitions; the file is not modified then.
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
                raise InputError(f"is damaged: {copy.index_problem}, within a chunk", UNREPAIRABLE)
            _end(draft, copied, copy)
        if not only_indexes:
            path.rename(damaged_original(path))
        draft.replace(path)
    finally:
        draft.unlink(missing_ok=True)
    return copy


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


def recover_bag(folder: Path) -> Iterator[tuple[Path, dict[str, int] | None]]:
    """Recover the files of a folder one by one, yielding the result of `recover` for each; then update its metadata.

    :raises InputError: a file is not an MCAP file.
    :raises OSError: a file cannot be read or written.
    """
    for file in _bag_files(folder):
        try:
            counts = recover(file)
        except InputError as error:
            raise InputError(f"{file.name}: {error.message}", error.remedy) from error
        yield file, counts
    update_metadata(folder)


def update_metadata(folder: Path) -> None:
    """Write `metadata.yaml` of a folder according to the contents of its files, which must be complete.

    Topics that the existing `metadata.yaml` does not contain are taken from the files: all of them where a recorder was
    killed before it wrote one.

    :raises ValueError: the existing `metadata.yaml` is not one of rosbag2.
    :raises InputError: there is no file.
    :raises OSError: a file cannot be read or written.
    """
    path = folder / FILE_NAME
    files = [read_mcap(file) for file in _bag_files(folder)]
    if path.exists() and any(folder.glob("*.mcap")):
        document = read_bag_metadata(path)
    elif files:
        document = {"custom_data": {"recorded_by": "mbd_sim"} if any(file.is_run for file in files) else {}}
    else:
        raise InputError("contains no .mcap file with any data", NOTHING)
    topics = _topics(document, files)
    write_metadata(
        path, bag_text(topics, [_statistics(file, topics) for file in files], document.get("custom_data") or {})
    )


def _topics(document: Mapping[str, Any], files: Sequence[RecordedFile]) -> list[Topic]:
    """Return the topics of a `metadata.yaml`, then the others of the files."""
    known = [entry["topic_metadata"] for entry in document.get("topics_with_message_count", [])]
    topics = {
        entry["name"]: Topic(
            entry["name"], entry["type"], yaml.safe_dump(entry["offered_qos_profiles"], sort_keys=False)
        )
        for entry in known
    }
    for file in files:
        for name, topic in file.topics.items():
            topics.setdefault(name, Topic(name, topic.type, topic.qos or "[]"))
    return list(topics.values())


def _statistics(file: RecordedFile, topics: Sequence[Topic]) -> FileStatistics:
    """Return message counts and times of a file, by the numbers of the topics."""
    statistics = FileStatistics(file.path)
    known = file.topics
    counts = {number: known[topic.name].count for number, topic in enumerate(topics, 1) if topic.name in known}
    if any(counts.values()):
        first_ns = min(block.start_ns for block in file.blocks)
        last_ns = max(block.end_ns for block in file.blocks)
        statistics.add(counts, first_ns, last_ns)
    return statistics


def _bag_files(folder: Path) -> list[Path]:
    """Return the files of the folder in order, without those that a killed recorder left empty.

    They keep their names if the folder is renamed.
    """
    return natural_order(path for path in folder.glob("*.mcap") if path.stat().st_size)
