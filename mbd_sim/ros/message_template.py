"""Messages of constant size, serialized once; afterwards only their numbers are written, into the bytes.

Filling and serializing a message takes some 10 µs with the interpreter's lock held; this takes one or two.
"""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from rclpy.serialization import serialize_message

from mbd_sim.geometry.pose import Array

STAMP = Time(sec=0x5A3C96E1, nanosec=0x2D87F14B)  # a placeholder for the time of each message


def slot(number: int) -> float:
    """A placeholder for the first double of a slot, unique for each slot number."""
    return -1.5e300 * (1.0 + number * 2.0**-40)


class MessageTemplate:
    """A serialized message, with views into the bytes that change."""

    def __init__(self, message: Any) -> None:
        """Serialize a message in which `STAMP` and `slot` values mark the values that are written later."""
        self._buffer = bytearray(serialize_message(message))
        self._words = np.frombuffer(self._buffer, dtype=np.uint32, count=len(self._buffer) // 4)
        seconds = np.flatnonzero((self._words[:-1] == STAMP.sec) & (self._words[1:] == STAMP.nanosec))
        self._seconds, self._nanoseconds = seconds, seconds + 1
        self.stamp(0)

    def doubles(self, number: int, count: int) -> Array:
        """A writable view (count,) of the message's doubles from `slot(number)` on."""
        if not count:
            return np.empty(0)
        offset = self._buffer.find(struct.pack("=d", slot(number)))
        view = np.frombuffer(self._buffer, dtype=np.float64, count=count, offset=offset)
        view[:] = 0.0
        return view

    def stamp(self, time_ns: int) -> None:
        """Write a time in ns to all stamps."""
        self._words[self._seconds], self._words[self._nanoseconds] = divmod(time_ns, 1_000_000_000)

    def payload(self) -> bytes:
        """The serialized message with its present numbers."""
        return bytes(self._buffer)

    def __len__(self) -> int:
        return len(self._buffer)
