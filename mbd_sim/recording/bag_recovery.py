"""Recovery of a rosbag2 folder: each of its MCAP files, then its `metadata.yaml`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import yaml

from mbd_sim.messages.recorded_topic import Topic
from mbd_sim.recording.mcap_reader import read_mcap
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

    :raises ValueError: the existing `metadata.yaml` is not one of rosbag2.
    :raises OSError: a file cannot be read or written.
    """
    path = folder / FILE_NAME
    document = read_bag_metadata(path)
    known = [entry["topic_metadata"] for entry in document["topics_with_message_count"]]
    topics = [Topic(entry["name"], entry["type"], yaml.safe_dump(entry["offered_qos_profiles"])) for entry in known]
    files = [_statistics(file, topics) for file in _bag_files(folder)]
    write_metadata(path, bag_text(topics, files, document.get("custom_data") or {}))


def _statistics(path: Path, topics: list[Topic]) -> FileStatistics:
    """Return message counts and times of a file, by the numbers of the topics."""
    file = read_mcap(path)
    statistics = FileStatistics(path)
    counts = [file.topics[topic.name].count if topic.name in file.topics else 0 for topic in topics]
    if any(counts):
        first_ns = min(block.start_ns for block in file.blocks)
        last_ns = max(block.end_ns for block in file.blocks)
        statistics.add(counts, first_ns, last_ns)
    return statistics


def _bag_files(folder: Path) -> list[Path]:
    """Return the files of the folder in the order of their numbers, without those that a killed recorder left empty."""
    files = [path for path in folder.glob(f"{folder.resolve().name}_*.mcap") if path.stat().st_size]
    return sorted(files, key=lambda path: int(path.stem.rpartition("_")[2]))
