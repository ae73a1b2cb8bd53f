"""Recovery of a rosbag2 folder: each of its MCAP files, then its `metadata.yaml`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from mbd_sim.messages.recorded_topic import Topic
from mbd_sim.recording.mcap_reader import read_mcap
from mbd_sim.recording.recorded_file import RecordedFile
from mbd_sim.recording.recording_paths import natural_order
from mbd_sim.recording.recovery import recover
from mbd_sim.recording.rosbag2_metadata import (
    FILE_NAME,
    FileStatistics,
    bag_text,
    read_bag_metadata,
    write_metadata,
)


def recover_bag(folder: Path) -> Iterator[tuple[Path, dict[str, int] | None]]:
    """Recover the files of a folder one by one, yielding the result of `recover` for each; then update its metadata.

    :raises ValueError: a file is not an MCAP file.
    :raises OSError: a file cannot be read or written.
    """
    for file in _bag_files(folder):
        try:
            counts = recover(file)
        except ValueError as error:
            raise ValueError(f"{file.name}: {error}") from error
        yield file, counts
    update_metadata(folder)


def update_metadata(folder: Path) -> None:
    """Write `metadata.yaml` of a folder according to the contents of its files, which must be complete.

    Topics that the existing `metadata.yaml` does not contain are taken from the files: all of them where a recorder was
    killed before it wrote one.

    :raises ValueError: the existing `metadata.yaml` is not one of rosbag2, or there is no file.
    :raises OSError: a file cannot be read or written.
    """
    path = folder / FILE_NAME
    files = [read_mcap(file) for file in _bag_files(folder)]
    if path.exists() and any(folder.glob("*.mcap")):
        document = read_bag_metadata(path)
    elif files:
        document = {"custom_data": {"recorded_by": "mbd_sim"} if any(file.is_run for file in files) else {}}
    else:
        raise ValueError("contains no .mcap file with any data. Nothing can be recovered.")
    topics = _topics(document, files)
    write_metadata(
        path, bag_text(topics, [_statistics(file, topics) for file in files], document.get("custom_data") or {})
    )


def _topics(document: Mapping[str, Any], files: Sequence[RecordedFile]) -> list[Topic]:
    """Return the topics of a `metadata.yaml`, then the others of the files."""
    known = [entry["topic_metadata"] for entry in document.get("topics_with_message_count", [])]
    topics = {
        entry["name"]: Topic(
            entry["name"], entry["type"], yaml.safe_dump(entry["offered_qos_profiles"], sort_keys=False)
        )
        for entry in known
    }
    for file in files:
        for name, topic in file.topics.items():
            topics.setdefault(name, Topic(name, topic.type, topic.qos or "[]"))
    return list(topics.values())


def _statistics(file: RecordedFile, topics: Sequence[Topic]) -> FileStatistics:
    """Return message counts and times of a file, by the numbers of the topics."""
    statistics = FileStatistics(file.path)
    counts = [file.topics[topic.name].count if topic.name in file.topics else 0 for topic in topics]
    if any(counts):
        first_ns = min(block.start_ns for block in file.blocks)
        last_ns = max(block.end_ns for block in file.blocks)
        statistics.add(counts, first_ns, last_ns)
    return statistics


def _bag_files(folder: Path) -> list[Path]:
    """Return the files of the folder in order, without those that a killed recorder left empty.

    They keep their names if the folder is renamed.
    """
    return natural_order(path for path in folder.glob("*.mcap") if path.stat().st_size)
