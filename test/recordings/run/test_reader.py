"""Reading recordings: complete, truncated, damaged, in several files, and from other programs."""

import random

import pytest
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from mbd_sim.cli.main import main
from mbd_sim.recordings.mcap.rosbag2 import read_bag_metadata
from mbd_sim.recordings.messages import cdr
from mbd_sim.recordings.messages.cdr import DamagedError, Message, ReadingError
from mbd_sim.recordings.run.reader import open_recording
from test.recordings.rewriting import rewrite
from test.recordings.runs import record_run


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    recorded = record_run(folder, "double_rod", seconds=3.0, seed=2, publish_rate=500.0)
    return rewrite(recorded, folder / "small chunks.mcap", chunk_size=30_000)


def test_messages_and_their_contents_equal_those_read_by_rosbags(run):
    recording = open_recording(run)
    store = get_typestore(Stores.ROS2_JAZZY)
    ours = list(recording.messages())
    with AnyReader([run], default_typestore=store) as reader:
        theirs = [(c.topic, c.msgtype, time, bytes(data)) for c, time, data in reader.messages()]
    assert sorted((m.time_ns, m.topic, m.payload) for m in ours) == sorted((t, n, d) for n, _, t, d in theirs)
    assert {(name, topic.type) for name, topic in recording.topics.items()} >= {(n, k) for n, k, _, _ in theirs}
    assert sum(topic.count for topic in recording.topics.values()) == len(ours)
    for message in ours:
        topic, decoded = recording.topics[message.topic], recording.decoded(message)
        other = store.deserialize_cdr(message.payload, topic.type)
        if isinstance(decoded, cdr.JointStates):
            assert decoded.names == tuple(other.name)
            assert decoded.stamp_ns == other.header.stamp.sec * 10**9 + other.header.stamp.nanosec == message.time_ns
            assert [values.tobytes() for values in decoded[3:]] == [
                values.tobytes() for values in (other.position, other.velocity, other.effort)
            ]
        elif isinstance(decoded, cdr.MultiArray):
            assert decoded.labels == tuple(dim.label for dim in other.layout.dim)
            assert decoded.values.tobytes() == other.data.tobytes()
        else:
            assert decoded == other.data


def test_a_file_truncated_anywhere_yields_the_messages_before_the_cut(run, tmp_path):
    data, whole = run.read_bytes(), list(open_recording(run).messages())
    chance = random.Random(4)
    seen = set()
    for _ in range(10):
        path = tmp_path / "cut.mcap"
        path.write_bytes(data[: chance.randint(len(data) // 8, len(data) - 10)])
        recording = open_recording(path)
        found = list(recording.messages())
        assert found == whole[: len(found)]
        assert str(path) in recording.problems[0] and "cut off" in recording.problems[0]
        assert recording.mechanism_text == open_recording(run).mechanism_text
        seen.add(len(found))
    assert max(seen) > len(whole) // 2 and len(seen) > 5


def test_a_flipped_bit_anywhere_in_the_messages_is_detected(run, tmp_path):
    data = run.read_bytes()
    first = min(block.start_ns for block in open_recording(run).blocks)
    assert first == 0
    begin = data.index(b"offered_qos_profiles") if b"offered_qos_profiles" in data else len(data) // 4
    chance = random.Random(5)
    whole = list(open_recording(run).messages())
    for _ in range(30):
        damaged = bytearray(data)
        damaged[chance.randint(min(begin, len(data) // 4), len(data) * 3 // 4)] ^= 1 << chance.randint(0, 7)
        path = tmp_path / "flipped.mcap"
        path.write_bytes(damaged)
        recording = open_recording(path)
        try:
            found = list(recording.messages())
        except DamagedError as error:
            assert str(path) in str(error) and "damaged" in str(error)
        else:
            # What is left are indexes of messages, which this reader does not need, and ends of records.
            assert found == whole or recording.problems


def test_messages_in_time_order_and_the_latest_before_a_time(run):
    recording = open_recording(run)
    times = [message.time_ns for message in recording.in_time_order(start_ns=500_000_000)]
    assert times == sorted(times) and times[0] >= 500_000_000
    assert len(times) == sum(message.time_ns >= 500_000_000 for message in recording.messages())
    late = recording.latest(["/robot_description", "/joint_states", "/nothing"], recording.end_ns)
    assert [message.topic for message in late] == ["/robot_description", "/joint_states"]
    assert late[1].time_ns < recording.end_ns
    some = list(recording.messages({"/energies"}))
    assert {message.topic for message in some} == {"/energies"} and len(some) == recording.topics["/energies"].count


def test_a_folder_of_several_files_is_one_recording(run, tmp_path):
    folder = tmp_path / "bag"
    folder.mkdir()
    for number in (0, 1, 10):
        (folder / f"bag_{number}.mcap").write_bytes(run.read_bytes())
    recording = open_recording(folder)
    assert [file.path.name for file in recording.files] == ["bag_0.mcap", "bag_1.mcap", "bag_10.mcap"]
    assert recording.topics["/energies"].count == 3 * open_recording(run).topics["/energies"].count
    (folder / "metadata.yaml").write_text("rosbag2_bagfile_information: {relative_file_paths: [bag_1.mcap]}")
    assert [file.path.name for file in open_recording(folder).files] == ["bag_1.mcap"]
    (folder / "metadata.yaml").write_text(
        "rosbag2_bagfile_information: {relative_file_paths: [bag_0.mcap, bag_2.mcap]}"
    )
    with pytest.raises(
        ReadingError, match=r"bag_2.mcap: there is no such file, though metadata.yaml .*mbd_sim recover"
    ):
        open_recording(folder)
    (folder / "metadata.yaml").write_text("nonsense")
    with pytest.raises(ReadingError, match=r"metadata.yaml: cannot be read: it is not a description"):
        open_recording(folder)


def test_a_rosbag2_folder_and_its_files_may_be_renamed(tmp_path, capsys):
    path = record_run(tmp_path, "double_rod", seconds=0.05, commands=2, record_format="rosbag2")
    folder = path.parent.rename(tmp_path / "renamed")
    for first, then in ((path.name, "other.mcap"), ("other.mcap", "third.mcap")):
        assert main(["verify", str(folder), "--quiet"]) == 0
        assert main(["recover", str(folder)]) == 0
        (listed,) = read_bag_metadata(folder / "metadata.yaml")["relative_file_paths"]
        assert listed == first
        (folder / first).rename(folder / then)
    assert main(["verify", str(folder), "--quiet"]) == 0
    assert "third.mcap" in capsys.readouterr().out
    (folder / "third.mcap").unlink()
    about = (folder / "metadata.yaml").read_text()
    assert main(["verify", str(folder), "--quiet"]) == main(["recover", str(folder)]) == 1
    error = capsys.readouterr().err
    assert "other.mcap: there is no such file" in error and "Nothing can be recovered" in error
    assert (folder / "metadata.yaml").read_text() == about


@pytest.mark.parametrize(
    ("content", "words"),
    [(b"", "the file is empty"), (b"hello, world", "is not an MCAP file"), (None, "there is no such file")],
)
def test_a_file_that_is_not_a_recording_is_an_error(tmp_path, content, words):
    path = tmp_path / "x y.mcap"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ReadingError, match=f"x y.mcap: {words}"):
        open_recording(path)


def test_a_file_that_is_not_a_rosbag2_database_is_an_error(tmp_path):
    (tmp_path / "x.db3").write_bytes(b"nothing of the kind")
    with pytest.raises(ReadingError, match=r"x.db3: is not a rosbag2 database"):
        open_recording(tmp_path / "x.db3")


def test_a_message_of_another_type_is_an_error_with_topic_and_time(run):
    recording = open_recording(run)
    for payload in (b"", b"\x00\x01\x00\x00\xff\xff\xff\xff", b"\x07\x07\x00\x00"):
        with pytest.raises(ReadingError, match=r"/energies at t = 1 s"):
            recording.decoded(Message("/energies", payload, 10**9, 0))


def test_big_endian_messages_are_decoded():
    store = get_typestore(Stores.ROS2_JAZZY)
    state, header, stamp = (store.types[n] for n in (
        "sensor_msgs/msg/JointState", "std_msgs/msg/Header", "builtin_interfaces/msg/Time"))  # fmt: skip
    import numpy as np

    message = state(header(stamp(3, 4), "f"), ["a", "bcd"], np.array([1.0, 2.0]), np.array([]), np.array([3.0]))
    for little in (True, False):
        payload = bytes(store.serialize_cdr(message, "sensor_msgs/msg/JointState", little_endian=little))
        found = cdr.joint_states(payload)
        assert found[:3] == (3_000_000_004, "f", ("a", "bcd"))
        assert [values.tolist() for values in found[3:]] == [[1.0, 2.0], [], [3.0]]


def test_a_flipped_bit_in_the_mechanism_is_reported(run, tmp_path):
    data = bytearray(run.read_bytes())
    data[data.index(b"mechanism: double_rod") + 3] ^= 1
    path = tmp_path / "x.mcap"
    path.write_bytes(data)
    assert "attachment 'mechanism.yaml' fails its CRC check" in open_recording(path).problems[0]
