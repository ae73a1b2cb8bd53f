"""`replay_node` as a process: what it publishes, of runs of ours and of foreign bags."""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy
from rclpy.serialization import deserialize_message
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String
from std_srvs.srv import SetBool, Trigger

from mbd_sim.recordings.run.reader import open_recording
from mbd_sim.ros.events_executor import EventsExecutor
from mbd_sim.ros.replay.replay_node import main
from test.recordings.rewriting import rewrite
from test.recordings.runs import record_run
from test.system.nodes import Listener, SimNodeProcess, nanoseconds, new_domain

LATCHED = QoSProfile(depth=10, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
STEPS = 5  # of the player at once
EPOCH = 1_700_000_000_000_000_000


class ReplayProcess(SimNodeProcess):
    """`replay_node` in a process of its own; it starts paused."""

    program = "mbd_sim.ros.replay.replay_node"
    defaults = (("start_paused", True),)


class Audience(Listener):
    """Hears raw messages of some topics, and talks to `replay_node`."""

    server = "replay_node"

    def __init__(self, domain: int) -> None:
        self.context = Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = Node("audience", context=self.context)
        self.executor = EventsExecutor(context=self.context)
        self.executor.add_node(self.node)
        self._clients = {}
        self.received: dict[str, list[bytes]] = {}

    def listen(self, kind: type, topic: str, profile: QoSProfile | int = 1000) -> None:
        self.received[topic] = []
        self.node.create_subscription(kind, topic, self.received[topic].append, profile, raw=True)

    def all_matched(self) -> None:
        self.until(lambda: all(self.node.count_publishers(topic) for topic in self.received), "the publishers")
        super().all_matched()

    def until_received(self, expected: Mapping[str, Sequence[bytes]]) -> None:
        """Wait for as many messages as are expected of each topic."""
        self.until(lambda: all(len(self.received[name]) >= len(some) for name, some in expected.items()), "messages")

    def call_seek(self) -> Any:
        return self.call(Trigger, "seek")

    def times(self, topic: str = "/joint_states") -> list[int]:
        return [nanoseconds(deserialize_message(data, JointState).header.stamp) for data in self.received[topic]]


@contextlib.contextmanager
def replaying(folder: Path, bag: Path, *remaps: str, **parameters: Any) -> Iterator[tuple[ReplayProcess, Audience]]:
    domain = new_domain()
    process = ReplayProcess(domain, folder, {"bag": bag} | parameters, remaps)
    audience = Audience(domain)
    try:
        yield process, audience
    finally:
        audience.close()
        process.kill()


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A second of two rods with commands, and no reset."""
    folder = tmp_path_factory.mktemp("run")
    recorded = record_run(folder, "double_rod", seconds=1.0, seed=3, resets=False)
    return rewrite(recorded, folder / "small chunks.mcap", chunk_size=3000)


def cut(run: Path, folder: Path) -> Path:
    """What a kill leaves: half of the file."""
    path = folder / "cut.mcap"
    data = run.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    return path


def padded(payload: bytes) -> bytes:
    """A payload of whole words, to which DDS fills messages up."""
    return payload + bytes(-len(payload) % 4)


@pytest.mark.parametrize("whole", [True, False], ids=["finished", "truncated"])
def test_every_message_comes_back_as_it_was_recorded(run: Path, tmp_path: Path, whole: bool) -> None:
    bag = run if whole else cut(run, tmp_path)
    with replaying(tmp_path, bag, rate=2.0) as (process, audience):
        audience.listen(JointState, "/joint_states")
        audience.listen(Float64MultiArray, "/energies")
        audience.listen(Float64MultiArray, "/sim_node/applied_efforts")
        audience.listen(String, "/robot_description", LATCHED)
        audience.listen(Clock, "/clock")
        audience.all_matched()
        recorded = list(open_recording(bag).messages())
        times = sorted({message.time_ns for message in recorded})

        def due(until_ns: int) -> dict[str, list[bytes]]:
            until_then = [message for message in recorded if message.time_ns <= until_ns]
            return {
                topic: [padded(message.payload) for message in until_then if message.topic == topic]
                for topic in audience.received
                if topic != "/clock"
            }

        # A few at a time, so that an audience on a busy machine misses none; the end in real time, of which it misses none, too.
        assert audience.set_parameter("step_count", STEPS).successful
        for last in range(STEPS - 1, len(times) - 3 * STEPS, STEPS):
            assert audience.step().success
            audience.until_received(due(times[last]))
        audience.pause(False)
        audience.until(lambda: process.has_ended, "the end")
        audience.until_received(due(times[-1]))
        assert process.process.returncode == 0, process.text
        assert "played" in process.text
        assert ("cut off" in process.text) == (not whole)
        clocks = [nanoseconds(deserialize_message(data, Clock).clock) for data in audience.received.pop("/clock")]
    assert len(audience.received["/joint_states"]) > 30
    received = {topic: [padded(data) for data in payloads] for topic, payloads in audience.received.items()}
    assert received == due(times[-1])
    assert len(clocks) > 20 and all(np.diff(clocks) > 0)
    assert clocks[-1] <= recorded[-1].time_ns and clocks[0] == 0


@pytest.mark.parametrize("delay", [2.0, 1e5])
def test_subscribers_that_wait_for_a_run_receive_it_from_its_start_with_a_delay(
    run: Path, tmp_path: Path, delay: float
) -> None:
    """Played as fast as possible, a run was over before subscribers had found its topics: they received nothing."""
    recording = open_recording(run)
    expected = {"/joint_states": [each.payload for each in recording.messages() if each.topic == "/joint_states"]}
    with replaying(tmp_path, run, start_paused=False, delay=delay, rate=0.0, stay=True) as (_, audience):
        audience.listen(JointState, "/joint_states")
        if delay > 1000.0:
            audience.all_matched()
            assert audience.received == {"/joint_states": []}
            assert audience.call(SetBool, "pause", data=False).success
        audience.until_received(expected)
    assert list(map(padded, audience.received["/joint_states"])) == list(map(padded, expected["/joint_states"]))


def test_steps_seeks_and_latched_topics(run: Path, tmp_path: Path) -> None:
    with replaying(tmp_path, run, stay=True) as (process, audience):
        audience.listen(JointState, "/joint_states")
        audience.all_matched()
        assert audience.step().success
        audience.until(lambda: audience.times() == [0], "the first state")
        audience.set_parameter("seek_to", 0.5)
        answer = audience.call_seek()
        assert answer.success and answer.message == "at t = 0.5 s"
        audience.step()
        audience.until(lambda: audience.times() == [0, 500_000_000], "the state at 0.5 s")
        audience.listen(String, "/robot_description", LATCHED)  # subscribes late, and receives what was latched
        audience.until(lambda: audience.received["/robot_description"], "the description")
        audience.set_parameter("seek_to", 99.0)
        refused = audience.call_seek()
        assert not refused.success and "runs from 0 to" in refused.message
        audience.pause(False)
        audience.until(lambda: audience.times()[-1] == 1_000_000_000, "the end")
        audience.until(lambda: "at the end" in process.text, "the stay")
        assert process.end(signal.SIGINT) == 0


def foreign_bag(path: Path, plugin: StoragePlugin) -> None:
    """A bag that `rosbags` recorded: epoch times, a latched topic, and a type that is not installed here."""
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg("float64 x\n", "acme_msgs/msg/Thing"))
    header, text, thing = (
        store.types[name] for name in ("std_msgs/msg/Header", "std_msgs/msg/String", "acme_msgs/msg/Thing")
    )
    from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime

    forever = QosTime(9223372036, 854775807)
    latched = Qos(
        QosHistory.KEEP_LAST, 1, QosReliability.RELIABLE, QosDurability.TRANSIENT_LOCAL, forever, forever,
        QosLiveliness.AUTOMATIC, forever, False,
    )  # fmt: skip
    assert header
    with Writer(path, version=9, storage_plugin=plugin) as writer:
        chatter = writer.add_connection("/chatter", "std_msgs/msg/String", typestore=store)
        map_ = writer.add_connection("/map", "std_msgs/msg/String", typestore=store, offered_qos_profiles=[latched])
        unknown = writer.add_connection("/thing", "acme_msgs/msg/Thing", typestore=store)
        writer.write(map_, EPOCH, store.serialize_cdr(text("the map"), "std_msgs/msg/String"))
        for number in range(20):
            now = EPOCH + number * 10_000_000
            writer.write(chatter, now, store.serialize_cdr(text(f"hello {number}"), "std_msgs/msg/String"))
            writer.write(unknown, now, store.serialize_cdr(thing(1.0), "acme_msgs/msg/Thing"))


@pytest.mark.parametrize("plugin", list(StoragePlugin), ids=lambda plugin: plugin.name.lower())
def test_a_foreign_bag_plays_under_another_name_and_in_a_namespace(tmp_path: Path, plugin: StoragePlugin) -> None:
    bag = tmp_path / "bag"
    foreign_bag(bag, plugin)
    remaps = ("__ns:=/lab", "/lab/chatter:=/talk")
    with replaying(tmp_path, bag, *remaps, start_paused=True) as (process, audience):
        audience.server = "lab/replay_node"
        audience.listen(String, "/talk")
        audience.listen(String, "/lab/map", LATCHED)
        audience.listen(Clock, "/clock")
        audience.all_matched()
        audience.pause(False)
        audience.until(lambda: process.has_ended, "the end")
        audience.until_received({"/talk": [b""] * 20, "/lab/map": [b""], "/clock": [b""]})
        texts = [deserialize_message(data, String).data for data in audience.received["/talk"]]
        assert texts == [f"hello {number}" for number in range(20)]
        assert [deserialize_message(data, String).data for data in audience.received["/lab/map"]] == ["the map"]
        clocks = [nanoseconds(deserialize_message(data, Clock).clock) for data in audience.received["/clock"]]
        assert clocks[0] >= EPOCH and clocks[-1] <= EPOCH + 190_000_000
        assert "/thing is not played: acme_msgs/msg/Thing" in process.text


def test_the_offered_qos_is_the_recorded_one(run: Path, tmp_path: Path) -> None:
    with replaying(tmp_path, run) as (_, audience):
        audience.until(lambda: audience.node.count_publishers("/sim_node/events"), "the topics")
        offered = {
            topic: audience.node.get_publishers_info_by_topic(topic)[0].qos_profile
            for topic in ("/joint_states", "/sim_node/events")
        }
        assert all(profile.reliability == QoSReliabilityPolicy.RELIABLE for profile in offered.values())
        assert offered["/joint_states"].durability == QoSDurabilityPolicy.VOLATILE
        assert offered["/sim_node/events"].durability == QoSDurabilityPolicy.TRANSIENT_LOCAL


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"bag": "nowhere.mcap"}, "nowhere.mcap: there is no such file"),
        ({}, "no recording is given. Give one: --ros-args -p bag:=RUN.mcap"),
        ({"bag": __file__}, "is not an MCAP file"),
        ({"bag": "x.mcap", "rte": 1.0}, "Did you mean 'rate'?"),
        ({"bag": "x.mcap", "rate": -1.0}, "parameter 'rate' must lie between "),
        ({"bag": "x.mcap", "rate": "fast"}, "parameter 'rate' must be of type float, not 'fast'"),
    ],
)
def test_what_cannot_be_played_is_an_error_with_a_remedy(capsys: Any, parameters: Any, words: str) -> None:
    before = [(number, signal.getsignal(number)) for number in (signal.SIGINT, signal.SIGTERM)]
    given = [text for name, value in parameters.items() for text in ("-p", f"{name}:={value}")]
    try:
        assert main(["--ros-args", *given]) == 1
    finally:
        for number, handler in before:
            signal.signal(number, handler)
    assert words in capsys.readouterr().err
