"""Messages that are serialized without ROS: rclpy and rosbags read the fields that were written."""

import subprocess
import sys

import numpy as np
import pytest
from rclpy.serialization import deserialize_message
from rosbags.typesys import Stores, get_typestore

from mbd_sim import Simulation
from mbd_sim.base.geometry.rotation import from_quaternion
from mbd_sim.recordings.messages import cdr, events, states
from mbd_sim.recordings.messages.cdr import string_message
from mbd_sim.recordings.messages.states import Snapshot
from mbd_sim.ros.publishing.publishers import message_type
from mbd_sim.simulation.run.run_point import joint_state_arrays, joint_state_names
from test.simulation.contact.test_contact_forces import SOFT_BALL

STORE = get_typestore(Stores.ROS2_JAZZY)
TIME_NS = 12_345_678_901
WITHOUT_ROS = """
import sys

class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {"rclpy", "std_msgs", "sensor_msgs", "geometry_msgs", "builtin_interfaces"}:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Blocked())
from mbd_sim.recordings.messages.definitions import definition, type_hash
print(definition("sensor_msgs/msg/JointState"))
print(type_hash("sensor_msgs/msg/JointState"))
"""


@pytest.fixture(scope="module")
def simulation():
    """A closed loop with a drive, some time after its start."""
    found = Simulation.from_file("moving_support_pendulum")
    found.step(40)
    return found


def read(kind, payload):
    """The message as rclpy and as rosbags read it, which have the same fields."""
    return deserialize_message(payload, message_type(kind)), STORE.deserialize_cdr(payload, kind)


def written(simulation, writer):
    snapshot = Snapshot(40, TIME_NS, simulation.time, simulation.snapshot())
    return writer.payload(snapshot, simulation.energies)


def test_energy_values_are_energies_by_name_with_a_stamp(simulation):
    payload = written(simulation, states.energy_values(simulation.model))
    for message in read("sensor_msgs/msg/JointState", payload):
        assert (message.header.stamp.sec, message.header.stamp.nanosec) == divmod(TIME_NS, 10**9)
        assert dict(zip(message.name, message.position, strict=True)) == simulation.energies._asdict()
        assert (len(message.velocity), len(message.effort)) == (0, 0)


def test_joint_states(simulation):
    payload = written(simulation, states.joint_states(simulation.model))
    expected = joint_state_arrays(simulation.model, simulation.time, simulation.y, simulation.inputs)
    for message in read("sensor_msgs/msg/JointState", payload):
        assert (message.header.stamp.sec, message.header.stamp.nanosec) == divmod(TIME_NS, 10**9)
        assert tuple(message.name) == joint_state_names(simulation.model)
        assert [list(values) for values in (message.position, message.velocity, message.effort)] == [
            list(values) for values in expected
        ]
    assert cdr.joint_states(payload).stamp_ns == TIME_NS


def test_contact_states_have_one_sided_elements_and_then_compliant_contacts():
    tie = "constraints: {tie: {type: distance, between: [ground, ball], length: 2, bound: at_most}}\n"
    both = SOFT_BALL.replace("[0, 0.12, 0]", "[0, 0.099, 0]") + tie
    simulation = Simulation.from_text(both)
    simulation.step(5)
    tie, floor = (simulation.contacts()[name] for name in ("tie", "floor"))
    assert (tie.state, floor.state) == ("open", "slides")
    payload = written(simulation, states.contact_states(simulation.model))
    for message in read("sensor_msgs/msg/JointState", payload):
        assert list(message.name) == ["tie", "floor", "floor.friction_1"]
        assert list(message.position) == [tie.gap, floor.gap, 1.0]
        assert list(message.velocity) == [tie.rate, floor.rate, *floor.slip]
        assert list(message.effort) == [tie.normal, floor.normal, *floor.friction]


def test_contact_forces_have_the_points_normals_and_forces_of_all_contacts_with_a_place():
    simulation = Simulation.from_text(SOFT_BALL.replace("[0, 0.12, 0]", "[0, 0.099, 0]"))
    simulation.step(5)
    floor = simulation.contacts()["floor"]
    payload = written(simulation, states.contact_forces(simulation.model, "robot/"))
    for message in read("sensor_msgs/msg/MultiDOFJointState", payload):
        assert message.header.frame_id == "robot/ground"
        assert (list(message.joint_names), len(message.twist)) == (["floor"], 0)
        (transform,), (wrench,) = message.transforms, message.wrench
        assert [getattr(transform.translation, axis) for axis in "xyz"] == floor.point.tolist()
        turned = from_quaternion(np.array([getattr(transform.rotation, axis) for axis in "wxyz"]))
        assert turned[:, 2] == pytest.approx(floor.direction, abs=1e-15)
        assert [getattr(wrench.force, axis) for axis in "xyz"] == floor.force.tolist()
        assert [getattr(wrench.torque, axis) for axis in "xyz"] == [0.0, 0.0, 0.0]


def test_labeled_energies(simulation):
    payload = written(simulation, states.energies(simulation.model))
    for message in read("std_msgs/msg/Float64MultiArray", payload):
        assert [dimension.label for dimension in message.layout.dim] == list(simulation.energies._fields)
        assert [(dimension.size, dimension.stride) for dimension in message.layout.dim] == [(1, 1)] * 7
        assert tuple(message.data) == simulation.energies


def test_joint_reactions(simulation):
    payload = written(simulation, states.joint_reactions(simulation.model, "robot/"))
    reactions = simulation.reactions()
    for message in read("sensor_msgs/msg/MultiDOFJointState", payload):
        assert message.header.frame_id == "robot/ground"
        assert list(message.joint_names) == list(reactions)
        for wrench, reaction in zip(message.wrench, reactions.values(), strict=True):
            assert [wrench.force.x, wrench.force.y, wrench.force.z] == list(reaction.force)
            assert [wrench.torque.x, wrench.torque.y, wrench.torque.z] == list(reaction.moment)


def test_poses_of_parts(simulation):
    name, poses = simulation.model.part_names[-1], states.SharedPoses()
    payload = written(simulation, states.part_pose(simulation.model, "", name, poses))
    for message in read("geometry_msgs/msg/PoseStamped", payload):
        at = message.pose.position
        assert [at.x, at.y, at.z] == list(simulation.poses()[name].position)
        assert message.header.frame_id == "ground"
    quaternion = [getattr(message.pose.orientation, axis) for axis in "xyzw"]
    assert abs(np.linalg.norm(quaternion) - 1.0) < 1e-15


def test_transforms(simulation):
    payload = written(simulation, states.transforms(simulation.model, "robot/"))
    message = STORE.deserialize_cdr(payload, "tf2_msgs/msg/TFMessage")
    assert [t.child_frame_id for t in message.transforms] == [f"robot/{name}" for name in simulation.model.part_names]
    assert [t.header.stamp.nanosec for t in message.transforms] == [TIME_NS % 10**9] * len(simulation.model.part_names)


@pytest.mark.parametrize("text", ["", "a", "µ – four", "x" * 1000])
def test_texts(text):
    for message in read("std_msgs/msg/String", string_message(text)):
        assert message.data == text


def test_live_values(simulation):
    live = {"gravity[2]": -1.62, "joints.elbow.damping": 0.25}
    payload = events.live_values_at_start(simulation.model, live)
    for message in read("std_msgs/msg/Float64MultiArray", payload):
        assert dict(zip([dim.label for dim in message.layout.dim], message.data, strict=True)) == live


def test_definitions_without_ros_name_the_same_type():
    answer = subprocess.run([sys.executable, "-c", WITHOUT_ROS], capture_output=True, text=True, check=True).stdout
    *definition, type_hash = answer.splitlines()
    assert type_hash == STORE.hash_rihs01("sensor_msgs/msg/JointState")
    assert definition[:5] == ["std_msgs/Header header", "string[] name", *(f"float64[] {name}" for name in ("position", "velocity", "effort"))]  # fmt: skip
