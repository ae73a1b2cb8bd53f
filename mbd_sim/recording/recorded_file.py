"""Plain records of the contents of a recorded file, the same for all formats."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from mbd_sim.errors import MbdSimError

RUN_METADATA = "mbd_sim"  # name of the metadata record of a run recorded by sim_node


class ReadingError(MbdSimError):
    """A recording that cannot be read at all."""


class DamagedError(ReadingError):
    """Damaged data in a recording; `problem` is the message without the name of the file."""

    def __init__(self, path: Path, problem: str) -> None:
        super().__init__(f"{path}: {problem}")
        self.path, self.problem = path, problem


class Message(NamedTuple):
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
