"""`metadata.yaml` of a folder as rosbag2 writes it in Jazzy (version 9, `rosbag2_storage/yaml.hpp`)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from mbd_sim.recording.recorded_topic import Topic

VERSION = 9


@dataclass
class Contents:
    """What one file holds: messages by topic's number, and the times of the first and the last in ns."""

    path: Path
    counts: dict[int, int] = field(default_factory=dict)
    first_ns: int = 0
    last_ns: int = 0

    @property
    def messages(self) -> int:
        """How many."""
        return sum(self.counts.values())

    def take(self, counts: Sequence[int], first_ns: int, last_ns: int) -> None:
        """Some more messages, by topic, with the times of the earliest and the latest of them."""
        if not self.messages:
            self.first_ns, self.last_ns = first_ns, last_ns
        self.first_ns, self.last_ns = min(self.first_ns, first_ns), max(self.last_ns, last_ns)
        for number, count in enumerate(counts):
            if count:
                self.counts[number] = self.counts.get(number, 0) + count


def bag_metadata(topics: Sequence[Topic], files: Sequence[Contents], custom: Mapping[str, str]) -> dict[str, Any]:
    """The document as plain values; `custom` is free for the recorder to use."""
    filled = [contents for contents in files if contents.messages]
    first = min((contents.first_ns for contents in filled), default=0)
    last = max((contents.last_ns for contents in filled), default=0)
    return {
        "rosbag2_bagfile_information": {
            "version": VERSION,
            "storage_identifier": "mcap",
            "duration": {"nanoseconds": last - first},
            "starting_time": {"nanoseconds_since_epoch": first},
            "message_count": sum(contents.messages for contents in files),
            "topics_with_message_count": [
                {
                    "topic_metadata": {
                        "name": topic.name,
                        "type": topic.type,
                        "serialization_format": "cdr",
                        "offered_qos_profiles": yaml.safe_load(topic.qos),
                        "type_description_hash": topic.hash,
                    },
                    "message_count": sum(contents.counts.get(number, 0) for contents in files),
                }
                for number, topic in enumerate(topics)
            ],
            "compression_format": "",
            "compression_mode": "",
            "relative_file_paths": [contents.path.name for contents in files],
            "files": [
                {
                    "path": contents.path.name,
                    "starting_time": {"nanoseconds_since_epoch": contents.first_ns},
                    "duration": {"nanoseconds": contents.last_ns - contents.first_ns},
                    "message_count": contents.messages,
                }
                for contents in files
            ],
            "custom_data": dict(custom) or None,
            "ros_distro": "jazzy",
        }
    }


def write_metadata(path: Path, document: Mapping[str, Any]) -> None:
    """Write the document in one go: whoever reads meanwhile, or after a kill, finds the old one or the new one.

    :raises OSError: it cannot be written.
    """
    text = yaml.safe_dump(document, sort_keys=False, allow_unicode=True, width=1000)
    draft = path.with_name(f".{path.name}.new")
    draft.write_text(text, encoding="utf-8")
    draft.replace(path)
