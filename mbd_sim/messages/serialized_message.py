"""Messages of constant size, serialized once as CDR; afterwards only their numbers are written, into the bytes.

CDR (OMG DDS-XTypes 1.3, section 7.4, version 1): four bytes that give the byte order, then the fields, each aligned to
its size. Filling and serializing a message by rclpy takes some 10 µs with the interpreter's lock held; this takes one
or two, and needs no ROS.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mbd_sim.geometry.pose import Array

_LITTLE_ENDIAN = b"\x00\x01\x00\x00"
_HEADER = len(_LITTLE_ENDIAN)  # alignment counts from its end


@dataclass(frozen=True, slots=True)
class Doubles:
    """The place of consecutive doubles in a message: the offset of the first byte, and how many there are."""

    offset: int
    size: int


@dataclass(frozen=True, slots=True)
class Singles:
    """The place of consecutive `float32` numbers in a message: the offset of the first byte, and how many there are."""

    offset: int
    size: int


class SerializedMessage:
    """The bytes of a message, with views of the numbers that change."""

    def __init__(self, data: bytearray, stamps: Sequence[int]) -> None:
        """Take the bytes, and the offsets of the stamps in them; the stamps become zero."""
        self._data = data
        self._words = np.frombuffer(data, dtype=np.uint32, count=len(data) // 4)
        self._seconds = np.array(stamps, dtype=np.intp) // 4
        self._nanoseconds = self._seconds + 1
        self.stamp(0)

    def view(self, place: Doubles) -> Array:
        """A writable view (size,) of doubles, which become zero."""
        if not place.size:
            return np.empty(0)
        view = np.frombuffer(self._data, dtype=np.float64, count=place.size, offset=place.offset)
        view[:] = 0.0
        return view

    def single_view(self, place: Singles) -> NDArray[np.float32]:
        """A writable view (size,) of `float32` numbers."""
        return np.frombuffer(self._data, dtype=np.float32, count=place.size, offset=place.offset)

    def offset_of(self, view: NDArray[np.float64] | NDArray[np.float32]) -> int:
        """The offset of the first byte of a view of this message."""
        return int(view.ctypes.data - self._words.ctypes.data)

    def stamp(self, time_ns: int) -> None:
        """Write a time in ns to all stamps."""
        self._words[self._seconds], self._words[self._nanoseconds] = divmod(time_ns, 1_000_000_000)

    def payload(self) -> bytes:
        """The serialized message with its present numbers."""
        return bytes(self._data)

    def __len__(self) -> int:
        return len(self._data)


class MessageBuilder:
    """Serializes the fields of a message in the order of its definition."""

    def __init__(self) -> None:
        self._data = bytearray(_LITTLE_ENDIAN)
        self._stamps: list[int] = []

    def byte(self, value: int) -> None:
        """Append a `uint8`."""
        self._data += struct.pack("<B", value)

    def singles(self, count: int) -> Singles:
        """Append `float32` fields, whose values can be written later."""
        self._align(4)
        offset = len(self._data)
        self._data += bytes(4 * count)
        return Singles(offset, count)

    def integer(self, value: int) -> None:
        """Append a `uint32`, or the length of a sequence."""
        self._align(4)
        self._data += struct.pack("<I", value)

    def text(self, value: str) -> None:
        """Append a `string`."""
        encoded = value.encode() + b"\0"
        self.integer(len(encoded))
        self._data += encoded

    def texts(self, values: Sequence[str]) -> None:
        """Append a `string[]`."""
        self.integer(len(values))
        for value in values:
            self.text(value)

    def header(self, frame: str = "") -> None:
        """Append a `std_msgs/Header`, whose stamp can be written later."""
        self._align(4)
        self._stamps.append(len(self._data))
        self._data += bytes(8)
        self.text(frame)

    def doubles(self, count: int) -> Doubles:
        """Append `float64` fields, whose values can be written later."""
        if count:
            self._align(8)
        offset = len(self._data)
        self._data += bytes(8 * count)
        return Doubles(offset, count)

    def sequence(self, count: int) -> Doubles:
        """Append a `float64[]`, whose values can be written later."""
        self.integer(count)
        return self.doubles(count)

    def message(self) -> SerializedMessage:
        """The message; nothing may be appended afterwards."""
        return SerializedMessage(self._data, self._stamps)

    def _align(self, size: int) -> None:
        self._data += bytes((_HEADER - len(self._data)) % size)


def string_message(text: str) -> bytes:
    """A `std_msgs/msg/String`."""
    builder = MessageBuilder()
    builder.text(text)
    return builder.message().payload()
