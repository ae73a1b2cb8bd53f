"""Reads a recording: one file or several, MCAP or SQLite, complete or truncated. Needs no ROS.

>>> from mbd_sim.recordings.run.reader import open_recording            # doctest: +SKIP
>>> recording = open_recording("recordings/double_rod.mcap")                                           # doctest: +SKIP
>>> [message.time_ns for message in recording.messages({"/joint_states"})]                             # doctest: +SKIP

The topics that are recomputed from a recorded run are chosen here, and those that carry its commands.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from pathlib import Path
from typing import Any

from mbd_sim.base.errors import MechanismError
from mbd_sim.files.load import parse_mechanism
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.recordings.mcap import rosbag2
from mbd_sim.recordings.mcap.reader import read_mcap
from mbd_sim.recordings.mcap.rosbag2 import read_sqlite
from mbd_sim.recordings.messages import cdr
from mbd_sim.recordings.messages.cdr import (
    JOINT_STATE,
    MULTI_ARRAY,
    RUN_METADATA,
    STRING,
    Block,
    DamagedError,
    Message,
    ReadingError,
    RecordedFile,
    RecordedTopic,
    topics_by_name,
)
from mbd_sim.recordings.run.paths import natural_order

_READERS = {".mcap": read_mcap, ".db3": read_sqlite}


@dataclass(frozen=True)
class Recording:
    """A recording: the description of its run, its topics, and its messages. `files` are in order."""

    path: Path
    files: Sequence[RecordedFile]

    @property
    def about(self) -> Mapping[str, str]:
        """The description of the run, see `mbd_sim.recordings.run.metadata`; empty if `sim_node` did not record it."""
        return next((file.metadata[RUN_METADATA] for file in self.files if file.is_run), {})

    @property
    def mechanism_text(self) -> str | None:
        """The mechanism's file, if the recording contains one."""
        return next((file.mechanism_text for file in self.files if file.mechanism_text is not None), None)

    @cached_property
    def mechanism(self) -> Mechanism | None:
        """The mechanism of a run; None if its file is not in the recording, or this program cannot read it."""
        if self.mechanism_text is None:
            return None
        try:
            return parse_mechanism(self.mechanism_text, str(self.path))
        except MechanismError:
            return None

    @cached_property
    def topics(self) -> Mapping[str, RecordedTopic]:
        """All topics by name, with the number of messages in all files."""
        return topics_by_name(topic for file in self.files for topic in file.topics.values())

    @property
    def problems(self) -> list[str]:
        """Why files are incomplete, each with the name of the file; empty if all are complete."""
        return [f"{file.path}: {file.problem}" for file in self.files if file.problem]

    @property
    def blocks(self) -> list[Block]:
        """The blocks of all files, in file order."""
        return [block for file in self.files for block in file.blocks]

    @property
    def start_ns(self) -> int:
        """The time of the first message in ns, or 0."""
        return min((block.start_ns for block in self.blocks), default=0)

    @property
    def end_ns(self) -> int:
        """The time of the last message in ns, or 0."""
        return max((block.end_ns for block in self.blocks), default=0)

    def messages(self, topics: Collection[str] | None = None) -> Iterator[Message]:
        """Yield the messages of some topics, or of all, in file order.

        :raises DamagedError: a block is damaged; all earlier messages have been yielded.
        """
        for block in self.blocks:
            if topics is None:
                yield from block.load()
            elif block.topics is None or not block.topics.isdisjoint(topics):
                yield from (message for message in block.load() if message.topic in topics)

    def in_time_order(
        self, start_ns: int | None = None, on_damage: Callable[[DamagedError], None] | None = None
    ) -> Iterator[Message]:
        """Yield all messages from a time on, by log time.

        :param on_damage: called for each damaged block, which is left out.
        :raises DamagedError: a block is damaged, if `on_damage` is None.
        """
        pending: list[Message] = []
        for block in sorted(self.blocks, key=lambda block: block.start_ns):
            if start_ns is not None and block.end_ns < start_ns:
                continue
            ready = next((n for n, message in enumerate(pending) if message.time_ns > block.start_ns), len(pending))
            yield from pending[:ready]
            del pending[:ready]
            try:
                loaded = block.load()
            except DamagedError as error:
                if on_damage is None:
                    raise
                on_damage(error)
                continue
            if start_ns is not None:
                loaded = [message for message in loaded if message.time_ns >= start_ns]
            pending = sorted(pending + loaded, key=_time)
        yield from pending

    def latest(self, topics: Collection[str], time_ns: int) -> list[Message]:
        """Return the last message of each topic before a time, in time order; damaged blocks are left out."""
        found: dict[str, Message] = {}
        missing = set(topics)
        for block in sorted(self.blocks, key=lambda block: block.end_ns, reverse=True):
            if not missing:
                break
            if block.start_ns >= time_ns or (block.topics is not None and block.topics.isdisjoint(missing)):
                continue
            try:
                loaded = block.load()
            except DamagedError:
                continue
            for message in loaded:
                if message.topic in missing and message.time_ns < time_ns:
                    found[message.topic] = message
            missing -= found.keys()
        return sorted(found.values(), key=_time)

    def decoded(self, message: Message) -> Any:
        """Decode a message: `cdr.JointStates`, `cdr.MultiArray`, or text; `rosbags` decodes other types.

        :raises ReadingError: it cannot be decoded.
        """
        topic = self.topics[message.topic]
        try:
            return cdr.decode(topic, message.payload)
        except ReadingError as error:
            raise ReadingError(
                f"{self.path}: {message.topic} at t = {message.time_ns * 1e-9:.9g} s: {error}"
            ) from error


def open_recording(path: str | Path) -> Recording:
    """Open an `.mcap` or `.db3` file, or a rosbag2 folder.

    :raises ReadingError: it does not exist or cannot be read; the message names the file and the reason.
    """
    path = Path(path)
    if path.is_dir():
        return Recording(path, [_read_file(file) for file in _files(path)])
    if not path.exists():
        raise ReadingError(f"{path}: there is no such file", "Check the path.")
    return Recording(path, [_read_file(path)])


def _read_file(path: Path) -> RecordedFile:
    if not path.is_file():
        raise ReadingError(f"{path}: there is no such file", "Check the path.")
    if path.suffix == ".zstd":
        raise ReadingError(f"{path}: the file is compressed as a whole", f"Decompress it first: zstd -d '{path}'.")
    return _READERS.get(path.suffix, read_mcap)(path)


def _files(folder: Path) -> list[Path]:
    """Return the files of a folder in order: as listed in `metadata.yaml` and those that follow.

    Without a list, or if its files have been renamed, these are all recordings in the folder.
    """
    listed, present = _listed_files(folder), natural_order(file for file in folder.iterdir() if file.suffix in _READERS)
    missing = [file for file in listed if not file.is_file()]
    if present and len(missing) == len(listed):
        return present
    if missing:
        raise ReadingError(
            f"{missing[0]}: there is no such file, though {rosbag2.FILE_NAME} lists it",
            f"Put it back, or list the files that are there with 'mbd_sim recover {folder}'.",
        )
    if not listed:
        raise ReadingError(f"{folder}: contains no recording: neither metadata.yaml nor .mcap or .db3 files.")
    return listed + _later_files(listed)


def _listed_files(folder: Path) -> list[Path]:
    description = folder / rosbag2.FILE_NAME
    if not description.is_file():
        return []
    try:
        return [folder / name for name in rosbag2.read_bag_metadata(description)["relative_file_paths"]]
    except (OSError, ValueError, LookupError, TypeError) as error:
        raise ReadingError(f"{description}: cannot be read: {error}.") from error


def _later_files(listed: Sequence[Path]) -> list[Path]:
    """Return the files that continue a list: a recorder that was killed may have begun them since it wrote the list."""
    found: list[Path] = []
    match = re.fullmatch(r"(.*_)(\d+)", listed[-1].stem)
    while match:
        number = int(match[2]) + 1 + len(found)
        path = listed[-1].with_stem(f"{match[1]}{number}")
        if not path.is_file():
            break
        found.append(path)
    return found


def _time(message: Message) -> int:
    return message.time_ns


class TopicRole(StrEnum):
    """The kinds of data that topics carry: the last word of the topic's name, or `sensors` before that of a sensor."""

    JOINT_STATES = "joint_states"
    ENERGIES = "energies"
    CONSTRAINT_VIOLATION = "constraint_violation"
    ACCELERATIONS = "accelerations"
    SENSORS = "sensors"  # the word before the last, which names the sensor
    APPLIED_EFFORTS = "applied_efforts"
    APPLIED_COMMANDS = "applied_commands"
    APPLIED_WRENCHES = "applied_wrenches"
    LIVE_VALUES = "live_values"
    EVENTS = "events"
    NEW_STATES = "new_states"


COMMANDS = frozenset(
    {
        TopicRole.APPLIED_EFFORTS,
        TopicRole.APPLIED_COMMANDS,
        TopicRole.APPLIED_WRENCHES,
        TopicRole.LIVE_VALUES,
        TopicRole.EVENTS,
        TopicRole.NEW_STATES,
    }
)
_TYPES = {TopicRole.JOINT_STATES: JOINT_STATE, TopicRole.EVENTS: STRING}  # all others are multi-arrays
_ROLES = {role.value: role for role in TopicRole}


def topic_roles(topics: Mapping[str, RecordedTopic]) -> dict[str, TopicRole]:
    """Return the roles of topics by the last word of their names and their types, in any namespace.

    If no topic has the name of joint states, the only one of their type is taken: it may have been remapped.
    """
    found = {name: TopicRole.SENSORS for name, topic in topics.items() if _is_sensor(name) and topic.encoding == "cdr"}
    found |= {
        name: role
        for name, topic in topics.items()
        if not _is_sensor(name)
        and (role := _ROLES.get(name.rsplit("/", 1)[-1])) is not None
        and topic.type == _TYPES.get(role, MULTI_ARRAY)
        and topic.encoding == "cdr"
    }
    candidates = [name for name, topic in topics.items() if topic.type == JOINT_STATE and not _is_sensor(name)]
    if TopicRole.JOINT_STATES not in found.values() and len(candidates) == 1:
        found[candidates[0]] = TopicRole.JOINT_STATES
    return found


def _is_sensor(name: str) -> bool:
    return name.split("/")[-2:-1] == [TopicRole.SENSORS.value]
