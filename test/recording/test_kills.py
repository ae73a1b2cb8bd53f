"""What is left when a recording process is killed at any moment: as much as promised, and it can be made whole."""

import json
import random
import subprocess
import sys
from pathlib import Path

import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from mbd_sim.cli.main import main
from mbd_sim.recording.recovery import recover
from test.recording.recordings import messages, metadata, readable, recorder_in, whole_chunks

KILLS = 100
PROMISED = 0.5e9  # ns


@pytest.fixture(scope="module")
def killed(tmp_path_factory):
    """The recordings of processes that were killed, with what had been put into each."""
    folder, seed = tmp_path_factory.mktemp("killed"), random.randrange(1 << 30)
    command = [sys.executable, "-m", "test.recording.killed_writers", str(folder), str(KILLS), str(seed)]
    told = subprocess.run(command, check=True, capture_output=True, text=True, timeout=80).stdout
    return [(next(Path(own).rglob("*.mcap"), None), *rest) for own, *rest in json.loads(told)]


def test_of_a_hundred_killed_recordings_none_lacks_more_than_half_a_second(killed):
    assert len(killed) == KILLS
    losses = []
    for path, put, first, last in killed:
        count, newest = whole_chunks(path) if path else (0, -1)
        assert newest == count - 1 < put or count == put == 0
        saved = readable(path)[-1].log_time if count else first
        losses.append(last - saved)
    assert sum(put for _, put, _, _ in killed) > 5_000
    assert max(losses) <= PROMISED


def test_killed_recordings_are_made_whole_for_every_tool(killed):
    saved = 0
    for path, _, _, _ in killed:
        if path is None or not path.stat().st_size:
            continue
        count, _ = whole_chunks(path)
        assert sum(recover(path).values()) == count
        assert [message.sequence for _, message in messages(path)] == list(range(count))
        assert metadata(path) == {"a": "b"}
        with path.open("rb") as stream:
            assert next(make_reader(stream).iter_attachments()).data == b"mechanism: x\n"
        if count:
            saved += 1
            with AnyReader([path]) as reader:
                assert reader.message_count == sum(1 for _ in reader.messages()) == count
        assert recover(path) is None  # once is enough
    assert saved > KILLS // 4


def test_the_command_recovers_files_and_folders_of_rosbag2(tmp_path, capsys):
    recorder = recorder_in(tmp_path, rosbag2=True)
    for number in range(20_000):
        if number == 5_000:
            recorder.begin({})
        recorder.put("text" if number % 4 else "vital", random.randbytes(120), number, number)
    recorder.close()
    folder = recorder.paths.location
    cut = folder / f"{folder.name}_1.mcap"
    cut.write_bytes(cut.read_bytes()[:-400_000])
    (folder / f"{folder.name}_2.mcap").touch()  # killed just after it was opened
    assert main(["recover", str(folder)]) == 0
    told = capsys.readouterr().out
    assert f"{folder.name}_0.mcap: is whole" in told
    assert f"{folder.name}_1.mcap: " in told and "messages kept" in told
    with AnyReader([folder]) as reader:
        assert reader.message_count == sum(1 for _ in reader.messages()) == 5_000 + len(messages(cut))
        assert all(connection.digest.startswith("RIHS01_") for connection in reader.connections)
    (tmp_path / "note.mcap").write_text("not a recording")
    assert main(["recover", str(tmp_path / "note.mcap")]) == 1
    assert "not an MCAP file" in capsys.readouterr().err


def test_a_recording_cut_off_anywhere_keeps_its_whole_chunks(tmp_path):
    recorder = recorder_in(tmp_path)
    for number in range(20_000):
        recorder.put("text" if number % 3 else "vital", random.randbytes(120), number, number)
    recorder.close()
    whole = recorder.path.read_bytes()
    path = tmp_path / "cut.mcap"
    chance = random.Random(1)
    for length in [9, 100, len(whole) - 1, len(whole) - 9, *(chance.randrange(2000, len(whole)) for _ in range(20))]:
        path.write_bytes(whole[:length])
        expected, _ = whole_chunks(path)
        kept = sum(recover(path).values())
        assert kept <= expected
        assert [message.sequence for _, message in messages(path)] == list(range(kept))


def test_zeros_or_nonsense_at_the_end_are_cut_off(tmp_path):
    recorder = recorder_in(tmp_path)
    for number in range(20_000):
        recorder.put("vital", random.randbytes(120), number, number)
    recorder.close()
    whole = recorder.path.read_bytes()
    path = tmp_path / "cut.mcap"
    for tail in (bytes(5000), random.Random(2).randbytes(5000)):
        path.write_bytes(whole[: len(whole) // 2] + tail)
        kept = sum(recover(path).values())
        assert 5_000 < kept < 15_000
        assert [message.sequence for _, message in messages(path)] == list(range(kept))


def test_what_is_no_recording_is_left_alone(tmp_path):
    path = tmp_path / "note.txt"
    path.write_text("not a recording")
    with pytest.raises(ValueError, match="not an MCAP file"):
        recover(path)
    assert path.read_text() == "not a recording"
