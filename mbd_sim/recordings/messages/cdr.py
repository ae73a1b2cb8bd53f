"""Messages as CDR: written without ROS, and decoded into plain records that are the same for all formats.

CDR (OMG DDS-XTypes 1.3, section 7.4, version 1) has four bytes that give the byte order, then the fields, each aligned
to its size.

Messages of constant size are serialized once; afterwards only their numbers are written, into the bytes. Filling and
serializing a message by rclpy takes some 10 µs with the interpreter's lock held; this takes one or two.

The types that runs consist of are decoded as fast as `verify` needs it, all others by `rosbags`.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.errors import MbdSimError
from mbd_sim.base.geometry.pose import Array

_ENCAPSULATION = b"\x00\x01\x00\x00"
_HEADER = len(_ENCAPSULATION)  # alignment counts from its end


@dataclass(frozen=True, slots=True)
class FieldPlace:
    """The place of consecutive numbers in a message: the offset of the first byte, and how many there are."""

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

    def view(self, place: FieldPlace) -> Array:
        """A writable view (size,) of doubles, which become zero."""
        if not place.size:
            return np.empty(0)
        view = np.frombuffer(self._data, dtype=np.float64, count=place.size, offset=place.offset)
        view[:] = 0.0
        return view

    def single_view(self, place: FieldPlace) -> NDArray[np.float32]:
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
        self._data = bytearray(_ENCAPSULATION)
        self._stamps: list[int] = []

    def byte(self, value: int) -> None:
        """Append a `uint8`."""
        self._data += struct.pack("<B", value)

    def singles(self, count: int) -> FieldPlace:
        """Append `float32` fields, whose values can be written later."""
        self._align(4)
        offset = len(self._data)
        self._data += bytes(4 * count)
        return FieldPlace(offset, count)

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

    def doubles(self, count: int) -> FieldPlace:
        """Append `float64` fields, whose values can be written later."""
        if count:
            self._align(8)
        offset = len(self._data)
        self._data += bytes(8 * count)
        return FieldPlace(offset, count)

    def sequence(self, count: int) -> FieldPlace:
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


RUN_METADATA = "mbd_sim"  # name of the metadata record of a run recorded by sim_node


class ReadingError(MbdSimError):
    """A recording that cannot be read at all."""


class DamagedError(ReadingError):
    """Damaged data in a recording; `problem` is the message without the name of the file."""

    def __init__(self, path: Path, problem: str) -> None:
        super().__init__(f"{path}: {problem}")
        self.path, self.problem = path, problem


@dataclass(frozen=True, slots=True)
class Message:
    """One recorded message: `payload` is its CDR serialization, `time_ns` its log time.

    In recordings of `sim_node` the log time is the simulated clock, and `sequence` the tick: steps since the node
    started, modulo 2³². In other recordings `sequence` is the number that their writer chose, or 0.
    """

    topic: str
    payload: bytes
    time_ns: int
    sequence: int


@dataclass(frozen=True)
class RecordedTopic:
    """A topic: its type such as `std_msgs/msg/String`, the offered QoS in rosbag2's YAML, and the type's definition.

    `definition` is the text of a `ros2msg` schema, and `hash` the REP 2011 hash of the type; both are "" where the file
    does not contain them. `count` is the number of messages.
    """

    name: str
    type: str
    qos: str
    definition: str
    encoding: str
    count: int
    hash: str = ""


def topics_by_name(topics: Iterable[RecordedTopic]) -> dict[str, RecordedTopic]:
    """Topics by name; one that stands several times, as in several files, counts the messages of all."""
    found: dict[str, RecordedTopic] = {}
    for topic in topics:
        earlier = found[topic.name].count if topic.name in found else 0
        found[topic.name] = replace(topic, count=topic.count + earlier)
    return found


@dataclass(frozen=True)
class Block:
    """Consecutive messages of a file, read when `load` is called; `topics` is None where they are not known before.

    `load` raises `DamagedError` if the messages are damaged.
    """

    start_ns: int
    end_ns: int
    topics: frozenset[str] | None
    load: Callable[[], list[Message]]


@dataclass(frozen=True)
class RecordedFile:
    """One file of a recording. `metadata` are its records by name; `problem` says why it is incomplete, or is ""."""

    path: Path
    topics: Mapping[str, RecordedTopic]
    metadata: Mapping[str, Mapping[str, str]]
    mechanism_text: str | None
    blocks: Sequence[Block]
    problem: str = ""

    @property
    def is_run(self) -> bool:
        """Whether the file describes the start of a run, so that the run can be recomputed."""
        return RUN_METADATA in self.metadata


JOINT_STATE = "sensor_msgs/msg/JointState"
MULTI_ARRAY = "std_msgs/msg/Float64MultiArray"
STRING = "std_msgs/msg/String"
_LITTLE, _BIG = np.dtype("<f8"), np.dtype(">f8")
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
    return _LITTLE if payload[1] else _BIG
