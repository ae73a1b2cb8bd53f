"""The recorder on disks that fail: at any write, for a while or for ever, with any error; and disks that hang."""

import errno
import random
import shutil
import threading

import pytest
from rosbags.highlevel import AnyReader

from mbd_sim.recordings.mcap.check import FileCheck, check_file
from mbd_sim.recordings.mcap.writer import DurableFile
from mbd_sim.recordings.run.paths import RecordingError, new_recording_paths
from mbd_sim.recordings.run.recovery import recover
from test.recordings.recordings import count_and_last, messages, recorder_in
from test.waiting import PATIENCE, wait_until

CHUNKS = 5
CODES = {"EIO": errno.EIO, "ENOSPC": errno.ENOSPC, "EDQUOT": errno.EDQUOT}


def faulty(code, first, count, *, partial=False):
    """Return a class of files of which some writes fail; `partial` writes half of the bytes before."""

    class FaultyFile(DurableFile):
        writes = 0

        def write(self, data):
            FaultyFile.writes += 1
            if first <= FaultyFile.writes < first + count:
                if partial:
                    super().write(data[: len(data) // 2])
                raise OSError(code, "the disk fails")
            return super().write(data)

    return FaultyFile


def record(folder, open_file, **options):
    """Record a few chunks; return the recorder after its end."""
    recorder = recorder_in(folder, open_file=open_file, **options)
    chance = random.Random(1)
    for number in range(CHUNKS * 50):
        recorder.put("text" if number % 3 else "vital", chance.randbytes(22_000), number, number)
    recorder.close()
    return recorder


@pytest.mark.parametrize(("code", "partial"), [*zip(CODES, (True, False, True), strict=True)])
def test_after_an_error_at_any_write_other_readers_open_the_file(tmp_path, code, partial):
    for first in range(2, CHUNKS + 3):
        folder = tmp_path / str(first)
        recorder = record(folder, faulty(CODES[code], first, 1, partial=partial))
        assert "the disk fails" in recorder.failure and recorder.state_on_disk == ""
        found = messages(recorder.path)
        assert [message.sequence for _, message in found] == list(range(recorder.written))
        assert recorder.written == recorder.saved == CHUNKS * 50 - recorder.dropped
        assert recorder.written >= 45 * (first - 3)
        assert check_file(recorder.path) == FileCheck()
        with AnyReader([recorder.path]) as reader:
            assert reader.message_count == recorder.written


@pytest.mark.parametrize("code", CODES)
def test_a_disk_that_fails_for_ever_leaves_what_recover_repairs_and_the_recorder_says_so(tmp_path, code, monkeypatch):
    monkeypatch.setattr(
        "mbd_sim.recordings.run.recovery.recover", lambda path: (_ for _ in ()).throw(OSError("still fails"))
    )
    recorder = record(tmp_path, faulty(CODES[code], 5, 1000, partial=True))
    assert recorder.state_on_disk.endswith(f"mbd_sim recover '{recorder.path}'")
    kept = count_and_last(recorder.path)[0]
    assert kept == recorder.saved > 45
    assert sum(recover(recorder.path).values()) == kept
    with AnyReader([recorder.path]) as reader:
        assert reader.message_count == kept


def test_a_disk_that_works_again_lets_the_file_be_completed_at_the_end(tmp_path):
    disk = faulty(errno.EIO, 4, 1000)
    recorder = recorder_in(tmp_path, open_file=disk)
    for number in range(200):
        recorder.put("vital", random.Random(number).randbytes(22_000), number, number)
    wait_until(lambda: recorder.failure, "the failure")
    recorder.close()  # `recover` writes with other calls, which succeed
    assert recorder.state_on_disk == ""
    assert [message.sequence for _, message in messages(recorder.path)] == list(range(recorder.saved))


@pytest.mark.parametrize("rosbag2", [False, True])
def test_an_error_at_the_first_write_leaves_no_file(tmp_path, rosbag2):
    recorder = record(tmp_path, faulty(errno.EIO, 1, 1000), rosbag2=rosbag2)
    assert list(tmp_path.iterdir()) == []
    assert recorder.state_on_disk == f"nothing could be written to '{recorder.path}'"
    assert recorder.dropped == CHUNKS * 50


def test_a_folder_that_is_removed_before_a_split_is_reported(tmp_path):
    folder = tmp_path / "logs"
    recorder = recorder_in(folder)
    wait_until(recorder.path.exists, "the file")
    shutil.rmtree(folder)
    recorder.begin({})
    assert recorder.close(timeout=PATIENCE)
    assert "_part2.mcap' stopped: No such file or directory" in recorder.failure
    assert recorder.state_on_disk == f"but '{recorder.path}' has been removed"


def test_closing_does_not_wait_for_a_disk_that_hangs(tmp_path):
    released = threading.Event()

    class HangingFile(DurableFile):
        def write(self, data):
            if self.tell():
                released.wait(PATIENCE)
            return super().write(data)

    recorder = recorder_in(tmp_path, open_file=HangingFile)
    for number in range(10):
        recorder.put("vital", b"12345678", number, number)
    wait_until(lambda: recorder.path.exists() and recorder.path.stat().st_size, "the begin of the file")
    assert not recorder.close(timeout=0.4)  # the disk hangs until it is released
    assert "lacks the last 10 messages" in recorder.state_on_disk and "mbd_sim recover" in recorder.state_on_disk
    released.set()
    assert recorder.ended.wait(PATIENCE)
    assert recorder.state_on_disk == ""


def test_a_file_that_is_killed_before_its_first_message_can_be_opened_after_recovery(tmp_path):
    recorder = recorder_in(tmp_path, rosbag2=True)
    wait_until(recorder.path.exists, "the file")
    left = tmp_path / "left.mcap"
    left.write_bytes(recorder.path.read_bytes())
    recorder.close()
    assert recover(left) == {"/text": 0, "/vital": 0}
    with AnyReader([left]) as reader:
        assert {connection.topic for connection in reader.connections} == {"/text", "/vital"}


def test_the_home_of_an_unknown_user_is_an_error_with_a_remedy(tmp_path):
    from pathlib import Path

    with pytest.raises(RecordingError, match=r"there is no user 'nobodyhere'\. Choose another record_dir"):
        new_recording_paths(Path("~nobodyhere/x"), "name")
