"""Quality of service as rosbag2 stores it."""

import pytest
import yaml

from mbd_sim.recordings.messages.definitions import LATCHED, OfferedQos, offered_qos_profiles
from mbd_sim.ros.publishing import publishers


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
