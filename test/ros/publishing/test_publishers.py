"""Quality of service as rosbag2 stores it."""

import math

import numpy as np
import pytest
import yaml
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Pose, PoseStamped
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from mbd_sim.recordings.messages.definitions import LATCHED, OfferedQos, offered_qos_profiles, topic_names
from mbd_sim.ros.publishing import publishers
from mbd_sim.ros.publishing.publishers import STAMP, MessageTemplate, slot


def test_a_profile_is_written_in_words():
    (profile,) = yaml.safe_load(offered_qos_profiles(LATCHED))
    assert profile["durability"] == "transient_local"
    assert profile["reliability"] == "reliable"
    assert profile["history"] == "keep_last"
    assert profile["depth"] == 1
    assert profile["deadline"] == {"sec": 9223372036, "nsec": 854775807}
    assert profile["avoid_ros_namespace_conventions"] is False


def test_every_policy_has_its_word():
    offered = OfferedQos(depth=3, reliable=False, keep_all=True)
    (written,) = yaml.safe_load(offered_qos_profiles(offered))
    assert (written["history"], written["reliability"], written["durability"]) == (
        "keep_all",
        "best_effort",
        "volatile",
    )


@pytest.mark.parametrize(
    "offered", [LATCHED, OfferedQos(depth=3), OfferedQos(depth=3, reliable=False, keep_all=True)], ids=str
)
def test_a_recorded_profile_is_offered_again(offered):
    assert publishers.profile_of(offered_qos_profiles(offered)) == publishers.profile(offered)


def test_joint_states_are_the_same_but_for_the_padding():
    """What is between the fields is not defined: rclpy leaves there what was in memory."""
    names = ["a", "elbow_joint", "c"]
    template = MessageTemplate(
        JointState(header=Header(stamp=STAMP), name=names, position=[slot(0), 0.0, 0.0], velocity=[slot(1), 0.0, 0.0])
    )
    position, velocity = template.doubles(0, 3), template.doubles(1, 3)
    position[:], velocity[:] = [1.5, -math.pi, 1e-300], [3.0, np.inf, -0.0]
    template.stamp(12_345_678_901)
    wanted = JointState(
        header=Header(stamp=Time(sec=12, nanosec=345_678_901)),
        name=names,
        position=[1.5, -math.pi, 1e-300],
        velocity=[3.0, np.inf, -0.0],
    )
    found = deserialize_message(template.payload(), JointState)
    assert found == wanted and len(template.payload()) == len(serialize_message(wanted))
    assert np.array(found.velocity).tobytes() == np.array(wanted.velocity).tobytes()  # with the sign of zero


def test_every_stamp_and_every_slot_is_found():
    poses = [
        PoseStamped(header=Header(stamp=STAMP, frame_id=name), pose=Pose(position=Point(x=slot(3)))) for name in "a"
    ]
    template = MessageTemplate(poses[0])
    template.doubles(3, 7)[:] = range(7)
    template.stamp(2_000_000_007)
    message = deserialize_message(template.payload(), PoseStamped)
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (2, 7)
    assert (message.pose.position.x, message.pose.orientation.w) == (0.0, 6.0)


def test_a_mechanism_without_coordinates_has_empty_arrays():
    template = MessageTemplate(JointState(header=Header(stamp=STAMP)))
    assert template.doubles(0, 0).shape == (0,)


def test_topics_are_named_after_parts():
    names = ["rod", "bob-1", "bob.1", "2nd", "a__b", "bob_1"]
    found = topic_names(names)
    assert found == {
        "rod": "rod",
        "bob-1": "bob_1_2",
        "bob.1": "bob_1_3",
        "2nd": "_2nd",
        "a__b": "a_b",
        "bob_1": "bob_1",
    }
