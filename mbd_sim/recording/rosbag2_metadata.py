"""`metadata.yaml` of a rosbag2 folder as written in Jazzy (version 9, `rosbag2_storage/yaml.hpp`)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from mbd_sim.messages.recorded_topic import Topic

VERSION = 9
FILE_NAME = "metadata.yaml"
_ROOT = "rosbag2_bagfile_information"


@dataclass
class FileStatistics:
    """The number of messages in one file, by topic number, and the log times of the first and the last in ns."""

    path: Path
    counts: dict[int, int] = field(default_factory=dict)
    first_ns: int = 0
    last_ns: int = 0

    @property
    def messages(self) -> int:
        """The number of all messages."""
        return sum(self.counts.values())

    def add(self, counts: Sequence[int], first_ns: int, last_ns: int) -> None:
        """Count more messages, by topic, with the times of the earliest and the latest of them."""
        if not self.messages:
            self.first_ns, self.last_ns = first_ns, last_ns
        self.first_ns, self.last_ns = min(self.first_ns, first_ns), max(self.last_ns, last_ns)
        for number, count in enumerate(counts):
            if count:
                self.counts[number] = self.counts.get(number, 0) + count


def bag_metadata(topics: Sequence[Topic], files: Sequence[FileStatistics], custom: Mapping[str, str]) -> dict[str, Any]:
    """Return the document as plain values; `custom` is the recorder's own data."""
    not_empty = [file for file in files if file.messages]
    first = min((file.first_ns for file in not_empty), default=0)
    last = max((file.last_ns for file in not_empty), default=0)
    return {
        _ROOT: {
            "version": VERSION,
            "storage_identifier": "mcap",
            "duration": {"nanoseconds": last - first},
            "starting_time": {"nanoseconds_since_epoch": first},
            "message_count": sum(file.messages for file in files),
            "topics_with_message_count": [
                {
                    "topic_metadata": {
                        "name": topic.name,
                        "type": topic.type,
                        "serialization_format": "cdr",
                        "offered_qos_profiles": yaml.safe_load(topic.qos),
                        "type_description_hash": topic.hash,
                    },
                    "message_count": sum(file.counts.get(number, 0) for file in files),
                }
                for number, topic in enumerate(topics)
            ],
            "compression_format": "",
            "compression_mode": "",
            "relative_file_paths": [file.path.name for file in files],
            "files": [
                {
                    "path": file.path.name,
                    "starting_time": {"nanoseconds_since_epoch": file.first_ns},
                    "duration": {"nanoseconds": file.last_ns - file.first_ns},
                    "message_count": file.messages,
                }
                for file in files
            ],
            "custom_data": dict(custom) or None,
            "ros_distro": "jazzy",
        }
    }


def read_bag_metadata(path: Path) -> dict[str, Any]:
    """Read the content of a `metadata.yaml`.

    :raises OSError: it cannot be read.
    :raises ValueError: it is not such a document.
    """
    try:
        return dict(yaml.safe_load(path.read_text(encoding="utf-8"))[_ROOT])
    except (yaml.YAMLError, KeyError, TypeError) as error:
        raise ValueError(f"it is not a description of a rosbag2 recording ({error!r})") from error


def write_metadata(path: Path, document: Mapping[str, Any]) -> None:
    """Replace the document atomically: a reader finds the old one or the new one, even after a kill.

    :raises OSError: it cannot be written.
    """
    text = yaml.safe_dump(document, sort_keys=False, allow_unicode=True, width=1000)
    draft = path.with_name(f".{path.name}.new")
    draft.write_text(text, encoding="utf-8")
    draft.replace(path)
