"""Paths of recordings."""

import threading

import pytest

from mbd_sim.recordings.run.paths import RecordingError, file_name, new_recording_paths
from test.recordings.recordings import messages, recorder_in

UNUSUAL_NAMES = ["with spaces", "Übergröße 机构 🤖", "quo'te\"s", "new\nline", "$(touch hacked) `x` *", "-rf", "#?%&=;"]


def test_recordings_started_in_the_same_second_get_different_files(tmp_path):
    paths = {new_recording_paths(tmp_path / "new" / "folder", "name").location for _ in range(5)}
    assert len(paths) == 5
    assert all(path.parent == tmp_path / "new" / "folder" and path.suffix == ".mcap" for path in paths)


@pytest.mark.parametrize("rosbag2", [False, True])
def test_recordings_started_at_once_in_one_folder_never_share_a_name(tmp_path, rosbag2):
    found, barrier = [], threading.Barrier(8)

    def take():
        barrier.wait()
        found.extend(new_recording_paths(tmp_path, "name", rosbag2=rosbag2).location for _ in range(10))

    threads = [threading.Thread(target=take) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(set(found)) == len(found) == 80


def test_two_recorders_in_the_same_folder_write_separate_files(tmp_path):
    recorders = [recorder_in(tmp_path) for _ in range(2)]
    for number in range(2000):
        recorders[number % 2].put("text", b"12345678", number, number)
    for parity, recorder in enumerate(recorders):
        recorder.close()
        assert [message.sequence for _, message in messages(recorder.path)] == list(range(parity, 2000, 2))


def test_a_folder_that_cannot_be_created_is_an_error_with_a_remedy(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(RecordingError, match=r"cannot record to .*file/logs.*record_dir"):
        new_recording_paths(tmp_path / "file" / "logs", "name")


def test_an_invalid_folder_name_is_an_error_with_a_remedy(tmp_path):
    with pytest.raises(RecordingError, match="record_dir"):
        new_recording_paths(tmp_path / "nul\0", "name")
    with pytest.raises(RecordingError, match="too long"):
        new_recording_paths(tmp_path / ("x" * 300), "name")


@pytest.mark.parametrize("rosbag2", [False, True])
@pytest.mark.parametrize("name", UNUSUAL_NAMES)
def test_recordings_stay_in_the_folder_for_unusual_names_of_folder_and_mechanism(tmp_path, name, rosbag2):
    folder = tmp_path / name
    recorder = recorder_in(folder, rosbag2=rosbag2)
    recorder.put("vital", b"12345678", 1, 1)
    recorder.begin({})
    recorder.put("vital", b"12345678", 2, 2)
    recorder.close()
    assert recorder.failure == ""
    assert [message.sequence for path in sorted(folder.rglob("*.mcap")) for _, message in messages(path)] == [1, 2]
    assert new_recording_paths(tmp_path / "of", name, rosbag2=rosbag2).location.parent == tmp_path / "of"


def test_a_name_cannot_escape_the_folder(tmp_path):
    assert new_recording_paths(tmp_path, "../../etc/x").location.parent == tmp_path
    assert file_name("..") == "_"
    assert len(file_name("机" * 300).encode()) <= 150
