"""`mbd_sim recover`: recordings that a kill or a full disk cut off, made whole in their place."""

from __future__ import annotations

import argparse
from pathlib import Path

import yaml
from mcap.reader import make_reader

from mbd_sim.recording.file_names import RecordingError
from mbd_sim.recording.recorded_topic import Topic
from mbd_sim.recording.recovery import recover
from mbd_sim.recording.rosbag2_metadata import Contents, bag_metadata, write_metadata


def run_recover(options: argparse.Namespace) -> int:
    """Recover all that was named and say what is in them.

    :raises RecordingError: one cannot be read or written, or is no recording.
    """
    for path in options.recordings:
        try:
            for file in _files(path) if path.is_dir() else [path]:
                print(_recovered(file))
            if path.is_dir():
                describe(path)
        except (OSError, ValueError, LookupError) as error:
            raise RecordingError(f"{path}: {error}") from error
    return 0


def describe(folder: Path) -> None:
    """Bring `metadata.yaml` of a folder of ours up to date with what its files hold; they must be whole."""
    place = folder / "metadata.yaml"
    about = yaml.safe_load(place.read_text(encoding="utf-8"))["rosbag2_bagfile_information"]
    known = [entry["topic_metadata"] for entry in about["topics_with_message_count"]]
    topics = [Topic(entry["name"], entry["type"], yaml.safe_dump(entry["offered_qos_profiles"])) for entry in known]
    numbers = {topic.name: number for number, topic in enumerate(topics)}
    files = []
    for path in _files(folder):
        contents = Contents(path)
        with path.open("rb") as stream:
            found = make_reader(stream).get_summary()
        if found is None or found.statistics is None:
            raise ValueError(f"{path.name} has no summary")
        counts = [0] * len(topics)
        for channel, count in found.statistics.channel_message_counts.items():
            counts[numbers[found.channels[channel].topic]] += count
        if any(counts):
            contents.take(counts, found.statistics.message_start_time, found.statistics.message_end_time)
        files.append(contents)
    write_metadata(place, bag_metadata(topics, files, about.get("custom_data") or {}))


def _files(folder: Path) -> list[Path]:
    """In the order of their numbers, without those that a kill left empty."""
    found = [path for path in folder.glob(f"{folder.resolve().name}_*.mcap") if path.stat().st_size]
    return sorted(found, key=lambda path: int(path.stem.rpartition("_")[2]))


def _recovered(path: Path) -> str:
    counts = recover(path)
    if counts is None:
        return f"{path}: is whole"
    told = ", ".join(f"{count} of {topic}" for topic, count in counts.items() if count)
    return f"{path}: {sum(counts.values())} messages kept{': ' if told else ''}{told}"
