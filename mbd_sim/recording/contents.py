"""The records that reading a recording gives, whatever its files are."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from mbd_sim.errors import MbdSimError


class ReadingError(MbdSimError):
    """A recording that cannot be read at all."""


class DamagedError(ReadingError):
    """A part of a recording that is not what was written; `what` says it without the file's name."""

    def __init__(self, path: Path, what: str) -> None:
        super().__init__(f"{path}: {what}")
        self.path, self.what = path, what


class Message(NamedTuple):
    """One message as it was recorded: `payload` is its CDR, `time_ns` its log time.

    In recordings of `sim_node` the time is that of the node's simulated clock, and the sequence the tick: steps since
    the node started, modulo 2³². Elsewhere the sequence is what the writer took it for, or 0.
    """

    topic: str
    payload: bytes
    time_ns: int
    sequence: int


@dataclass(frozen=True)
class RecordedTopic:
    """A topic: its type such as `std_msgs/msg/String`, the offered QoS in rosbag2's YAML, and the type's definition.

    `definition` is the text of a `ros2msg` schema, "" where the file has none; `count` is how many messages there are.
    """

    name: str
    type: str
    qos: str
    definition: str
    encoding: str
    count: int


@dataclass(frozen=True)
class Block:
    """Messages that stand together in a file, read when `load` is called; `topics` None where that is not known.

    `load` raises `DamagedError` where they are not what was written.
    """

    start_ns: int
    end_ns: int
    topics: frozenset[str] | None
    load: Callable[[], list[Message]]


@dataclass(frozen=True)
class Part:
    """One file of a recording. `metadata` are its records by name; `problem` says why it is not whole, or is ""."""

    path: Path
    topics: Mapping[str, RecordedTopic]
    metadata: Mapping[str, Mapping[str, str]]
    mechanism_text: str | None
    blocks: Sequence[Block]
    problem: str = ""
