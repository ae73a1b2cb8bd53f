"""Message definitions and type hashes read from the installed packages."""

import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from mbd_sim.recordings.messages.definitions import definition, type_hash


@pytest.mark.parametrize(
    "kind", ["sensor_msgs/msg/JointState", "std_msgs/msg/Float64MultiArray", "rosgraph_msgs/msg/Clock"]
)
def test_a_definition_is_complete_and_equals_the_type_in_ros(kind):
    store = get_typestore(Stores.ROS2_JAZZY)
    parsed = get_types_from_msg(definition(kind), kind)
    assert kind in parsed
    for name, fields in parsed.items():
        assert [field for field, _ in fields[1]] == [field for field, _ in store.fielddefs[name][1]]


def test_the_type_hash_equals_that_of_the_installed_type():
    store = get_typestore(Stores.ROS2_JAZZY)
    assert type_hash("sensor_msgs/msg/JointState") == store.hash_rihs01("sensor_msgs/msg/JointState")
    assert type_hash("std_msgs/msg/Nothing") == ""
