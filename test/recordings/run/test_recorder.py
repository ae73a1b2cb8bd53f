"""The recorder alone: files, queues and faults."""

import os
import queue
import resource
import threading
import time

import pytest
import yaml
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.rosbag2.writer import Writer as BagWriter
from rosbags.typesys import Stores, get_typestore

from mbd_sim.recordings.mcap.writer import DurableFile
from mbd_sim.recordings.run import recorder as module
from mbd_sim.recordings.run.paths import RecordingPaths
from mbd_sim.recordings.run.recorder import Recorder
from test.recordings.recordings import TOPICS, count_and_last, messages, metadata, recorder_in
from test.waiting import PATIENCE, wait_until


def test_messages_are_read_back_with_their_times_and_sequence_numbers(tmp_path):
    recorder = recorder_in(tmp_path)
    for number in range(1000):
        recorder.put("text" if number % 2 else "vital", bytes([number % 256]) * 8, number * 10, number)
    recorder.close()
    assert (recorder.written, recorder.dropped, recorder.failure) == (1000, 0, "")
    found = messages(recorder.path)
    assert [message.sequence for _, message in found] == list(range(1000))
    assert all(message.log_time == message.sequence * 10 for _, message in found)
    assert all(message.data == bytes([message.sequence % 256]) * 8 for _, message in found)
    assert {topic for topic, _ in found} == {"/text", "/vital"}
    with recorder.path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert {index.compression for index in summary.chunk_indexes} == {"zstd"}


def test_a_disk_that_is_still_storing_a_complete_file_is_not_said_to_be_out_of_order(tmp_path, monkeypatch):
    recorder, stored = recorder_in(tmp_path), threading.Event()
    monkeypatch.setattr(recorder._sync, "finish", stored.wait)
    recorder.put("vital", b"12345678", 0, 0)
    recorder.close(timeout=0.0)
    assert recorder.finished.wait(PATIENCE) and not recorder.ended.is_set()
    assert recorder.state_on_disk == ""
    assert not recorder.close(timeout=1e-3)  # at the end of the program it waits for it
    assert "the disk does not respond" in recorder.state_on_disk
    stored.set()
    assert recorder.close(PATIENCE) and recorder.state_on_disk == ""


def test_closing_twice_has_no_effect(tmp_path):
    recorder = recorder_in(tmp_path)
    recorder.close()
    recorder.close()


@pytest.mark.parametrize("rate", [1.0, 50.0])
def test_a_message_reaches_the_file_soon_even_at_a_low_rate(tmp_path, rate):
    recorder = recorder_in(tmp_path)
    for number in range(2):
        recorder.put("text", b"12345678", number, number)
        put = time.monotonic()
        wait_until(lambda number=number: count_and_last(recorder.path)[1] == number, "the message")
        if time.monotonic() - put < 1.0 / rate:
            time.sleep(max(0.0, put + 1.0 / rate - time.monotonic()))
    recorder.close()


def test_messages_put_before_begin_are_not_recorded(tmp_path):
    recorder = recorder_in(tmp_path, begun=False)
    recorder.put("vital", b"early", 0, 0)
    recorder.begin({"now": "yes"})
    recorder.put("vital", b"late", 1, 1)
    recorder.close()
    assert [message.data for _, message in messages(recorder.path)] == [b"late"]
    assert recorder.dropped == 1


def test_each_file_of_a_split_recording_is_complete(tmp_path):
    recorder = recorder_in(tmp_path)
    for number in range(30):
        if number in (10, 20):
            recorder.begin({"first_tick": str(number)})
        recorder.put("vital", b"12345678", number, number)
    recorder.close()
    paths = sorted(tmp_path.iterdir())
    first = paths[0]
    assert [path.name for path in paths] == [first.name, f"{first.stem}_part2.mcap", f"{first.stem}_part3.mcap"]
    assert [[m.sequence for _, m in messages(path)] for path in paths] == [[*range(n, n + 10)] for n in (0, 10, 20)]
    assert [metadata(path).get("first_tick") for path in paths] == [None, "10", "20"]


@pytest.mark.parametrize("split", [False, True])
def test_a_rosbag2_folder_has_valid_metadata(tmp_path, split):
    recorder = recorder_in(tmp_path, rosbag2=True)
    folder = recorder.paths.location
    wait_until((folder / "metadata.yaml").exists, "the metadata")
    early = yaml.safe_load((folder / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert early["relative_file_paths"] == [f"{folder.name}_0.mcap"]
    for number in range(100):
        if split and number == 60:
            recorder.begin({})
        recorder.put("text" if number % 4 else "vital", bytes(24), 1000 + number, number)
    recorder.close()
    described = yaml.safe_load((folder / "metadata.yaml").read_text())
    about = described["rosbag2_bagfile_information"]
    assert about["version"] == 9
    assert about["message_count"] == 100
    assert about["starting_time"] == {"nanoseconds_since_epoch": 1000}
    assert about["duration"] == {"nanoseconds": 99}
    assert [file["message_count"] for file in about["files"]] == ([60, 40] if split else [100])
    assert [topic["message_count"] for topic in about["topics_with_message_count"]] == [75, 25]
    with AnyReader([folder]) as reader:
        assert reader.message_count == sum(1 for _ in reader.messages()) == 100
        (profile,) = next(c for c in reader.connections if c.topic == "/vital").ext.offered_qos_profiles
        assert (profile.depth, profile.reliability.name, profile.durability.name) == (10, "RELIABLE", "VOLATILE")
    assert keys(described) == keys(bag_by_rosbags(tmp_path / "other"))


def bag_by_rosbags(folder):
    """Return the metadata that an independent writer of the same format version writes for a small bag."""
    with BagWriter(folder, version=9) as writer:
        store = get_typestore(Stores.ROS2_JAZZY)
        with AnyReader([next(folder.parent.glob("name_*"))]) as reader:
            profiles = reader.connections[0].ext.offered_qos_profiles
        connection = writer.add_connection("/a", "std_msgs/msg/String", typestore=store, offered_qos_profiles=profiles)
        writer.write(connection, 1, bytes(16))
        writer.set_custom_data("key", "value")
    return yaml.safe_load((folder / "metadata.yaml").read_text())


def keys(document):
    """Return the structure of nested values: keys and types, of lists the first entry, without free-form data."""
    if isinstance(document, dict):
        return {key: keys(value) for key, value in document.items() if key != "custom_data"}
    return [keys(document[0])] if isinstance(document, list) else type(document)


def test_a_full_disk_is_reported_and_lost_messages_are_counted():
    recorder = Recorder(RecordingPaths(module.Path("/dev/full")), TOPICS, "")
    recorder.begin({})
    for number in range(2000):
        recorder.put("text", b"12345678" * 100, number, number)
    recorder.close()
    assert "No space left on device" in recorder.failure
    assert recorder.written == 0
    assert recorder.dropped == 2000


def test_a_message_that_is_put_when_the_thread_has_just_ended_is_counted(monkeypatch):
    class LateQueue(queue.SimpleQueue):
        def put(self, item):
            if isinstance(item, tuple) and item[-1] == 10:
                assert recorder.finished.wait(PATIENCE)  # the disk is full when the chunk of the others is written
            super().put(item)

    monkeypatch.setattr(module.queue, "SimpleQueue", LateQueue)
    recorder = Recorder(RecordingPaths(module.Path("/dev/full")), TOPICS, "")
    recorder.begin({})
    for number in range(11):
        recorder.put("text", b"12345678", number, number)
    recorder.close()
    assert "No space left on device" in recorder.failure
    assert (recorder.written, recorder.dropped) == (0, 11)


def test_a_file_size_limit_leaves_a_complete_file_with_an_index(tmp_path):
    recorder = recorder_in(tmp_path)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, before[1]))
    try:
        for number in range(5000):
            recorder.put("text", os.urandom(100), number, number)
            time.sleep(1e-4)
        recorder.close()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert "File too large" in recorder.failure
    found = messages(recorder.path)
    assert [message.sequence for _, message in found] == list(range(len(found)))
    assert len(found) == recorder.written == 5000 - recorder.dropped > 100


class StalledFile(DurableFile):
    """A file whose disk accepts nothing until `released` is set."""

    released = threading.Event()

    def write(self, data):
        self.released.wait(PATIENCE)
        return super().write(data)


@pytest.fixture
def stalled():
    StalledFile.released.clear()
    yield StalledFile.released
    StalledFile.released.set()


def test_on_a_slow_disk_display_topics_are_dropped_and_vital_ones_kept(tmp_path, monkeypatch, stalled):
    monkeypatch.setattr(module, "QUEUE_LIMIT", 100 * (module.MESSAGE_OVERHEAD + 8))
    recorder = recorder_in(tmp_path, open_file=StalledFile)
    for number in range(1000):
        recorder.put("text", b"12345678", number, number)
        recorder.put("vital", b"12345678", number, number)
    assert 100 <= recorder.dropped <= 1000
    stalled.set()
    recorder.close()
    topics = [topic for topic, _ in messages(recorder.path)]
    assert topics.count("/vital") == 1000
    assert topics.count("/text") + recorder.dropped == 1000
    assert recorder.failure == ""


def test_memory_is_bounded_on_a_disk_that_is_always_too_slow(tmp_path, monkeypatch):
    class Throttled(DurableFile):
        rate = 200e3

        def write(self, data):
            time.sleep(len(data) / self.rate)
            return super().write(data)

    monkeypatch.setattr(module, "QUEUE_LIMIT", 200_000)
    recorder = recorder_in(tmp_path, open_file=Throttled)
    most = commands = displayed = 0
    while recorder.dropped < 2000:
        for _ in range(5):
            recorder.put("text", os.urandom(200), displayed, displayed)
            displayed += 1
        recorder.put("vital", commands.to_bytes(8, "little"), displayed, displayed)
        commands += 1
        most = max(most, recorder.queued)
    Throttled.rate = 1e9
    recorder.close()
    topics = [topic for topic, _ in messages(recorder.path)]
    assert topics.count("/vital") == commands
    assert topics.count("/text") == displayed - recorder.dropped
    assert most < 200_000 + 500 * (commands + 1)
    assert recorder.failure == ""


def test_the_recording_ends_without_a_gap_when_even_vital_messages_cannot_be_written(tmp_path, monkeypatch, stalled):
    monkeypatch.setattr(module, "VITAL_QUEUE_LIMIT", 100 * (module.MESSAGE_OVERHEAD + 8))
    recorder = recorder_in(tmp_path, open_file=StalledFile)
    for number in range(1000):
        recorder.put("vital", b"12345678", number, number)
    assert recorder.queued <= 102 * (module.MESSAGE_OVERHEAD + 8)
    assert "too slow even for commands" in recorder.failure
    stalled.set()
    recorder.close()
    written = [message.sequence for _, message in messages(recorder.path)]
    assert written == list(range(len(written)))
    assert 100 <= len(written) == 1000 - recorder.dropped


def test_the_recording_ends_while_there_is_still_room_to_finish_it(tmp_path):
    class Small(DurableFile):
        def free(self):
            return 3_000_000 - self.tell()

    recorder = recorder_in(tmp_path, open_file=Small)
    for number in range(5000):
        recorder.put("text", os.urandom(1000), number, number)
    recorder.close()
    assert "are left on the disk" in recorder.failure
    found = messages(recorder.path)
    assert len(found) == recorder.written > 500
    assert recorder.dropped == 5000 - recorder.written
    assert recorder.path.stat().st_size < 3_000_000


def test_if_the_next_file_cannot_be_opened_the_first_one_is_complete(tmp_path):
    def once(path):
        if "part2" in path.name:
            raise OSError(30, "Read-only file system", str(path))
        return DurableFile(path)

    recorder = recorder_in(tmp_path, open_file=once)
    recorder.put("vital", b"12345678", 1, 1)
    recorder.begin({})
    recorder.put("vital", b"12345678", 2, 2)
    recorder.close()
    assert "part2.mcap' stopped: Read-only file system" in recorder.failure
    assert [message.sequence for _, message in messages(recorder.paths.location)] == [1]
    assert (recorder.written, recorder.dropped) == (1, 1)
