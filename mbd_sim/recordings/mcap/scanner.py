"""Records of MCAP data (https://mcap.dev/spec): a file, whole, truncated or damaged, or the content of a chunk.

This is the only place that steps from record to record. `reader` and `repair` interpret the records.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from io import BytesIO
from typing import IO, Protocol

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Schema

from mbd_sim.base.operating_system import read_at

MAGIC = b"\x89MCAP0\r\n"
RECORD_HEADER = struct.Struct("<BQ")  # opcode, length of the content
MESSAGE_HEADER = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
PARSE_ERRORS = (McapError, ValueError, OverflowError, struct.error)  # raised for a record whose content is damaged
_CRC = struct.Struct("<I")
_PIECE = 1 << 22  # bytes that are read at once
MAX_LENGTH = 1 << 32  # bytes of a record; a greater length can only be a damaged one
_OPCODES = frozenset(int(opcode) for opcode in Opcode) | frozenset(range(0x80, 0x100))  # 0x80 and above are private
_MESSAGE = int(Opcode.MESSAGE)  # members of an enumeration are slow to look up


class BrokenRecordError(ValueError):
    """A record that is incomplete or damaged; the message says where and why, without the file's name."""


class ByteSource(Protocol):
    """Random access to bytes: `bytes`, `bytearray`, or `FileBytes`."""

    def __len__(self) -> int:
        """Return the number of bytes."""
        ...

    def __getitem__(self, span: slice, /) -> bytes | bytearray:
        """Return some of the bytes; a slice beyond the end is cut there, as for `bytes`."""
        ...


class FileBytes:
    """The bytes of an open file, read on access.

    A memory map would raise SIGBUS where the file shrinks or the disk fails; this raises `OSError`.
    """

    def __init__(self, stream: IO[bytes]) -> None:
        self._descriptor = stream.fileno()
        self._size = os.fstat(self._descriptor).st_size

    def __len__(self) -> int:
        """Return the size that the file had when this was made."""
        return self._size

    def __getitem__(self, span: slice, /) -> bytes:
        """Read some of the bytes.

        :raises OSError: they cannot be read, or the file has been truncated.
        """
        start, stop, _ = span.indices(self._size)
        found = read_at(self._descriptor, stop - start, start)
        if len(found) < stop - start:
            raise OSError(None, "the file was truncated while it was being read")
        return found


@dataclass
class Definitions:
    """Schemas and channels by their numbers."""

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)

    def add(self, opcode: int, content: bytes | bytearray) -> None:
        """Add a record if it is a schema or a channel.

        :raises PARSE_ERRORS: its content is damaged.
        """
        if opcode == Opcode.SCHEMA:
            schema = Schema.read(data_stream(content))
            self.schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
            channel = Channel.read(data_stream(content))
            self.channels[channel.id] = channel


def data_stream(content: bytes | bytearray) -> ReadDataStream:
    """Return the content of a record in the form in which `mcap.records` reads it."""
    return ReadDataStream(BytesIO(content), calculate_crc=True)


def scan_records(data: ByteSource, start: int = 0) -> Iterator[tuple[int, int, int]]:
    """Yield opcode, start and end of the content of each record, in order.

    Stops without an error where fewer bytes remain than the header of a record has.

    :raises BrokenRecordError: a record extends beyond the end of the data, or there is none where one should begin.
    """
    end, size, header_size = start, len(data), RECORD_HEADER.size
    read_header, opcodes, max_length = _header_reader(data), _OPCODES, MAX_LENGTH
    while (begin := end + header_size) <= size:
        opcode, length = read_header(end)
        end = begin + length
        if end > size or opcode not in opcodes or length > max_length:
            position = begin - header_size
            if opcode not in opcodes or length > max_length:
                raise BrokenRecordError(f"damaged: there is no valid record at byte {position}")
            raise BrokenRecordError(
                f"cut off: it ends at byte {size}, within the record that begins at byte {position}"
            )
        yield opcode, begin, end


def _header_reader(data: ByteSource) -> Callable[[int], tuple[int, int]]:
    """Return a function that reads opcode and length of the record at a position; the fastest for bytes."""
    if isinstance(data, bytes):
        return partial(RECORD_HEADER.unpack_from, data)
    return lambda position: RECORD_HEADER.unpack(data[position : position + RECORD_HEADER.size])


def scan_messages(data: bytes) -> Iterator[tuple[int, int, int, bytes]]:
    """Yield channel, sequence number, log time in ns and payload of each message in the content of a chunk.

    :raises BrokenRecordError: a record is incomplete.
    """
    unpack, header = MESSAGE_HEADER.unpack_from, MESSAGE_HEADER.size
    for opcode, begin, end in scan_records(data):
        if opcode == _MESSAGE:
            if end - begin < header:
                raise BrokenRecordError("damaged: a message is too short")
            channel, sequence, log_time, _ = unpack(data, begin)
            yield channel, sequence, log_time, data[begin + header : end]


def attachment_is_intact(content: bytes | bytearray) -> bool:
    """Whether the content of an attachment's record agrees with the CRC at its end (0: none)."""
    (crc,) = _CRC.unpack(content[-_CRC.size :])
    return not crc or zlib.crc32(content[: -_CRC.size]) == crc


def crc_of(data: ByteSource, end: int) -> int:
    """Return the CRC-32 of the first `end` bytes."""
    crc = 0
    for start in range(0, end, _PIECE):
        crc = zlib.crc32(data[start : min(start + _PIECE, end)], crc)
    return crc


def chunk_content(stored: bytes, compression: str, size: int, crc: int) -> bytes:
    """Decompress the records of a chunk; `size` and `crc` (0: none) are those of the uncompressed records.

    :raises BrokenRecordError: they cannot be decompressed, or the checksum differs.
    """
    try:
        content = _decompressed(stored, compression, size)
    except Exception as error:  # zstandard and lz4 raise their own errors
        raise BrokenRecordError(f"cannot be decompressed ({error})") from error
    if crc and zlib.crc32(content) != crc:
        raise BrokenRecordError("fails its CRC check")
    return content


def _decompressed(stored: bytes, compression: str, size: int) -> bytes:
    if compression == "zstd":
        import zstandard

        return bytes(zstandard.ZstdDecompressor().decompress(stored, max_output_size=size))
    if compression == "lz4":
        import lz4.frame

        return bytes(lz4.frame.decompress(stored))
    if compression:
        raise ValueError(f"compression '{compression}' is unknown")
    return stored
