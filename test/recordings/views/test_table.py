"""Recordings as arrays and exported tables."""

import csv
import json
from pathlib import Path

import numpy as np
import pyarrow.parquet
import pytest
from mcap.writer import Writer
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from mbd_sim.cli.main import main
from mbd_sim.recordings.messages.definitions import definition
from mbd_sim.recordings.run.reader import open_recording
from mbd_sim.recordings.views import table as tables
from mbd_sim.recordings.views.table import PlaybackError, read_table
from test.recordings.rewriting import rewrite
from test.recordings.runs import record_run


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """One second of a double rod under commands, one of them a reset."""
    folder = tmp_path_factory.mktemp("playback")
    return record_run(folder, "double_rod", seconds=1.0, seed=3, commands=6, publish_rate=100.0)


def foreign_bag(path: Path, kind=JointState) -> Path:
    """Write the joint states of another robot: positions only, and a second joint that appears later."""
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2")
        name = "sensor_msgs/msg/JointState" if kind is JointState else "std_msgs/msg/String"
        schema = writer.register_schema(name, "ros2msg", definition(name).encode())
        channel = writer.register_channel("/robot/joints", "cdr", schema)
        for tick in range(20):
            message = String(data="hello")
            if kind is JointState:
                names = ["a"] if tick < 10 else ["b", "a"]
                message = JointState(name=names, position=[float(10 * (joint == "b") + tick) for joint in names])
            at = 1_700_000_000_000_000_000 + tick * 50_000_000
            writer.add_message(channel, at, serialize_message(message), at, tick)
        writer.finish()
    return path


def test_the_table_contains_the_recorded_messages(recording):
    opened = open_recording(recording)
    progress = []
    table = read_table(opened, progress.append)
    assert progress[-1] == 1.0
    assert table.is_run
    assert table.names == ("shoulder", "elbow")
    assert table.units == ("rad", "rad")
    states = [opened.decoded(message) for message in opened.messages({"/joint_states"})]
    np.testing.assert_array_equal(table.position, [state.position for state in states])
    np.testing.assert_array_equal(table.velocity, [state.velocity for state in states])
    np.testing.assert_array_equal(table.effort, [state.effort for state in states])
    np.testing.assert_allclose(table.times, [state.stamp_ns * 1e-9 for state in states], atol=1e-12)
    energies = [opened.decoded(message).values for message in opened.messages({"/energies"})]
    np.testing.assert_array_equal(table.energies, energies)
    assert table.steps[-1] == 1000
    assert table.title == "double_rod"


def test_a_truncated_run_gives_the_rows_before_the_cut(recording, tmp_path):
    run = rewrite(recording, tmp_path / "run.mcap", chunk_size=5000)
    whole, blocks = read_table(open_recording(run)), open_recording(run).blocks
    assert len(blocks) > 2
    for fraction in (0.9, 0.7, 0.5):
        cut = tmp_path / f"cut_{fraction}.mcap"
        cut.write_bytes(run.read_bytes()[: int(fraction * run.stat().st_size)])
        part = read_table(open_recording(cut))
        assert 10 < len(part) <= len(whole)
        np.testing.assert_array_equal(part.position, whole.position[: len(part)])
        assert "cut off" in part.notes[0]
    assert len(part) < len(whole)


def test_exports_agree_with_the_table_and_with_each_other(recording, tmp_path):
    table = read_table(open_recording(recording))
    columns = tables.columns(table)
    assert list(columns)[:4] == ["time_s", "step", "shoulder.position_rad", "elbow.position_rad"]
    assert {"shoulder.velocity_rad_s", "elbow.effort_Nm", "energy.kinetic_J", "energy.residual_J"} < set(columns)
    for kind in tables.SUFFIXES:
        assert main(["export", str(recording), "--out", str(tmp_path / f"run{kind}"), "--quiet"]) == 0
    with (tmp_path / "run.csv").open(encoding="utf-8") as stream:
        header, *rows = csv.reader(stream)
    assert header == list(columns)
    np.testing.assert_array_equal(np.array(rows, dtype=float).T, list(columns.values()))
    parquet = pyarrow.parquet.read_table(tmp_path / "run.parquet")
    assert parquet.column_names == list(columns)
    assert parquet.schema.metadata[b"mechanism"] == b"double_rod"
    with np.load(tmp_path / "run.npz") as arrays:
        for name, values in columns.items():
            np.testing.assert_array_equal(parquet[name], values)
            np.testing.assert_array_equal(arrays[name], values)
        about = json.loads(str(arrays["about"]))
    assert about["method"] == table.about["method"]
    assert json.loads(about["events"]) == [list(event) for event in table.events]


def test_a_bag_without_a_mechanism_has_joints_only(tmp_path):
    table = read_table(open_recording(foreign_bag(tmp_path / "robot.mcap")))
    assert not table.is_run
    assert table.names == ("a", "b")
    assert table.times[0] == 0.0
    assert table.times[-1] == pytest.approx(0.95)
    np.testing.assert_array_equal(table.position[:, 0], np.arange(20.0))
    assert np.all(np.isnan(table.position[:10, 1]))
    np.testing.assert_array_equal(table.position[10:, 1], np.arange(20.0, 30.0))
    assert list(tables.columns(table)) == ["time_s", "a.position", "b.position"]


def test_a_bag_without_joint_states_is_an_error_that_lists_its_topics(tmp_path):
    bag = foreign_bag(tmp_path / "talk.mcap", String)
    with pytest.raises(PlaybackError, match=r"no topic of joint states .* '?/robot/joints"):
        read_table(open_recording(bag))


def test_an_unknown_output_format_is_refused_before_anything_is_read(tmp_path, capsys):
    assert main(["export", str(tmp_path / "none.mcap"), "--out", "run.xlsx"]) == 1
    assert ".csv, .parquet, .npz" in capsys.readouterr().err
    assert main(["export", str(tmp_path / "none.mcap"), "--out", str(tmp_path / "no" / "run.csv")]) == 1
    assert "there is no folder" in capsys.readouterr().err
