"""What recorded messages say: own decoding of what runs are made of, as fast as `verify` needs it; else `rosbags`.

CDR (OMG DDS-XTypes 7.4, version 1): four bytes that name the byte order, then the fields, each aligned to its size.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from mbd_sim.geometry.pose import Array
from mbd_sim.recording.contents import ReadingError, RecordedTopic


class JointStates(NamedTuple):
    """A `sensor_msgs/msg/JointState`: arrays (n,) in rad or m, rad/s or m/s, and N·m or N."""

    stamp_ns: int
    frame: str
    names: tuple[str, ...]
    position: Array
    velocity: Array
    effort: Array


class Numbers(NamedTuple):
    """A `std_msgs/msg/Float64MultiArray`: its numbers (n,), and the labels of its dimensions."""

    labels: tuple[str, ...]
    values: Array


class _Reader:
    """Goes through the bytes of one message."""

    def __init__(self, payload: bytes) -> None:
        if len(payload) < 4 or payload[0] != 0 or payload[1] > 1:
            raise ReadingError(f"is no CDR: it begins with {payload[:4].hex(' ')}")
        self._order = "<" if payload[1] else ">"
        self._payload, self._at = payload, 4

    def _aligned(self, size: int) -> int:
        return self._at + (4 - self._at) % size

    @property
    def at(self) -> int:
        """The next byte."""
        return self._at

    def word(self, kind: str = "I") -> int:
        at = self._aligned(4)
        self._at = at + 4
        return int(struct.unpack_from(self._order + kind, self._payload, at)[0])

    def text(self) -> str:
        length = self.word()
        begin, self._at = self._at, self._at + length
        if self._at > len(self._payload):
            raise ReadingError("ends within a text")
        return self._payload[begin : self._at].rstrip(b"\0").decode("utf-8", "replace")

    def doubles(self) -> Array:
        count = self.word()
        if not count:
            return np.empty(0)
        at = self._aligned(8)
        self._at = at + 8 * count
        return np.frombuffer(self._payload, dtype=self._order + "f8", count=count, offset=at)


class _Layout(NamedTuple):
    """Where the doubles of messages of one length stand, and all that lies between them: it seldom changes."""

    names: tuple[str, ...]
    frame: str
    starts: tuple[int, ...]
    counts: tuple[int, ...]
    fixed: tuple[tuple[int, int, bytes], ...]  # begin, end and content

    @classmethod
    def of(
        cls, payload: bytes, begin: int, names: tuple[str, ...], frame: str, ends: Sequence[int], counts: Sequence[int]
    ) -> _Layout:
        """Layout of a message whose arrays have these ends and counts; what is fixed begins at `begin`."""
        starts = [end - 8 * count for end, count in zip(ends, counts, strict=True)]
        spans = [(0, 4), *zip([begin, *ends], starts, strict=False)]
        fixed = tuple((first, last, payload[first:last]) for first, last in spans)
        return cls(names, frame, tuple(starts), tuple(counts), fixed)

    def fits(self, payload: bytes) -> bool:
        """Whether a message of the same length has this layout."""
        return all(payload[first:last] == content for first, last, content in self.fixed)

    def bits(self, payload: bytes) -> bytes:
        """All arrays as they stand in the message, one behind the other."""
        parts = [payload[start : start + 8 * count] for start, count in zip(self.starts, self.counts, strict=True)]
        return b"".join(parts)

    def doubles(self, payload: bytes) -> list[Array]:
        """The arrays."""
        kind = _LITTLE if payload[1] else _BIG
        return [
            np.frombuffer(payload, kind, count, start) for start, count in zip(self.starts, self.counts, strict=True)
        ]


_LITTLE, _BIG = np.dtype("<f8"), np.dtype(">f8")
_STAMP = {0: struct.Struct(">iI"), 1: struct.Struct("<iI")}
_joint_layouts: dict[int, _Layout] = {}  # by the length of the message
_number_layouts: dict[int, _Layout] = {}


def _joint_layout(payload: bytes) -> _Layout:
    layout = _joint_layouts.get(len(payload))
    if layout is None or not layout.fits(payload):
        reader = _Reader(payload)
        reader.word(), reader.word()  # the stamp
        begin, frame = reader.at, reader.text()
        names = tuple(reader.text() for _ in range(reader.word()))
        found = [(reader.doubles(), reader.at) for _ in range(3)]
        counts = [len(values) for values, _ in found]
        layout = _Layout.of(payload, begin, names, frame, [end for _, end in found], counts)
        _joint_layouts[len(payload)] = layout
    return layout


def _number_layout(payload: bytes) -> _Layout:
    layout = _number_layouts.get(len(payload))
    if layout is None or not layout.fits(payload):
        reader = _Reader(payload)
        labels = []
        for _ in range(reader.word()):
            labels.append(reader.text())
            reader.word(), reader.word()  # size and stride
        reader.word()  # data_offset
        values = reader.doubles()
        layout = _Layout.of(payload, 4, tuple(labels), "", [reader.at], [len(values)])
        _number_layouts[len(payload)] = layout
    return layout


def joint_states(payload: bytes) -> JointStates:
    """Decode a `sensor_msgs/msg/JointState`."""
    layout = _joint_layout(payload)
    return JointStates(_stamp(payload), layout.frame, layout.names, *layout.doubles(payload))


def joint_bits(payload: bytes) -> tuple[int, tuple[str, ...], bytes]:
    """Stamp in ns, names, and the bits of all arrays of a `sensor_msgs/msg/JointState`."""
    layout = _joint_layout(payload)
    return _stamp(payload), layout.names, layout.bits(payload)


def numbers(payload: bytes) -> Numbers:
    """Decode a `std_msgs/msg/Float64MultiArray`."""
    layout = _number_layout(payload)
    return Numbers(layout.names, *layout.doubles(payload))


def number_bits(payload: bytes) -> tuple[tuple[str, ...], bytes]:
    """Labels, and the bits of the numbers of a `std_msgs/msg/Float64MultiArray`."""
    layout = _number_layout(payload)
    return layout.names, layout.bits(payload)


def _stamp(payload: bytes) -> int:
    seconds, nanoseconds = _STAMP[payload[1]].unpack_from(payload, 4)
    return int(seconds * 1_000_000_000 + nanoseconds)


def rewritten(topic: RecordedTopic, payload: bytes, arrays: Sequence[Array], stamp_ns: int) -> bytes:
    """A message of joint states or numbers with other values in its arrays, and another stamp where it has one."""
    states = topic.type == JOINT_STATE
    layout = _joint_layout(payload) if states else _number_layout(payload)
    changed = bytearray(payload)
    if states:
        _STAMP[payload[1]].pack_into(changed, 4, *divmod(stamp_ns, 1_000_000_000))
    kind = _LITTLE if payload[1] else _BIG
    for start, count, array in zip(layout.starts, layout.counts, arrays, strict=True):
        changed[start : start + 8 * count] = np.asarray(array, dtype=kind).tobytes()
    return bytes(changed)


def text(payload: bytes) -> str:
    """Decode a `std_msgs/msg/String`."""
    return _Reader(payload).text()


JOINT_STATE = "sensor_msgs/msg/JointState"
_OWN: dict[str, Callable[[bytes], Any]] = {
    JOINT_STATE: joint_states,
    "std_msgs/msg/Float64MultiArray": numbers,
    "std_msgs/msg/String": text,
}


def decode(topic: RecordedTopic, payload: bytes) -> Any:
    """Decode a message of a topic.

    :raises ReadingError: it is not what the topic's type says.
    """
    if topic.encoding != "cdr":
        raise ReadingError(f"is encoded as '{topic.encoding}', not as CDR")
    try:
        own = _OWN.get(topic.type)
        return _generic(topic.type, topic.definition)(payload) if own is None else own(payload)
    except (struct.error, ValueError, IndexError, KeyError, AssertionError) as error:
        raise ReadingError(f"is no {topic.type} ({error})") from error


@cache
def _generic(kind: str, definition: str) -> Callable[[bytes], Any]:
    """What decodes a type: from its definition in the recording, or from that of ROS 2 Jazzy."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.EMPTY if definition else Stores.ROS2_JAZZY)
    if definition:
        store.register(get_types_from_msg(definition, kind))
    return lambda payload: store.deserialize_cdr(payload, kind)
