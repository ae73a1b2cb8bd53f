"""Writes an MCAP file in complete chunks, and ends it in whatever way the disk permits.

The recorder and the changed runs of `rerun-with` write with it, and the end of repaired files. It replaces
`mcap.writer.Writer`, which keeps Python objects for each chunk.
"""

from __future__ import annotations

import contextlib
import errno
import os
import stat
import struct
import threading
import time
import zlib
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import zstandard
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Header, Metadata, MetadataIndex, Schema

from mbd_sim.base.operating_system import (
    BINARY,
    OPEN_FILES,
    RENAMES_OPEN_FILES,
    force_names_to_disk,
    force_to_disk,
    free_bytes,
)
from mbd_sim.recordings.mcap.contents import (
    MAGIC,
    Contents,
    Definitions,
    FileStatistics,
    attachment_index,
    chunk_index,
    encoded,
)
from mbd_sim.recordings.messages.cdr import RUN_METADATA, RecordedTopic
from mbd_sim.recordings.messages.definitions import Topic


def draft_path(path: Path) -> Path:
    """Return the hidden name under which a file is written until it has its first bytes."""
    return path.with_name(f".{path.name}.new")


class DurableFile:
    """A file whose data reach the operating system with each `write`, so that they survive a kill of the process.

    The file gets its name with the first `write`, so that no empty file is ever found. `sync` forces the data to the
    disk, which may take long: a thread other than the writing one calls it periodically. An error that the disk reports
    there is raised by the next `check`.
    """

    def __init__(self, path: Path, *, existing: bool = False) -> None:
        """Create the file; one that exists is replaced with the first `write`, unless it is the `existing` one.

        :raises OSError: it cannot be opened.
        """
        self._path = path
        is_named = path.parent != OPEN_FILES and (path.is_file() or not path.exists())  # else a device, pipe or memory
        self._draft = draft_path(path) if is_named and not existing else None
        flags = os.O_WRONLY | BINARY | (0 if existing else os.O_CREAT | os.O_TRUNC)
        try:
            self._descriptor = os.open(self._draft or path, flags, 0o666)
        except OSError as error:
            error.filename = str(path)  # the name that the user knows
            raise
        self._regular = is_named and stat.S_ISREG(os.fstat(self._descriptor).st_mode)
        self._position = self._synced = 0
        self._error: OSError | None = None
        self._closed = False
        self._lock = threading.Lock()

    def write(self, data: bytes) -> int:
        """Write all of the data.

        :raises OSError: not all could be written; a part may have been.
        """
        left = memoryview(data)
        while left:
            written = os.write(self._descriptor, left)
            self._position += written
            left = left[written:]
        if self._draft is not None:
            self._name(self._draft)
            self._draft = None
        return len(data)

    def _name(self, draft: Path) -> None:
        """Give the file its name."""
        if RENAMES_OPEN_FILES:
            draft.replace(self._path)
            return
        os.close(self._descriptor)
        draft.replace(self._path)
        self._descriptor = os.open(self._path, os.O_WRONLY | BINARY)
        os.lseek(self._descriptor, self._position, os.SEEK_SET)

    def truncate(self, size: int) -> None:
        """Remove everything after the first `size` bytes; the next `write` continues there.

        :raises OSError: that is not possible.
        """
        os.ftruncate(self._descriptor, size)
        os.lseek(self._descriptor, size, os.SEEK_SET)
        self._position = size

    def tell(self) -> int:
        """Return the number of bytes written."""
        return self._position

    def check(self) -> None:
        """Raise an error that occurred in the background.

        :raises OSError: the disk refused data written earlier.
        """
        if self._error is not None:
            raise self._error

    def free(self) -> int | None:
        """Return the number of bytes left on the disk, or None if this is not a regular file."""
        return free_bytes(self._descriptor, self._path) if self._regular else None

    def sync(self) -> None:
        """Force the written data to the disk; from any thread."""
        with self._lock:
            if self._closed or self._position == self._synced or not self._regular:
                return
            position = self._position
            try:
                if not self._synced and self._draft is None:
                    force_names_to_disk(self._path.parent)
                force_to_disk(self._descriptor)
            except OSError as error:
                if error.errno not in (errno.EINVAL, errno.ENOSYS):  # some file systems do not support it
                    self._error = error
            self._synced = position

    def close(self) -> None:
        """Force the rest to the disk and close; calling it again has no effect.

        :raises OSError: the disk refused it.
        """
        self.sync()
        with self._lock:
            if self._closed:
                return
            self._closed = True
            os.close(self._descriptor)
            if self._draft is not None:
                with contextlib.suppress(OSError):
                    self._draft.unlink()
        self.check()


DISK_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
FREED_AT_MOST = 1 << 15  # bytes of chunks, besides its own size, that the end of a file may replace on a full disk
FREED_IN_VAIN = 1 << 13  # bytes after which the disk, if it still accepts nothing, is not merely full


def write_end(file: DurableFile, contents: Contents, crc: int, indexes: bytes = b"") -> None:
    """End a file after its complete records; on a full disk the end takes the place of the last chunks.

    :param crc: the checksum of the records and the indexes, or 0 if it is not known.
    :param indexes: those of the messages of the last chunk, if the file lacks them.
    :raises OSError: the disk refuses it; the file is truncated then.
    """
    freed = 0
    while True:
        end = indexes + contents.file_end(contents.end + len(indexes), crc)
        try:
            file.truncate(contents.end)
            file.write(end)
            return
        except OSError as error:
            accepted = file.tell() - contents.end
            in_vain = not accepted and freed > FREED_IN_VAIN
            full = error.errno in DISK_FULL and not in_vain and freed <= len(end) + FREED_AT_MOST
            if not contents.chunks or not full:
                with contextlib.suppress(OSError):
                    file.truncate(contents.end)
                raise
        freed += contents.drop_last_chunk()
        crc, indexes = 0, b""


CHUNK_SIZE = 1 << 20  # bytes of messages after which a chunk is written
RESERVE = 1 << 20  # bytes left free on a disk, so that the end of the file still fits, and
INDEX_RESERVE = 256  # bytes of it for each chunk
ATTACHMENT = "mechanism.yaml"
_MESSAGE = struct.Struct("<BQHIQQ")  # a message's record up to its payload: 22 bytes of it follow opcode and length
_INDEX_ENTRY = struct.Struct("<QQ")  # log time, and offset in the chunk
_MESSAGE_INDEX = struct.Struct("<BQHI")  # its record up to the entries


class DiskNearlyFullError(OSError):
    """So little space is left on the disk that the file should be finished."""


class McapWriter:
    """Writes all that describes the file first, so that it survives a kill; then chunks of messages."""

    def __init__(
        self,
        path: Path,
        topics: Sequence[Topic | RecordedTopic],
        open_file: Callable[[Path], DurableFile] = DurableFile,
    ) -> None:
        """Open an empty file.

        :raises OSError: it cannot be opened.
        """
        self.path = path
        self.complete = False  # whether the file has its summary and index
        self._file = open_file(path)
        types = list(dict.fromkeys(topic.type for topic in topics))
        definitions = {topic.type: topic.definition.encode() for topic in topics}
        schemas = {n: Schema(n, definitions[name], "ros2msg", name) for n, name in enumerate(types, 1)}
        channels = {
            number: Channel(
                id=number,
                topic=topic.name,
                message_encoding="cdr",
                metadata={"offered_qos_profiles": topic.qos, "topic_type_hash": topic.hash},
                schema_id=types.index(topic.type) + 1,
            )
            for number, topic in enumerate(topics, 1)
        }
        self._contents = Contents(FileStatistics(path), definitions=Definitions(schemas, channels))
        self._compressor = zstandard.ZstdCompressor()
        self._chunk, self._entries = bytearray(), [bytearray() for _ in topics]
        self._first_ns = self._last_ns = 0  # of the chunk
        self._crc = 0  # of the complete records

    @property
    def statistics(self) -> FileStatistics:
        """The messages in the file; their channels are the numbers of the topics, from 1 on."""
        return self._contents.statistics

    @property
    def size(self) -> int:
        """The size of the complete records in the file, in bytes."""
        return self._contents.end

    def begin(self, mechanism_text: str, metadata: Mapping[str, str]) -> None:
        """Write the header, the mechanism's file, the metadata and the definitions of all topics.

        :raises OSError: they cannot be written.
        """
        now = time.time_ns()
        attachment = Attachment(now, now, ATTACHMENT, "application/yaml", mechanism_text.encode())
        head = MAGIC + encoded(Header("ros2", "mbd_sim"))
        attached, described = encoded(attachment), encoded(Metadata(RUN_METADATA, dict(metadata)))
        contents = self._contents
        known = (*contents.definitions.schemas.values(), *contents.definitions.channels.values())
        definitions = b"".join(encoded(definition) for definition in known)
        self._write(head + attached + described + definitions)  # in one call: a kill leaves all of it, or nothing
        contents.attachments = [attachment_index(attachment, len(head), len(attached))]
        contents.metadata = [MetadataIndex(len(head) + len(attached), len(described), RUN_METADATA)]

    def add(self, topic: int, payload: bytes, time_ns: int, sequence: int) -> None:
        """Add a message of a topic, given by its number, to the chunk.

        :raises OSError: the chunk was full and cannot be written.
        :raises DiskNearlyFullError: the chunk was full and has been written, but little space is left.
        """
        chunk = self._chunk
        if not chunk:
            self._first_ns = self._last_ns = time_ns
        elif time_ns > self._last_ns:
            self._last_ns = time_ns
        elif time_ns < self._first_ns:
            self._first_ns = time_ns
        self._entries[topic] += _INDEX_ENTRY.pack(time_ns, len(chunk))
        chunk += _MESSAGE.pack(Opcode.MESSAGE, 22 + len(payload), topic + 1, sequence, time_ns, time_ns)
        chunk += payload
        if len(chunk) > CHUNK_SIZE:
            self.flush()

    def flush(self) -> None:
        """Write the chunk, so that its messages survive a kill.

        :raises OSError: it cannot be written.
        :raises DiskNearlyFullError: it has been written, but little space is left.
        """
        self._write_chunk()
        free = self._file.free()
        if free is not None and free < RESERVE + INDEX_RESERVE * len(self._contents.chunks):
            raise DiskNearlyFullError(f"only {free / 1e6:.1f} MB are left on the disk")

    def _write_chunk(self) -> None:
        if not self._chunk:
            return
        content = bytes(self._chunk)
        chunk = Chunk(
            compression="zstd",
            data=self._compressor.compress(content),
            message_start_time=self._first_ns,
            message_end_time=self._last_ns,
            uncompressed_crc=zlib.crc32(content),
            uncompressed_size=len(content),
        )
        record = bytearray(encoded(chunk))
        offset, length = self.size, len(record)
        index = chunk_index(chunk, offset, length)
        for number, entries in enumerate(self._entries):
            if entries:
                index.message_index_offsets[number + 1] = offset + len(record)
                record += _MESSAGE_INDEX.pack(Opcode.MESSAGE_INDEX, 2 + 4 + len(entries), number + 1, len(entries))
                record += entries
        index.message_index_length = len(record) - length
        self._write(bytes(record))
        counts = {number: len(entries) // _INDEX_ENTRY.size for number, entries in enumerate(self._entries, 1)}
        self._contents.add_chunk(index, counts)
        for entries in self._entries:
            entries.clear()
        self._chunk.clear()

    def sync(self) -> None:
        """Force the written data to the disk, however long it takes; from any thread."""
        self._file.sync()

    def finish(self) -> None:
        """Write the last chunk, the summary and the index.

        :raises OSError: they cannot be written; `abandon` then saves as much as possible.
        """
        self._write_chunk()
        self._file.write(self._contents.file_end(self.size, self._crc))
        self._file.check()
        self._contents.end, self.complete = self._file.tell(), True

    def close(self) -> None:
        """Force the file to the disk, however long it takes, and close it.

        :raises OSError: the disk refused it.
        """
        self._file.close()

    def abandon(self) -> int:
        """End the file after its last complete chunk, with an index if the disk accepts it, and close it.

        For use after an error. On a full disk the index takes the place of the last chunks. `complete` says whether
        the index has been written. Returns how many of the added messages are not in the file.
        """
        added = self.statistics.messages + sum(len(entries) for entries in self._entries) // _INDEX_ENTRY.size
        with contextlib.suppress(OSError):
            if self.size and not self.complete:
                write_end(self._file, self._contents, self._crc)
                self.complete = True
        with contextlib.suppress(OSError):
            self._file.close()
        return added - self.statistics.messages

    def repaired(self, counts: Sequence[int]) -> None:
        """Note that the file has been completed after `abandon`, with these messages by topic."""
        self.complete = True
        self.statistics.counts = +Counter(dict(enumerate(counts, 1)))

    def _write(self, records: bytes) -> None:
        """Write complete records."""
        self._file.write(records)
        self._file.check()
        self._crc = zlib.crc32(records, self._crc)
        self._contents.end += len(records)
