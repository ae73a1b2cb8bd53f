"""Messages of constant size from rclpy's own messages, serialized once; afterwards only their numbers are written."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from rclpy.serialization import serialize_message

from mbd_sim.geometry.pose import Array
from mbd_sim.messages.serialized_message import Doubles, SerializedMessage

STAMP = Time(sec=0x5A3C96E1, nanosec=0x2D87F14B)  # a placeholder for the time of each message


def slot(number: int) -> float:
    """A placeholder for the first double of a slot, unique for each slot number."""
    return -1.5e300 * (1.0 + number * 2.0**-40)


class MessageTemplate(SerializedMessage):
    """A serialized message of rclpy, with views into the bytes that change."""

    def __init__(self, message: Any) -> None:
        """Serialize a message in which `STAMP` and `slot` values mark the values that are written later."""
        data = bytearray(serialize_message(message))
        words = np.frombuffer(data, dtype=np.uint32, count=len(data) // 4)
        stamps = 4 * np.flatnonzero((words[:-1] == STAMP.sec) & (words[1:] == STAMP.nanosec))
        super().__init__(data, stamps.tolist())

    def doubles(self, number: int, count: int) -> Array:
        """A writable view (count,) of the message's doubles from `slot(number)` on."""
        offset = self._data.find(struct.pack("=d", slot(number))) if count else 0
        return self.view(Doubles(offset, count))
