"""Recovery of a rosbag2 folder: each of its MCAP files, then its `metadata.yaml`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import yaml
from mcap.reader import make_reader

from mbd_sim.recording.recorded_topic import Topic
from mbd_sim.recording.recovery import recover
from mbd_sim.recording.rosbag2_metadata import Contents, bag_metadata, write_metadata


def recover_bag(folder: Path) -> Iterator[tuple[Path, dict[str, int] | None]]:
    """Recover the files of a folder one by one, yielding what `recover` returns for each; then update its metadata.

    :raises ValueError: a file is not an MCAP file.
    :raises OSError: a file cannot be read or written.
    """
    for file in _bag_files(folder):
        yield file, recover(file)
    update_metadata(folder)


def update_metadata(folder: Path) -> None:
    """Write `metadata.yaml` of a folder according to the contents of its files, which must be complete."""
    path = folder / "metadata.yaml"
    document = yaml.safe_load(path.read_text(encoding="utf-8"))["rosbag2_bagfile_information"]
    known = [entry["topic_metadata"] for entry in document["topics_with_message_count"]]
    topics = [Topic(entry["name"], entry["type"], yaml.safe_dump(entry["offered_qos_profiles"])) for entry in known]
    numbers = {topic.name: number for number, topic in enumerate(topics)}
    files = [_contents(file, numbers) for file in _bag_files(folder)]
    write_metadata(path, bag_metadata(topics, files, document.get("custom_data") or {}))


def _contents(file: Path, numbers: dict[str, int]) -> Contents:
    """Message counts and times of a file, from its summary; `numbers` are those of the topics."""
    with file.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    if summary is None or summary.statistics is None:
        raise ValueError(f"{file.name} has no summary")
    statistics = summary.statistics
    counts = [0] * len(numbers)
    for channel, count in statistics.channel_message_counts.items():
        counts[numbers[summary.channels[channel].topic]] += count
    contents = Contents(file)
    if any(counts):
        contents.take(counts, statistics.message_start_time, statistics.message_end_time)
    return contents


def _bag_files(folder: Path) -> list[Path]:
    """The files of the folder in the order of their numbers, without those that a killed recorder left empty."""
    files = [path for path in folder.glob(f"{folder.resolve().name}_*.mcap") if path.stat().st_size]
    return sorted(files, key=lambda path: int(path.stem.rpartition("_")[2]))
