"""Recordings of synthetic messages, and readers of files that may be truncated."""

import contextlib
import struct

from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader, make_reader

from mbd_sim.recordings.messages import definitions
from mbd_sim.recordings.messages.definitions import Topic
from mbd_sim.recordings.run.paths import new_recording_paths
from mbd_sim.recordings.run.recorder import Recorder

QOS = definitions.offered_qos_profiles(definitions.STATE)
TOPICS = {
    "text": Topic("/text", "std_msgs/msg/String", QOS),
    "vital": Topic("/vital", "std_msgs/msg/String", QOS, vital=True),
}


def recorder_in(folder, *, begun=True, rosbag2=False, **options):
    """Return a recorder of two topics, one of them vital."""
    recorder = Recorder(new_recording_paths(folder, "name", rosbag2=rosbag2), TOPICS, "mechanism: x\n", **options)
    if begun:
        recorder.begin({"a": "b"})
    return recorder


def messages(path):
    """Return topics and messages of a complete file; its checksums are checked."""
    with path.open("rb") as stream:
        found = make_reader(stream, validate_crcs=True).iter_messages(log_time_order=False)
        return [(channel.topic, message) for _, channel, message in found]


def metadata(path):
    """Return the description of the run."""
    with path.open("rb") as stream:
        return {record.name: record.metadata for record in make_reader(stream).iter_metadata()}["mbd_sim"]


def readable(path):
    """Return the readable messages of a file that may be truncated."""
    found = []
    if not path.exists():  # it gets its name with its first bytes
        return found
    with path.open("rb") as stream, contextlib.suppress(McapError, EOFError, ValueError, struct.error):
        for _, _, message in NonSeekingReader(stream).iter_messages(log_time_order=False):
            found.append(message)
    return found


def count_and_last(path):
    """Return the number of readable messages of a file that may be truncated, and the last sequence number or -1."""
    found = readable(path)
    return len(found), found[-1].sequence if found else -1
