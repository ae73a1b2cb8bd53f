"""Decodes recorded messages: the types that runs consist of as fast as `verify` needs it, all others by `rosbags`.

CDR (OMG DDS-XTypes 1.3, section 7.4, version 1): four bytes that give the byte order, then the fields, each aligned to
its size.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from mbd_sim.geometry.pose import Array
from mbd_sim.recording.recorded_file import ReadingError, RecordedTopic

JOINT_STATE = "sensor_msgs/msg/JointState"
MULTI_ARRAY = "std_msgs/msg/Float64MultiArray"
STRING = "std_msgs/msg/String"
_LITTLE_ENDIAN, _BIG_ENDIAN = np.dtype("<f8"), np.dtype(">f8")
_STAMP = {0: struct.Struct(">iI"), 1: struct.Struct("<iI")}  # by the second byte: big-endian, little-endian
_STAMP_OFFSET = 4
_NANO = 1_000_000_000


class JointStates(NamedTuple):
    """A `sensor_msgs/msg/JointState`: arrays (n,) in rad or m, rad/s or m/s, and N·m or N."""

    stamp_ns: int
    frame: str
    names: tuple[str, ...]
    position: Array
    velocity: Array
    effort: Array


class MultiArray(NamedTuple):
    """A `std_msgs/msg/Float64MultiArray`: its values (n,), and the labels of its dimensions."""

    labels: tuple[str, ...]
    values: Array


class _CdrReader:
    """Reads the fields of one message in order; `offset` is that of the next byte."""

    def __init__(self, payload: bytes) -> None:
        if len(payload) < 4 or payload[0] != 0 or payload[1] > 1:
            raise ReadingError(f"is not CDR: it begins with {payload[:4].hex(' ')}")
        self._byte_order = "<" if payload[1] else ">"
        self._payload, self.offset = payload, 4

    def integer(self) -> int:
        """Read an unsigned integer of 32 bits."""
        start = self._aligned(4)
        self.offset = start + 4
        return int(struct.unpack_from(self._byte_order + "I", self._payload, start)[0])

    def text(self) -> str:
        """Read a string."""
        length = self.integer()
        start, self.offset = self.offset, self.offset + length
        if self.offset > len(self._payload):
            raise ReadingError("ends within a string")
        return self._payload[start : self.offset].rstrip(b"\0").decode("utf-8", "replace")

    def doubles(self) -> Array:
        """Read a sequence of numbers of 64 bits."""
        count = self.integer()
        if not count:
            return np.empty(0)
        start = self._aligned(8)
        self.offset = start + 8 * count
        return np.frombuffer(self._payload, dtype=self._byte_order + "f8", count=count, offset=start)

    def _aligned(self, size: int) -> int:
        return self.offset + (4 - self.offset) % size


@dataclass(frozen=True, slots=True)
class _ArrayLayout:
    """Offsets and sizes of a message's arrays, and all bytes between them, which seldom change from one to the next."""

    names: tuple[str, ...]
    frame: str
    starts: tuple[int, ...]
    counts: tuple[int, ...]
    constant: tuple[tuple[int, int, bytes], ...]  # start, end and content

    @classmethod
    def of(
        cls, payload: bytes, begin: int, names: tuple[str, ...], frame: str, ends: Sequence[int], counts: Sequence[int]
    ) -> _ArrayLayout:
        """Return the layout of a message with arrays of these ends and sizes; constant are bytes from `begin` on."""
        starts = [end - 8 * count for end, count in zip(ends, counts, strict=True)]
        spans = [(0, 4), *zip([begin, *ends], starts, strict=False)]
        constant = tuple((first, last, payload[first:last]) for first, last in spans)
        return cls(names, frame, tuple(starts), tuple(counts), constant)

    def fits(self, payload: bytes) -> bool:
        """Whether a message of the same length has this layout."""
        return all(payload[first:last] == content for first, last, content in self.constant)

    def array_bytes(self, payload: bytes) -> bytes:
        """Return the bytes of all arrays, concatenated."""
        spans = zip(self.starts, self.counts, strict=True)
        return b"".join([payload[start : start + 8 * count] for start, count in spans])

    def arrays(self, payload: bytes) -> list[Array]:
        """Return the arrays."""
        dtype = _dtype(payload)
        return [
            np.frombuffer(payload, dtype, count, start) for start, count in zip(self.starts, self.counts, strict=True)
        ]


_joint_state_layouts: dict[int, _ArrayLayout] = {}  # by the length of the message
_multi_array_layouts: dict[int, _ArrayLayout] = {}


def _joint_state_layout(payload: bytes) -> _ArrayLayout:
    layout = _joint_state_layouts.get(len(payload))
    if layout is None or not layout.fits(payload):
        reader = _CdrReader(payload)
        reader.integer(), reader.integer()  # the stamp
        begin, frame = reader.offset, reader.text()
        names = tuple(reader.text() for _ in range(reader.integer()))
        arrays = [(reader.doubles(), reader.offset) for _ in range(3)]
        ends, counts = [end for _, end in arrays], [len(values) for values, _ in arrays]
        layout = _ArrayLayout.of(payload, begin, names, frame, ends, counts)
        _joint_state_layouts[len(payload)] = layout
    return layout


def _multi_array_layout(payload: bytes) -> _ArrayLayout:
    layout = _multi_array_layouts.get(len(payload))
    if layout is None or not layout.fits(payload):
        reader = _CdrReader(payload)
        labels = []
        for _ in range(reader.integer()):
            labels.append(reader.text())
            reader.integer(), reader.integer()  # size and stride
        reader.integer()  # data_offset
        values = reader.doubles()
        layout = _ArrayLayout.of(payload, 4, tuple(labels), "", [reader.offset], [len(values)])
        _multi_array_layouts[len(payload)] = layout
    return layout


def joint_states(payload: bytes) -> JointStates:
    """Decode a `sensor_msgs/msg/JointState`."""
    layout = _joint_state_layout(payload)
    return JointStates(_stamp_ns(payload), layout.frame, layout.names, *layout.arrays(payload))


def joint_state_bytes(payload: bytes) -> tuple[int, tuple[str, ...], bytes]:
    """Return stamp in ns, names, and the bytes of all arrays of a `sensor_msgs/msg/JointState`."""
    layout = _joint_state_layout(payload)
    return _stamp_ns(payload), layout.names, layout.array_bytes(payload)


def multi_array(payload: bytes) -> MultiArray:
    """Decode a `std_msgs/msg/Float64MultiArray`."""
    layout = _multi_array_layout(payload)
    return MultiArray(layout.names, *layout.arrays(payload))


def multi_array_bytes(payload: bytes) -> tuple[tuple[str, ...], bytes]:
    """Return the labels, and the bytes of the values of a `std_msgs/msg/Float64MultiArray`."""
    layout = _multi_array_layout(payload)
    return layout.names, layout.array_bytes(payload)


def text(payload: bytes) -> str:
    """Decode a `std_msgs/msg/String`."""
    return _CdrReader(payload).text()


def with_arrays(topic: RecordedTopic, payload: bytes, arrays: Sequence[Array], stamp_ns: int) -> bytes:
    """Return a message of joint states or a multi-array with other arrays; joint states also get another stamp."""
    is_joint_state = topic.type == JOINT_STATE
    layout = _joint_state_layout(payload) if is_joint_state else _multi_array_layout(payload)
    changed = bytearray(payload)
    if is_joint_state:
        _STAMP[payload[1]].pack_into(changed, _STAMP_OFFSET, *divmod(stamp_ns, _NANO))
    dtype = _dtype(payload)
    for start, count, array in zip(layout.starts, layout.counts, arrays, strict=True):
        changed[start : start + 8 * count] = np.asarray(array, dtype=dtype).tobytes()
    return bytes(changed)


def decode(topic: RecordedTopic, payload: bytes) -> Any:
    """Decode a message of a topic.

    :raises ReadingError: it does not have the topic's type.
    """
    if topic.encoding != "cdr":
        raise ReadingError(f"is encoded as '{topic.encoding}', not as CDR")
    try:
        decoder = _DECODERS.get(topic.type) or _rosbags_decoder(topic.type, topic.definition)
        return decoder(payload)
    except (struct.error, ValueError, IndexError, KeyError, AssertionError) as error:
        raise ReadingError(f"is not a {topic.type} ({error})") from error


_DECODERS: dict[str, Callable[[bytes], Any]] = {JOINT_STATE: joint_states, MULTI_ARRAY: multi_array, STRING: text}


@cache
def _rosbags_decoder(type_name: str, definition: str) -> Callable[[bytes], Any]:
    """Return a decoder for a type as defined in the recording, or else in ROS 2 Jazzy."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.EMPTY if definition else Stores.ROS2_JAZZY)
    if definition:
        store.register(get_types_from_msg(definition, type_name))
    return lambda payload: store.deserialize_cdr(payload, type_name)


def _stamp_ns(payload: bytes) -> int:
    seconds, nanoseconds = _STAMP[payload[1]].unpack_from(payload, _STAMP_OFFSET)
    return int(seconds * _NANO + nanoseconds)


def _dtype(payload: bytes) -> np.dtype[np.float64]:
    return _LITTLE_ENDIAN if payload[1] else _BIG_ENDIAN
