"""A recording as plain records: one file or several, MCAP or SQLite, whole or cut off by a kill. Needs no ROS.

>>> from mbd_sim.recording.reader import open_recording                                                # doctest: +SKIP
>>> recording = open_recording("recordings/double_rod.mcap")                                           # doctest: +SKIP
>>> [message.time_ns for message in recording.messages({"/joint_states"})]                             # doctest: +SKIP
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import yaml

from mbd_sim.recording import cdr
from mbd_sim.recording.contents import (
    Block,
    DamagedError,
    Message,
    Part,
    ReadingError,
    RecordedTopic,
)
from mbd_sim.recording.mcap_reader import read_mcap
from mbd_sim.recording.sqlite_reader import read_sqlite

ABOUT = "mbd_sim"  # the metadata record of a run of ours
_READERS = {".mcap": read_mcap, ".db3": read_sqlite}


@dataclass(frozen=True)
class Recording:
    """A recording: what it says about the run, its topics, and its messages. `parts` are its files in order."""

    path: Path
    parts: Sequence[Part]

    @property
    def about(self) -> Mapping[str, str]:
        """What `sim_node` says about the run, see `mbd_sim.recording.run_metadata`; empty in other recordings."""
        return next((part.metadata[ABOUT] for part in self.parts if ABOUT in part.metadata), {})

    @property
    def mechanism_text(self) -> str | None:
        """The mechanism's file, where the recording has one."""
        return next((part.mechanism_text for part in self.parts if part.mechanism_text is not None), None)

    @cached_property
    def topics(self) -> Mapping[str, RecordedTopic]:
        """All topics by name."""
        found: dict[str, RecordedTopic] = {}
        for part in self.parts:
            for name, topic in part.topics.items():
                before = found[name].count if name in found else 0
                found[name] = replace(topic, count=topic.count + before)
        return found

    @property
    def problems(self) -> list[str]:
        """Why files are not whole, with their names; empty where all are."""
        return [f"{part.path}: {part.problem}" for part in self.parts if part.problem]

    @property
    def blocks(self) -> list[Block]:
        """What can be read at once, in file order."""
        return [block for part in self.parts for block in part.blocks]

    @property
    def start_ns(self) -> int:
        """The time of the first message in ns; 0 where there is none."""
        return min((block.start_ns for block in self.blocks), default=0)

    @property
    def end_ns(self) -> int:
        """The time of the last message in ns; 0 where there is none."""
        return max((block.end_ns for block in self.blocks), default=0)

    def messages(self, topics: Collection[str] | None = None) -> Iterator[Message]:
        """The messages of some topics, or of all, in file order.

        :raises DamagedError: a block is not what was written; those before it have come.
        """
        for block in self.blocks:
            if topics is None:
                yield from block.load()
            elif block.topics is None or not block.topics.isdisjoint(topics):
                yield from (message for message in block.load() if message.topic in topics)

    def in_time_order(
        self, start_ns: int | None = None, skip: Callable[[DamagedError], None] | None = None
    ) -> Iterator[Message]:
        """All messages from a time on, by log time; `skip` hears of blocks that are damaged, and left out.

        :raises DamagedError: a block is not what was written, without `skip`.
        """
        waiting: list[Message] = []
        for block in sorted(self.blocks, key=lambda block: block.start_ns):
            if start_ns is not None and block.end_ns < start_ns:
                continue
            ready = next((n for n, message in enumerate(waiting) if message.time_ns > block.start_ns), len(waiting))
            yield from waiting[:ready]
            del waiting[:ready]
            try:
                loaded = block.load()
            except DamagedError as error:
                if skip is None:
                    raise
                skip(error)
                continue
            if start_ns is not None:
                loaded = [message for message in loaded if message.time_ns >= start_ns]
            waiting = sorted(waiting + loaded, key=_time)
        yield from waiting

    def latest(self, topics: Collection[str], time_ns: int) -> list[Message]:
        """The last message of each of some topics before a time, in time order, as far as one is whole."""
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
        """A message's content: `cdr.JointStates`, `cdr.Numbers`, or text; other types as `rosbags` decodes them.

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
    """Open an `.mcap` or `.db3` file, or a folder of rosbag2.

    :raises ReadingError: there is none, or it cannot be read; with the file and what is wrong.
    """
    path = Path(path)
    if path.is_dir():
        return Recording(path, [_part(file) for file in _files(path)])
    if not path.exists():
        raise ReadingError(f"{path}: there is no such file.")
    return Recording(path, [_part(path)])


def _part(path: Path) -> Part:
    if not path.is_file():
        raise ReadingError(f"{path}: there is no such file.")
    if path.suffix == ".zstd":
        raise ReadingError(f"{path}: is compressed as a whole. Unpack it first: zstd -d '{path}'.")
    return _READERS.get(path.suffix, read_mcap)(path)


def _files(folder: Path) -> list[Path]:
    """The files of a folder in order: as its `metadata.yaml` says, or all there are where that is missing."""
    described = folder / "metadata.yaml"
    if described.is_file():
        try:
            about = yaml.safe_load(described.read_text(encoding="utf-8"))["rosbag2_bagfile_information"]
            files = [folder / name for name in about["relative_file_paths"]]
        except (yaml.YAMLError, KeyError, TypeError, OSError, UnicodeDecodeError) as error:
            raise ReadingError(f"{described}: is no description of a rosbag2 recording ({error!r}).") from error
    else:
        files = sorted((file for file in folder.iterdir() if file.suffix in _READERS), key=_natural)
    if not files:
        raise ReadingError(f"{folder}: holds no recording: neither metadata.yaml nor .mcap or .db3 files.")
    return files


def _natural(path: Path) -> list[tuple[int, int, str]]:
    """A key that puts `run_2` before `run_10`."""
    return [(1, int(word), "") if word.isdigit() else (0, 0, word) for word in re.split(r"(\d+)", path.name)]


def _time(message: Message) -> int:
    return message.time_ns
