"""Message classes by the names of their types, and messages of constant size that are serialized once.

Such a message comes from rclpy's own message; after the first serialization only its numbers are written.
"""

from __future__ import annotations

import importlib
import struct
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from rclpy.serialization import serialize_message

from mbd_sim.base.geometry.pose import Array
from mbd_sim.recordings.messages.cdr import Doubles, SerializedMessage


def message_type(name: str) -> type:
    """The class of a type such as `std_msgs/msg/String`.

    :raises ImportError, AttributeError: it is not installed.
    :raises ValueError: the name is not that of a type.
    """
    package, _, kind = name.partition("/")
    kind = kind.rpartition("/")[2]
    if not package or not kind:
        raise ValueError(f"'{name}' is not the name of a message type.")
    found: type = getattr(importlib.import_module(f"{package}.msg"), kind)
    return found


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
