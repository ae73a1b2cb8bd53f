"""Reads one SQLite file of a rosbag2 recording."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

from mbd_sim.recording.recorded_file import Block, DamagedError, Message, ReadingError, RecordedFile, RecordedTopic

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
