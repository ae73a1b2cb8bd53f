"""Recordings of processes killed at random moments: how much is lost, and recovery."""

import io
import json
import random
import statistics
import subprocess
import sys
from pathlib import Path

import pytest
from mcap.opcode import Opcode
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from mbd_sim.cli.main import main
from mbd_sim.recordings.mcap.check import check_file
from mbd_sim.recordings.run.reader import open_recording
from mbd_sim.recordings.run.recorder import CHUNK_PERIOD
from mbd_sim.recordings.run.recovery import recover
from test.recordings.mutations import records
from test.recordings.recordings import count_and_last, messages, metadata, readable, recorder_in
from test.recordings.runs import record_run
from test.waiting import PATIENCE

KILLS = 20


@pytest.fixture(scope="module")
def killed(tmp_path_factory):
    """The recordings of killed processes, with the number and the times of the messages put into each."""
    folder, seed = tmp_path_factory.mktemp("killed"), random.randrange(1 << 30)
    command = [sys.executable, "-m", "test.recordings.killed_writers", str(folder), str(KILLS), str(seed)]
    printed = subprocess.run(command, check=True, capture_output=True, text=True, timeout=PATIENCE).stdout
    return [(next(Path(own).rglob("*.mcap"), None), *rest) for own, *rest in json.loads(printed)]


def test_kills_cost_the_messages_of_the_last_chunk(killed):
    """On a loaded machine some processes lose more: whatever had not reached the thread that writes."""
    assert len(killed) == KILLS
    losses = []
    for path, put, first, last, stall in killed:
        count, newest = count_and_last(path) if path else (0, -1)
        assert newest == count - 1 < put or count == put == 0
        saved = readable(path)[-1].log_time if count else first
        losses.append(last - saved - stall)  # less what the machine left the process waiting
    assert sum(put for _, put, *_ in killed) > 2_000
    assert statistics.median(losses) <= 1.5e9 * CHUNK_PERIOD


def test_recovered_recordings_are_complete_for_every_tool(killed):
    saved = 0
    for path, *_ in killed:
        if path is None or not path.stat().st_size:
            continue
        count, _ = count_and_last(path)
        assert sum(recover(path).values()) == count
        assert [message.sequence for _, message in messages(path)] == list(range(count))
        assert metadata(path) == {"a": "b"}
        with path.open("rb") as stream:
            assert next(make_reader(stream).iter_attachments()).data == b"mechanism: x\n"
        if count:
            saved += 1
            with AnyReader([path]) as reader:
                assert reader.message_count == sum(1 for _ in reader.messages()) == count
        assert recover(path) is None  # the second time it is complete
    assert saved > KILLS // 4


def test_the_recover_command_accepts_files_and_rosbag2_folders(tmp_path, capsys):
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
    out = capsys.readouterr().out
    assert f"{folder.name}_0.mcap: is complete" in out
    assert f"{folder.name}_1.mcap: " in out and "messages kept" in out
    with AnyReader([folder]) as reader:
        assert reader.message_count == sum(1 for _ in reader.messages()) == 5_000 + len(messages(cut))
        assert all(connection.digest.startswith("RIHS01_") for connection in reader.connections)
    (tmp_path / "note.mcap").write_text("not a recording")
    assert main(["recover", str(tmp_path / "note.mcap")]) == 1
    assert "not an MCAP file" in capsys.readouterr().err


def test_a_folder_killed_before_its_metadata_existed_is_recovered(tmp_path, capsys):
    run = record_run(tmp_path, "double_rod", seconds=0.04, resets=False, commands=3, record_format="rosbag2")
    folder = run.parent
    (folder / "metadata.yaml").unlink()
    run.write_bytes(run.read_bytes()[:-2_000])
    assert main(["recover", str(folder)]) == 0
    assert main(["verify", "--quiet", str(folder)]) == 0
    with AnyReader([folder]) as reader:
        assert reader.message_count == sum(1 for _ in reader.messages()) == len(messages(run)) > 0
        assert {connection.topic for connection in reader.connections} == set(open_recording(run).topics)
        assert all(connection.digest.startswith("RIHS01_") for connection in reader.connections)
    recovered = (folder / "metadata.yaml").read_bytes()
    assert main(["recover", str(folder)]) == 0
    assert (folder / "metadata.yaml").read_bytes() == recovered
    capsys.readouterr()
    run.unlink()
    (folder / "metadata.yaml").unlink()
    assert main(["recover", str(folder)]) == 1
    assert "contains no .mcap file with any data" in capsys.readouterr().err


def test_recovery_keeps_the_complete_chunks_of_a_file_truncated_anywhere(tmp_path):
    recorder = recorder_in(tmp_path)
    for number in range(8_000):
        recorder.put("text" if number % 3 else "vital", random.randbytes(120), number, number)
    recorder.close()
    complete = recorder.path.read_bytes()
    path = tmp_path / "cut.mcap"
    chance = random.Random(1)
    indexes = [(start, end) for opcode, start, end in records(complete) if opcode == Opcode.MESSAGE_INDEX]
    assert len(indexes) > 3
    for length in [
        9,
        len(complete) - 1,
        len(complete) - 9,
        chance.randrange(2000, len(complete)),
        *(place for start, end in indexes[-1:] for place in (start, start + 5, end - 1)),
    ]:
        path.write_bytes(complete[:length])
        expected, _ = count_and_last(path)
        assert sum(recover(path).values()) == expected
        assert [message.sequence for _, message in messages(path)] == list(range(expected))
        check = check_file(path)
        assert not check.index_problem and not check.content_problem and recover(path) is None


def test_recovery_removes_zeros_and_random_bytes_at_the_end(tmp_path):
    recorder = recorder_in(tmp_path)
    for number in range(20_000):
        recorder.put("vital", random.randbytes(120), number, number)
    recorder.close()
    complete, path = recorder.path.read_bytes(), tmp_path / "cut.mcap"
    half = len(complete) // 2
    chunks = (
        make_reader(io.BytesIO(complete)).get_summary().chunk_indexes
    )  # their sizes depend on the speed of the machine
    whole = [one.message_end_time + 1 for one in chunks if one.chunk_start_offset + one.chunk_length <= half]
    for tail in (bytes(5000), random.Random(2).randbytes(5000)):
        path.write_bytes(complete[:half] + tail)
        kept = sum(recover(path).values())
        assert kept == max(whole) < 15_000
        assert [message.sequence for _, message in messages(path)] == list(range(kept))


def test_recovery_does_not_modify_other_files(tmp_path):
    path = tmp_path / "note.txt"
    path.write_text("not a recording")
    with pytest.raises(ValueError, match="not an MCAP file"):
        recover(path)
    assert path.read_text() == "not a recording"
