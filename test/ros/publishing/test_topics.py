"""The table of output topics: the node publishes exactly its entries, and the page describes them."""

import re
from pathlib import Path

import pytest
import rclpy

from mbd_sim import load_mechanism
from mbd_sim.recordings.messages import topics
from mbd_sim.recordings.messages.topics import PART, TOPICS, OutputTopic, Recorded, When
from mbd_sim.ros.node.sim_node import SimNode
from mbd_sim.ros.node.sim_parameters import PARAMETERS
from test.system.nodes import new_domain

PAGE = Path(__file__).resolve().parents[3] / "docs" / "node.md"
RCLPY_TOPICS = {"/rosout", "/parameter_events"}


SENSORS = """
sensors:
  imu: {type: imu, at: lower.tip}
  joint_states: {type: tachometer, joint: elbow}
  odometry: {type: odometry, at: lower, rate: 10 Hz}
"""


def published(*parameters):
    """Names and types of the topics of a node in this process."""
    arguments = ["--ros-args", "--log-level", "ERROR", "-p", "record:=false"]
    for parameter in parameters:
        arguments += ["-p", parameter]
    rclpy.init(args=arguments, domain_id=new_domain())
    try:
        node = SimNode(lambda: None)
        found = {each.topic_name: [type_name(each.msg_type)] for each in node.publishers}
        recorded = node.publishing_thread.recorded_topics()
        node.destroy_node()
        return {name: types for name, types in found.items() if name not in RCLPY_TOPICS}, recorded
    finally:
        rclpy.try_shutdown()


def type_name(message_type):
    """The name of a message type.

    The graph is not asked: it may contain a node of this name that has ended, and topics of actions.
    """
    return f"{message_type.__module__.split('.')[0]}/msg/{message_type.__name__}"


def resolved(topic):
    return topic.name.replace("~", "/sim_node") if topic.name[0] in "~/" else f"/{topic.name}"


def test_the_node_publishes_the_topics_without_a_parameter():
    found, recorded = published()
    always = [topic for topic in TOPICS if topic.parameter is None and topic is not topics.SENSORS]
    expected = {resolved(topic): [topic.message_type] for topic in always}
    assert found == expected
    assert {topic.name for topic in recorded.values()} == {
        resolved(topic) for topic in always if topic.recorded is not Recorded.NO
    }


def test_parameters_request_the_other_topics():
    found, recorded = published(
        "energy_values:=true",
        "joint_reactions:=true",
        "contact_states:=true",
        "contact_forces:=true",
        "constraint_violation:=true",
        "part_poses:='*'",
        "accelerations:='coordinates, lower.tip'",
    )
    requested = [topic for topic in TOPICS if topic not in (topics.TF, topics.SENSORS)]
    expected = {resolved(topic): [topic.message_type] for topic in requested if PART not in topic.name}
    poses = {f"/sim_node/poses/{part}": [topics.PART_POSES.message_type] for part in ("upper", "lower")}
    assert found == expected | poses
    assert set(poses) < {topic.name for topic in recorded.values()}
    assert "/energy_values" not in {topic.name for topic in recorded.values()}
    assert all(topic.vital == ("applied" in topic.name or topic.name.endswith(("live_values", "new_states", "events",
               "robot_description"))) for topic in recorded.values())  # fmt: skip


def test_each_sensor_of_the_mechanism_has_a_topic(tmp_path):
    path = tmp_path / "sensed.yaml"
    path.write_text(load_mechanism("double_rod").source.text + SENSORS)
    found, recorded = published(f"mechanism:={path}")
    expected = {
        "/sim_node/sensors/imu": ["sensor_msgs/msg/Imu"],
        "/sim_node/sensors/joint_states": ["sensor_msgs/msg/JointState"],
        "/sim_node/sensors/odometry": ["nav_msgs/msg/Odometry"],
    }
    assert {name: types for name, types in found.items() if "/sensors/" in name} == expected
    assert set(expected) < {topic.name for topic in recorded.values()}


def test_each_entry_is_complete():
    assert len({topic.name for topic in TOPICS}) == len(TOPICS)
    assert [one for one in vars(topics).values() if isinstance(one, OutputTopic) and one not in TOPICS] == []
    for topic in TOPICS:
        assert topic.recorded is not Recorded.EACH_FILE or topic.at_start is not None
        if topic.when is When.EVENT:
            assert topic.on_event is not None
        if topic.when is When.STATE and PART not in topic.name:
            assert topic.on_state is not None
        if topic.parameter is not None:
            assert topic.parameter.name in {spec.name for spec in PARAMETERS}


@pytest.mark.parametrize("topic", TOPICS, ids=lambda topic: topic.name)
def test_the_page_has_a_row_for_each_topic(topic):
    name = topic.name.replace(PART, "<part>")
    rows = [line for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith(f"| `{name}` |")]
    assert len(rows) == 1
    package, _, kind = topic.message_type.split("/")
    assert f"{package}/{kind}" in rows[0]
    if topic.parameter is not None:
        assert f"`{topic.parameter.name}`" in rows[0]
    assert not re.search(r"\bnot recorded\b", rows[0]) or topic.recorded is Recorded.NO
