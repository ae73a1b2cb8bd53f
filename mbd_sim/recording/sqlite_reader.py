"""One SQLite file of a rosbag2 recording."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

from mbd_sim.recording.contents import (
    Block,
    DamagedError,
    Message,
    Part,
    ReadingError,
    RecordedTopic,
)

ROWS = 2000  # messages of a block


def read_sqlite(path: Path) -> Part:
    """Open a `.db3` file; messages are read when they are asked for.

    :raises ReadingError: the file cannot be read, or is none of rosbag2's.
    """
    try:
        with closing(_connect(path)) as database:
            topics = dict(_topics(database))
            rows = database.execute("SELECT id, timestamp FROM messages ORDER BY timestamp, id").fetchall()
    except sqlite3.Error as error:
        raise ReadingError(f"{path}: is no bag of rosbag2: {error}.") from error
    names = {number: topic.name for number, topic in topics.items()}
    blocks = [
        _block(path, names, rows[first][1], rows[min(first + ROWS, len(rows)) - 1][1], first)
        for first in range(0, len(rows), ROWS)
    ]
    return Part(path, {topic.name: topic for topic in topics.values()}, {}, None, blocks)


def _connect(path: Path) -> sqlite3.Connection:
    return sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True)


def _topics(database: sqlite3.Connection) -> Iterator[tuple[int, RecordedTopic]]:
    tables = {name for (name,) in database.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
    definitions: dict[str, str] = {}
    if "message_definitions" in tables:
        found = database.execute("SELECT topic_type, encoding, encoded_message_definition FROM message_definitions")
        definitions = {kind: text for kind, encoding, text in found if encoding == "ros2msg"}
    counts = dict(database.execute("SELECT topic_id, COUNT(*) FROM messages GROUP BY topic_id").fetchall())
    columns = {row[1] for row in database.execute("PRAGMA table_info(topics)")}
    qos = "offered_qos_profiles" if "offered_qos_profiles" in columns else "''"
    listed = database.execute(f"SELECT id, name, type, serialization_format, {qos} FROM topics")  # noqa: S608
    for number, name, kind, encoding, profiles in listed:
        yield (
            number,
            RecordedTopic(name, kind, str(profiles), definitions.get(kind, ""), encoding, counts.get(number, 0)),
        )


def _block(path: Path, names: dict[int, str], start_ns: int, end_ns: int, first: int) -> Block:
    def load() -> list[Message]:
        query = "SELECT topic_id, data, timestamp FROM messages ORDER BY timestamp, id LIMIT ? OFFSET ?"
        try:
            with closing(_connect(path)) as database:
                rows = database.execute(query, (ROWS, first)).fetchall()
        except sqlite3.Error as error:
            raise DamagedError(path, f"damaged: {error}") from error
        return [Message(names[topic], bytes(data), time_ns, 0) for topic, data, time_ns in rows]

    return Block(start_ns, end_ns, None, load)
