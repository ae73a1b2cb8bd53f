"""Damaged recordings: `verify` says what is damaged, and `recover` repairs what other readers refuse."""

import random
import re
import struct
import zlib

import pytest
from mcap.opcode import Opcode

from mbd_sim.cli.main import main
from mbd_sim.recordings.run.reader import open_recording
from mbd_sim.recordings.run.recovery import damaged_original, recover
from mbd_sim.recordings.run.verification import verify
from test.recordings.mutations import mutate, problems_with, records, refusal_of_other_readers
from test.recordings.recordings import recorder_in
from test.recordings.rewriting import rewrite
from test.recordings.runs import record_run

SAMPLE = 12


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A short run as the recorder writes it."""
    folder = tmp_path_factory.mktemp("run")
    return record_run(folder, "double_rod", seconds=0.04, resets=False, commands=3)


def with_changed_record(data, opcode, offset, change):
    """Return a file with a byte of a record's content changed, and a valid checksum of the summary."""
    _, start, _ = next(record for record in records(data) if record[0] == opcode)
    changed = bytearray(data)
    changed[start + 9 + offset] ^= change
    end = len(changed) - 8 - 4
    (summary,) = struct.unpack_from("<Q", changed, end - 16)
    struct.pack_into("<I", changed, end, zlib.crc32(changed[summary:end]))
    return bytes(changed)


@pytest.mark.parametrize(
    ("opcode", "offset", "words"),
    [
        (Opcode.CHUNK, 0, "differ from those of its messages"),
        (Opcode.MESSAGE_INDEX, 8, "the index of messages does not fit"),
        (Opcode.CHUNK_INDEX, 16, "the index of chunks differs"),
        (Opcode.STATISTICS, 0, "differ in the numbers of messages"),
        (Opcode.SCHEMA, 200, "a definition in the data differs"),
        (Opcode.SUMMARY_OFFSET, 3, "an offset in the summary is wrong"),
        (Opcode.ATTACHMENT_INDEX, 1, "the index of attachments differs"),
    ],
)
def test_a_damaged_index_is_reported_and_repaired(run, tmp_path, capsys, opcode, offset, words):
    path = tmp_path / "damaged.mcap"
    path.write_bytes(with_changed_record(run.read_bytes(), opcode, offset, 1))
    assert main(["verify", "--quiet", str(path)]) == 1
    out = capsys.readouterr().out
    assert "the states are right, bit for bit, but the index of the file is damaged" in out
    assert words in out and f"mbd_sim recover {path}" in out
    assert main(["recover", str(path)]) == 0
    assert main(["verify", "--quiet", str(path)]) == 0
    assert refusal_of_other_readers(path, deserialize=True) == ""
    assert recover(path) is None


def without_summary(data):
    """Return a file that was cut off where its summary begins."""
    return data[: next(start for opcode, start, _ in records(data) if opcode == Opcode.DATA_END)]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b"ros2msg", b"rosrmsg"),
        (b"# This", b"\xff This"),
        (b"float64[] position", b"floau64[] position"),
        (b"float64[] position", b"float64[] positioo"),
        (b"sensor_msgs/msg/JointState", b"sensor_msgs/msg/JointStatf"),
        (b"sensor_msgs/msg/JointState", b"\xffensor_msgs/msg/JointState"),
        (b"MSG: std_msgs/Header", b"MSG: std_msgs/HeadeR"),
        (b"\x01\x00\x1a\x00\x00\x00sensor", b"\x03\x00\x1a\x00\x00\x00sensor"),  # the schema's number
    ],
)
def test_a_damaged_definition_is_replaced(run, tmp_path, old, new):
    path = tmp_path / "damaged.mcap"
    data = without_summary(run.read_bytes())
    assert old in data
    path.write_bytes(data)
    complete = recover(path)
    path.write_bytes(data.replace(old, new, 1))
    assert recover(path) == complete
    assert refusal_of_other_readers(path, deserialize=True) == ""
    assert open_recording(path).topics == open_recording(run).topics
    result = verify(path)[0]
    assert result.is_intact and not result.index_problem and not result.content_problem
    assert recover(path) is None


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (b"ros2msg", b"rosrmsg", "std_msgs/msg/String has the unknown encoding 'rosrmsg'"),
        (b"string data", b"strinh data", "the definition of std_msgs/msg/String lacks that of 'std_msgs/msg/strinh'"),
        (b"reliability", b"reliabilitz", "the QoS profiles of /text cannot be read"),
        (b"# This", b"\xff This", "the definition of std_msgs/msg/String cannot be read ('utf-8' codec"),
    ],
)
def test_damaged_definitions_of_unknown_topics_are_refused(tmp_path, old, new, words):
    recorder = recorder_in(tmp_path)
    recorder.put("text", bytes(8), 1, 1)
    recorder.close()
    path = recorder.paths.location
    damaged = without_summary(path.read_bytes()).replace(old, new, 1)
    path.write_bytes(damaged)
    with pytest.raises(ValueError, match=re.escape(words)):
        recover(path)
    assert path.read_bytes() == damaged


def test_changed_parameters_in_the_metadata_are_reported(run, tmp_path, capsys):
    path = tmp_path / "damaged.mcap"
    path.write_bytes(run.read_bytes().replace(b"command_timeout", b"command_timeouT", 1))
    assert main(["verify", "--quiet", str(path)]) == 1
    assert "the checksum of its data differs" in capsys.readouterr().out
    assert recover(path) is not None and damaged_original(path).exists()
    assert recover(path) is None


def test_a_damaged_length_does_not_cost_the_original(run, tmp_path, capsys):
    path = tmp_path / "damaged.mcap"
    data = rewrite(run, path, chunk_size=500).read_bytes()
    chunks = [start for opcode, start, _ in records(data) if opcode == Opcode.CHUNK]
    damaged = bytearray(data)
    struct.pack_into("<Q", damaged, chunks[1] + 1, 1 << 40)
    path.write_bytes(damaged)
    assert len(chunks) > 3
    assert main(["recover", str(path)]) == 0
    assert "the damaged file is kept as" in capsys.readouterr().out
    assert damaged_original(path).read_bytes() == damaged
    assert refusal_of_other_readers(path) == ""
    assert verify(path)[0].is_intact


def test_a_damaged_index_costs_neither_its_chunk_nor_the_original(run, tmp_path):
    path = tmp_path / "damaged.mcap"
    data = rewrite(run, path, chunk_size=500).read_bytes()
    found = records(data)
    *_, (_, before), (_, last) = [(start, end) for opcode, start, end in found if opcode == Opcode.CHUNK]
    index = max(start for opcode, start, _ in found if opcode == Opcode.MESSAGE_INDEX and start < last)
    damaged = bytearray(data[:last])
    struct.pack_into("<Q", damaged, index + 1, 1 << 40)
    path.write_bytes(damaged)
    kept = recover(path)
    assert damaged_original(path).read_bytes() == damaged
    assert refusal_of_other_readers(path) == ""
    path.write_bytes(data[:before])
    assert recover(path) == kept and sum(kept.values()) > 0


def test_a_damaged_length_within_a_chunk_ends_the_undamaged_records_there(run, tmp_path):
    """Python reads at most what there is, so that a length that is too large goes unnoticed unless it is checked."""
    path = tmp_path / "damaged.mcap"
    data = rewrite(run, path, chunk_size=500).read_bytes()
    _, start, _ = [record for record in records(data) if record[0] == Opcode.CHUNK][2]
    damaged = bytearray(data)
    damaged[start + 9 + 8 + 8 + 8 + 4 + 4 + len("zstd") + 5] ^= 0x80  # of the length of the compressed records
    path.write_bytes(damaged)
    assert problems_with(path) == ([], False)


def test_randomly_damaged_records_are_never_a_surprise(run, tmp_path):
    chance = random.Random(4)
    small_chunks = rewrite(run, tmp_path / "small.mcap", chunk_size=500)
    path = tmp_path / "damaged.mcap"
    called_intact = 0
    for number in range(SAMPLE):
        data, what = mutate((run, small_chunks)[number % 2].read_bytes(), chance)
        path.write_bytes(data)
        problems, intact = problems_with(path)
        assert problems == [], what
        called_intact += intact
    assert called_intact < SAMPLE // 2
