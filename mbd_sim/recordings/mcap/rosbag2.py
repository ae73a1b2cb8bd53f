"""A rosbag2 folder: its `metadata.yaml`, and its SQLite files.

`metadata.yaml` is written as in Jazzy and Kilted (version 9, `rosbag2_storage/yaml.hpp`). Of the SQLite files one is
read at a time.
"""

from __future__ import annotations

import contextlib
import json
import os
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from functools import cache
from pathlib import Path
from typing import Any

import yaml

from mbd_sim.recordings.mcap.contents import FileStatistics
from mbd_sim.recordings.messages.cdr import Block, DamagedError, Message, ReadingError, RecordedFile, RecordedTopic
from mbd_sim.recordings.messages.definitions import Topic

VERSION = 9
DISTRIBUTION = "jazzy"  # where none is sourced
FILE_NAME = "metadata.yaml"
_ROOT = "rosbag2_bagfile_information"


def bag_text(topics: Sequence[Topic], files: Sequence[FileStatistics], custom: Mapping[str, str]) -> str:
    """Return the document; `custom` is the recorder's own data.

    The lists are composed as text: `yaml` would take a second for the thousands of files of a recording that is often
    split, while its messages wait.
    """
    not_empty = [file for file in files if file.messages]
    first = min((file.first_ns for file in not_empty), default=0)
    last = max((file.last_ns for file in not_empty), default=0)
    lines = [
        f"{_ROOT}:",
        f"  version: {VERSION}",
        "  storage_identifier: mcap",
        "  duration:",
        f"    nanoseconds: {last - first}",
        "  starting_time:",
        f"    nanoseconds_since_epoch: {first}",
        f"  message_count: {sum(file.messages for file in files)}",
        "  topics_with_message_count:" + ("" if topics else " []"),
    ]
    for number, topic in enumerate(topics, 1):
        lines.append(_topic_text(topic))
        lines.append(f"    message_count: {sum(file.counts[number] for file in files)}")
    lines += ["  compression_format: ''", "  compression_mode: ''"]
    lines.append("  relative_file_paths:" + ("" if files else " []"))
    lines += [f"  - {_quoted(file.path.name)}" for file in files]
    lines.append("  files:" + ("" if files else " []"))
    for file in files:
        lines += [
            f"  - path: {_quoted(file.path.name)}",
            "    starting_time:",
            f"      nanoseconds_since_epoch: {file.first_ns}",
            "    duration:",
            f"      nanoseconds: {file.last_ns - file.first_ns}",
            f"    message_count: {file.messages}",
        ]
    lines.append(f"  custom_data: {json.dumps(dict(custom), ensure_ascii=False) if custom else 'null'}")
    lines.append(f"  ros_distro: {os.environ.get('ROS_DISTRO') or DISTRIBUTION}")
    return "\n".join(lines) + "\n"


@cache
def _topic_text(topic: Topic) -> str:
    """Return the entry of a topic up to its number of messages."""
    metadata = {
        "name": topic.name,
        "type": topic.type,
        "serialization_format": "cdr",
        "offered_qos_profiles": yaml.safe_load(topic.qos),
        "type_description_hash": topic.hash,
    }
    text = yaml.safe_dump({"topic_metadata": metadata}, sort_keys=False, allow_unicode=True, width=1000)
    return "  - " + text.rstrip().replace("\n", "\n    ")


def _quoted(text: str) -> str:
    """Return a text as a scalar of YAML, of which JSON's strings are a subset."""
    return json.dumps(text, ensure_ascii=False)


def read_bag_metadata(path: Path) -> dict[str, Any]:
    """Read the content of a `metadata.yaml`.

    :raises OSError: it cannot be read.
    :raises ValueError: it is not such a document.
    """
    try:
        return dict(yaml.safe_load(path.read_text(encoding="utf-8"))[_ROOT])
    except (yaml.YAMLError, KeyError, TypeError) as error:
        raise ValueError(f"it is not a description of a rosbag2 recording ({error!r})") from error


def write_metadata(path: Path, text: str) -> None:
    """Replace the document atomically: a reader finds the old one or the new one, even after a kill.

    :raises OSError: it cannot be written.
    """
    draft = path.with_name(f".{path.name}.new")
    try:
        draft.write_text(text, encoding="utf-8")
        draft.replace(path)
    except OSError:
        with contextlib.suppress(OSError):
            draft.unlink()
        raise


BLOCK_SIZE = 2000  # messages


def read_sqlite(path: Path) -> RecordedFile:
    """Open a `.db3` file; the messages are read on demand.

    :raises ReadingError: the file cannot be read, or is not a rosbag2 database.
    """
    try:
        with closing(_connect(path)) as database:
            topics = dict(_topics(database))
            rows = database.execute("SELECT id, timestamp FROM messages ORDER BY timestamp, id").fetchall()
    except sqlite3.Error as error:
        raise ReadingError(f"{path}: is not a rosbag2 database: {error}.") from error
    names = {number: topic.name for number, topic in topics.items()}
    blocks = [
        _block(path, names, rows[first][1], rows[min(first + BLOCK_SIZE, len(rows)) - 1][1], first)
        for first in range(0, len(rows), BLOCK_SIZE)
    ]
    return RecordedFile(path, {topic.name: topic for topic in topics.values()}, {}, None, blocks)


def _connect(path: Path) -> sqlite3.Connection:
    return sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True)


def _topics(database: sqlite3.Connection) -> Iterator[tuple[int, RecordedTopic]]:
    tables = {name for (name,) in database.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
    definitions: dict[str, str] = {}
    if "message_definitions" in tables:
        found = database.execute("SELECT topic_type, encoding, encoded_message_definition FROM message_definitions")
        definitions = {type_name: text for type_name, encoding, text in found if encoding == "ros2msg"}
    counts = dict(database.execute("SELECT topic_id, COUNT(*) FROM messages GROUP BY topic_id").fetchall())
    columns = {row[1] for row in database.execute("PRAGMA table_info(topics)")}
    qos = "offered_qos_profiles" if "offered_qos_profiles" in columns else "''"
    rows = database.execute(f"SELECT id, name, type, serialization_format, {qos} FROM topics")  # noqa: S608
    for number, name, type_name, encoding, profiles in rows:
        definition = definitions.get(type_name, "")
        yield number, RecordedTopic(name, type_name, str(profiles), definition, encoding, counts.get(number, 0))


def _block(path: Path, names: dict[int, str], start_ns: int, end_ns: int, first: int) -> Block:
    def load() -> list[Message]:
        query = "SELECT topic_id, data, timestamp FROM messages ORDER BY timestamp, id LIMIT ? OFFSET ?"
        try:
            with closing(_connect(path)) as database:
                rows = database.execute(query, (BLOCK_SIZE, first)).fetchall()
        except sqlite3.Error as error:
            raise DamagedError(path, f"damaged: {error}") from error
        return [Message(names[topic], bytes(data), time_ns, 0) for topic, data, time_ns in rows]

    return Block(start_ns, end_ns, None, load)
