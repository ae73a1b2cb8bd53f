"""Quality of service as rosbag2 stores it."""

import yaml
from rclpy.qos import QoSDurabilityPolicy, QoSHistoryPolicy, QoSProfile, QoSReliabilityPolicy

from mbd_sim.ros.qos import LATCHED, offered_qos_profiles


def test_a_profile_is_written_in_words():
    (profile,) = yaml.safe_load(offered_qos_profiles(LATCHED))
    assert profile["durability"] == "transient_local"
    assert profile["reliability"] == "reliable"
    assert profile["history"] == "keep_last"
    assert profile["depth"] == 1
    assert profile["deadline"] == {"sec": 9223372036, "nsec": 854775807}
    assert profile["avoid_ros_namespace_conventions"] is False


def test_every_policy_has_its_word():
    profile = QoSProfile(
        history=QoSHistoryPolicy.KEEP_ALL,
        reliability=QoSReliabilityPolicy.BEST_EFFORT,
        durability=QoSDurabilityPolicy.VOLATILE,
    )
    (written,) = yaml.safe_load(offered_qos_profiles(profile))
    assert (written["history"], written["reliability"], written["durability"]) == (
        "keep_all",
        "best_effort",
        "volatile",
    )
