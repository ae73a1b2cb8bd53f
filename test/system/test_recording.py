"""Recordings of real runs, read by readers that share no code with the writer."""

from __future__ import annotations

import math
import signal
import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore
from std_msgs.msg import Float64MultiArray

from test.system.nodes import nanoseconds, running

TOPICS = {
    "/joint_states": "sensor_msgs/msg/JointState",
    "/energies": "std_msgs/msg/Float64MultiArray",
    "/sim_node/applied_efforts": "std_msgs/msg/Float64MultiArray",
    "/sim_node/applied_commands": "std_msgs/msg/Float64MultiArray",
    "/sim_node/applied_wrenches": "std_msgs/msg/Float64MultiArray",
    "/sim_node/live_values": "std_msgs/msg/Float64MultiArray",
    "/sim_node/new_states": "std_msgs/msg/Float64MultiArray",
    "/sim_node/events": "std_msgs/msg/String",
    "/robot_description": "std_msgs/msg/String",
}
LATCHED = (
    "/robot_description",
    "/sim_node/applied_commands",
    "/sim_node/applied_efforts",
    "/sim_node/events",
    "/sim_node/live_values",
)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Any]]:
    """A recording of a run with commands, a pause and a reset, and the joint states that were received meanwhile."""
    folder = tmp_path_factory.mktemp("run")
    with running(folder, record=True, record_dir="logs", command_timeout=0.2) as (process, listener):
        listener.ready_to_command()
        listener.by_order.publish(Float64MultiArray(data=[1.5, -0.5]))
        listener.until(lambda: any("expired" in event for event in listener.events), "the expiry")
        listener.pause(True)
        listener.reset()
        listener.pause(False)
        seen = len(listener.states)
        listener.until(lambda: len(listener.states) > seen + 50, "states")
        assert process.end(signal.SIGINT) == 0
        assert "recorded" in process.text
        received = list(listener.states)
    (path,) = (folder / "logs").glob("double_rod_*.mcap")
    return path, received


def decoded(path: Path) -> list[tuple[Any, Any, Any]]:
    with path.open("rb") as stream:
        messages = make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages()
        return [(channel, message, content) for _, channel, message, content in messages]


def test_two_independent_readers_find_the_same_messages(run: tuple[Path, list[Any]]) -> None:
    path, received = run
    by_mcap = Counter(channel.topic for channel, _, _ in decoded(path))
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        by_rosbags = Counter(connection.topic for connection, _, _ in reader.messages())
        types = {connection.topic: connection.msgtype for connection in reader.connections}
        first = next(reader.messages([c for c in reader.connections if c.topic == "/joint_states"]))
        state = reader.deserialize(first[2], first[0].msgtype)
    assert by_mcap == by_rosbags
    assert types == TOPICS
    assert by_mcap["/joint_states"] == by_mcap["/energies"] >= len({nanoseconds(m.header.stamp) for m in received}) - 1
    assert list(state.position) == [math.pi / 2, 0.0]


def test_every_received_state_is_recorded_bit_for_bit(run: tuple[Path, list[Any]]) -> None:
    path, received = run
    recorded = {
        (nanoseconds(content.header.stamp), tuple(content.position), tuple(content.velocity), tuple(content.effort))
        for channel, _, content in decoded(path)
        if channel.topic == "/joint_states"
    }
    published = {(nanoseconds(m.header.stamp), tuple(m.position), tuple(m.velocity), tuple(m.effort)) for m in received}
    assert len(published) > 50
    assert published <= recorded


def test_channels_schemas_and_the_first_records_are_as_ros_tools_expect(run: tuple[Path, list[Any]]) -> None:
    path, _ = run
    with path.open("rb") as stream:
        reader = make_reader(stream)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
        assert summary is not None and summary.statistics is not None
        assert summary.statistics.message_count == sum(summary.statistics.channel_message_counts.values())
        for channel in summary.channels.values():
            assert channel.message_encoding == "cdr"
            assert summary.schemas[channel.schema_id].encoding == "ros2msg"
            (profile,) = yaml.safe_load(channel.metadata["offered_qos_profiles"])
            assert profile["reliability"] == "reliable" and profile["history"] == "keep_last"
            latched = channel.topic in LATCHED
            assert profile["durability"] == ("transient_local" if latched else "volatile")
            assert profile["lifespan"] == {"sec": 9223372036, "nsec": 854775807}
            assert channel.metadata["topic_type_hash"].startswith("RIHS01_")
        first_chunk = min(chunk.chunk_start_offset for chunk in summary.chunk_indexes)
        assert all(index.offset < first_chunk for index in summary.attachment_indexes)


def test_sequence_numbers_are_steps_and_log_times_never_go_back(run: tuple[Path, list[Any]]) -> None:
    path, _ = run
    messages = [(channel.topic, message, content) for channel, message, content in decoded(path)]
    for topic, message, content in messages:
        if topic == "/joint_states":
            assert nanoseconds(content.header.stamp) == message.log_time == message.sequence * 1_000_000
    times = [message.log_time for _, message, _ in messages]
    assert all(np.diff(times) >= 0)


def test_reruns_own_converter_reads_the_recording(run: tuple[Path, list[Any]], tmp_path: Path) -> None:
    path, _ = run
    out = tmp_path / "run.rrd"
    rerun = [str(Path(sys.executable).with_name("rerun"))]
    subprocess.run([*rerun, "mcap", "convert", str(path), "-o", str(out)], check=True, capture_output=True)
    printed = subprocess.run([*rerun, "rrd", "print", str(out)], check=True, capture_output=True, text=True).stdout
    assert "/joint_states" in printed
    assert "/energies" in printed


def test_a_folder_that_cannot_be_written_is_reported_and_the_simulation_runs(tmp_path: Path) -> None:
    (tmp_path / "occupied").write_text("a file where the folder should be")
    with running(tmp_path, record=True, record_dir="occupied/logs") as (process, listener):
        listener.until(lambda: len(listener.states) > 20, "states")
        assert "cannot record to" in process.text
        assert "record_dir" in process.text
