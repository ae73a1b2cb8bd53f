"""The recorder alone: files, queues and faults."""

import json
import threading
from pathlib import Path

import pytest
from mcap.reader import make_reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from mbd_sim import Simulation
from mbd_sim.recording import recorder as module
from mbd_sim.recording.metadata import run_metadata
from mbd_sim.recording.recorder import Recorder, RecordingError, Topic, new_file
from mbd_sim.recording.schemas import definition, type_hash

TOPICS = {
    "text": Topic("/text", "std_msgs/msg/String", "- depth: 1"),
    "vital": Topic("/vital", "std_msgs/msg/String", "- depth: 1", vital=True),
}


def recorder_in(folder: Path, rate: float = 1e6) -> Recorder:
    return Recorder(new_file(folder, "name"), TOPICS, "mechanism: x\n", {"a": "b"}, rate)


def test_messages_come_back_with_their_times_and_sequence(tmp_path):
    recorder = recorder_in(tmp_path)
    for number in range(1000):
        recorder.put("text" if number % 2 else "vital", bytes([number % 256]) * 8, number * 10, number)
    recorder.close()
    assert (recorder.written, recorder.dropped, recorder.failure) == (1000, 0, "")
    with recorder.path.open("rb") as stream:
        messages = list(make_reader(stream).iter_messages())
    assert [message.sequence for _, _, message in messages] == list(range(1000))
    assert all(message.log_time == message.sequence * 10 for _, _, message in messages)
    assert all(message.data == bytes([message.sequence % 256]) * 8 for _, _, message in messages)
    assert {channel.topic for _, channel, _ in messages} == {"/text", "/vital"}


def test_closing_twice_is_harmless(tmp_path):
    recorder = recorder_in(tmp_path)
    recorder.close()
    recorder.close()


def test_two_recordings_of_one_second_get_two_files(tmp_path):
    paths = {new_file(tmp_path / "new" / "folder", "name") for _ in range(5)}
    assert len(paths) == 5
    assert all(path.parent == tmp_path / "new" / "folder" and path.suffix == ".mcap" for path in paths)


def test_a_folder_that_cannot_be_made_is_an_error_with_a_remedy(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(RecordingError, match=r"cannot record to .*file/logs.*record_dir"):
        new_file(tmp_path / "file" / "logs", "name")


def test_a_full_disk_is_reported_and_counted_and_never_raises(tmp_path):
    recorder = Recorder(Path("/dev/full"), TOPICS, "", {}, 1e3)
    for number in range(2000):
        recorder.put("text", b"12345678" * 100, number, number)
    recorder.close()
    assert "No space left on device" in recorder.failure
    assert recorder.written + recorder.dropped == 2000
    assert recorder.dropped > 0


def test_when_the_disk_is_slow_display_topics_are_dropped_and_vital_ones_are_kept(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "QUEUED", 10)
    recorder = recorder_in(tmp_path)
    with Stalled(recorder):
        for number in range(100):
            recorder.put("text", b"x", number, number)
        for number in range(100):
            recorder.put("vital", b"y", number, number)
    recorder.close()
    with recorder.path.open("rb") as stream:
        topics = [channel.topic for _, channel, _ in make_reader(stream).iter_messages()]
    assert topics.count("/vital") == 100 + 1
    assert 10 <= topics.count("/text") <= 12
    assert recorder.dropped == 100 - topics.count("/text")


class Stalled:
    """The recorder's writer held up in the middle of a message, as by a slow disk."""

    def __init__(self, recorder):
        self.recorder, self.gate, self.inside = recorder, threading.Event(), threading.Event()

    def __enter__(self):
        add = self.recorder._writer.add_message

        def slow(**fields):
            self.inside.set()
            self.gate.wait(10)
            add(**fields)

        self.recorder._writer.add_message = slow
        self.recorder.put("vital", b"first", 0, 0)
        self.inside.wait(10)
        self.recorder._writer.add_message = add
        return self

    def __exit__(self, *_):
        self.gate.set()


@pytest.mark.parametrize(
    "kind", ["sensor_msgs/msg/JointState", "std_msgs/msg/Float64MultiArray", "rosgraph_msgs/msg/Clock"]
)
def test_a_definition_is_complete_and_gives_the_type_that_ros_knows(kind):
    store = get_typestore(Stores.ROS2_JAZZY)
    parsed = get_types_from_msg(definition(kind), kind)
    assert kind in parsed
    for name, fields in parsed.items():
        assert [field for field, _ in fields[1]] == [field for field, _ in store.fielddefs[name][1]]


def test_the_hash_is_that_of_the_installed_type():
    store = get_typestore(Stores.ROS2_JAZZY)
    assert type_hash("sensor_msgs/msg/JointState") == store.hash_rihs01("sensor_msgs/msg/JointState")
    assert type_hash("std_msgs/msg/Nothing") == ""


def test_metadata_holds_the_exact_step_and_start():
    simulation = Simulation.from_file("double_rod", step=1e-3 / 3)
    about = run_metadata(simulation)
    assert float.fromhex(about["step"]) == 1e-3 / 3
    assert [float.fromhex(value) for value in json.loads(about["start"])] == simulation.state.tolist()
    assert about["method"] == "tsitouras8"
    assert all(isinstance(value, str) for value in about.values())
