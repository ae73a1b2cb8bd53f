"""Messages of sensors: rclpy and rosbags read what was written, and frames are those of the exported URDF."""

import xml.etree.ElementTree as ElementTree
from typing import get_args

import numpy as np
import pytest
from rclpy.serialization import deserialize_message
from rosbags.typesys import Stores, get_typestore

from mbd_sim import Simulation
from mbd_sim.files.urdf.writer import to_urdf
from mbd_sim.mechanism.elements.sensors import AnySensor
from mbd_sim.recordings.messages.topics import SensorSerializer
from mbd_sim.ros.publishing.publishers import message_type

STORE = get_typestore(Stores.ROS2_JAZZY)
TIME_NS = 12_345_678_901
FILE = """
mechanism: sensed
ground: {points: {wall: {at: [2, 0, 0], rotate: {axis: [0, 1, 0], angle: -90 deg}}}}
parts:
  rod: {mass: 2, inertia: [0.1, 0.2, 0.3], points: {tip: {at: [0.5, 0, 0], rotate: {rpy: [0.1, 0.2, 0.3]}}}}
joints:
  hinge: {type: revolute, between: [ground, rod], axis: [0, 1, 0], velocity: 2}
actuators: {motor: {type: dc_motor, joint: hinge, torque_constant: 1, resistance: 2, command: {voltage: 3}}}
sensors:
  current: {type: current, actuator: motor}
  imu: {type: imu, at: rod.tip, delay: 3 ms, orientation: {noise_density: 1 deg}, angular_velocity: {noise_density: 0.1}}
  plain_imu: {type: imu, at: rod}
  acc: {type: accelerometer, at: rod.tip, noise_density: 0.2}
  load: {type: force_torque, joint: hinge}
  encoder: {type: encoder, joint: hinge, counts: 64, index: 0}
  counter: {type: encoder, joint: hinge, counts: 64}
  tacho: {type: tachometer, joint: hinge}
  wall: {type: range, at: rod, plane: ground.wall, least: 0.5, most: 4, field_of_view: 0.1, radiation: ultrasound,
         noise_density: 1 mm}
  pose: {type: pose, at: rod.tip}
  twist: {type: twist, at: rod.tip}
  own_twist: {type: twist, at: rod.tip, axes: frame}
  odometry: {type: odometry, at: rod, position: {noise_density: 0.1}, velocity: {noise_density: 0.3}}
"""


@pytest.fixture(scope="module")
def simulation():
    found = Simulation.from_text(FILE)
    found.step(40)
    return found


@pytest.fixture(scope="module")
def read(simulation):
    """The message of a sensor as rclpy and as rosbags read it."""
    messages = SensorSerializer(simulation.model, simulation.step_size, "robot/")
    numbers = {sensor.name: number for number, sensor in enumerate(simulation.mechanism.sensors)}
    arrivals = {arrival.sensor: arrival for arrival in simulation.arrivals}

    def decoded(name):
        number = numbers[name]
        (measured,) = messages.measured([arrivals[number]], TIME_NS)
        assert measured.sensor == name
        payload = measured.payload
        kind = simulation.mechanism.sensors[number].message_type
        return deserialize_message(payload, message_type(kind)), STORE.deserialize_cdr(payload, kind)

    return decoded


def test_every_kind_is_among_these_messages(simulation):
    assert {type(sensor) for sensor in simulation.mechanism.sensors} == set(get_args(AnySensor))


def xyz(vector):
    return [vector.x, vector.y, vector.z]


def wxyz(quaternion):
    return [quaternion.w, *xyz(quaternion)]


def test_imu(simulation, read):
    reading = simulation.sensors()["imu"]
    for message in read("imu"):
        stamp = message.header.stamp
        assert stamp.sec * 10**9 + stamp.nanosec == TIME_NS - 3_000_000
        assert message.header.frame_id == "robot/imu_frame"
        assert xyz(message.angular_velocity) == reading["angular_velocity"].tolist()
        assert xyz(message.linear_acceleration) == reading["specific_force"].tolist()
        assert wxyz(message.orientation) == reading["orientation"].tolist()
        np.testing.assert_allclose(message.angular_velocity_covariance, np.diag([10.0] * 3).ravel(), rtol=1e-12)
        variance = np.radians(1.0) ** 2 * 1000.0
        np.testing.assert_allclose(message.orientation_covariance, np.diag([variance] * 3).ravel(), rtol=1e-12)
        assert not np.any(message.linear_acceleration_covariance)
    for message in read("plain_imu"):
        assert message.orientation_covariance[0] == -1.0
        assert message.header.frame_id == "robot/rod"


def test_accelerometer(simulation, read):
    for message in read("acc"):
        assert xyz(message.linear_acceleration) == simulation.sensors()["acc"]["specific_force"].tolist()
        assert message.orientation_covariance[0] == message.angular_velocity_covariance[0] == -1.0
        np.testing.assert_allclose(message.linear_acceleration_covariance, np.diag([40.0] * 3).ravel(), rtol=1e-12)


def test_force_and_torque(simulation, read):
    reading = simulation.sensors()["load"]
    for message in read("load"):
        assert message.header.frame_id == "robot/rod"
        assert xyz(message.wrench.force) == reading["force"].tolist()
        assert xyz(message.wrench.torque) == reading["torque"].tolist()


def test_encoder_and_tachometer(simulation, read):
    reading = simulation.sensors()["encoder"]
    for message in read("encoder"):
        assert list(message.name) == ["hinge", "hinge.index"]
        assert list(message.position) == [reading["position"][0], reading["index"][0]]
        assert (len(message.velocity), len(message.effort)) == (0, 0)
    for message in read("counter"):
        assert list(message.name) == ["hinge"]
        assert list(message.position) == [reading["position"][0]]
    for message in read("tacho"):
        assert list(message.velocity) == simulation.u.tolist()
        assert (len(message.position), len(message.effort)) == (0, 0)


def test_current(simulation, read):
    for message in read("current"):
        assert list(message.name) == ["motor"]
        assert list(message.effort) == simulation.sensors()["current"]["current"].tolist()
        assert message.effort[0] == pytest.approx(simulation.actuators()["motor"].current)
        assert (len(message.position), len(message.velocity)) == (0, 0)


def test_range(simulation, read):
    for message in read("wall"):
        assert message.radiation_type == 0
        assert message.range == np.float32(simulation.sensors()["wall"]["distance"][0])
        known = (message.field_of_view, message.min_range, message.max_range, message.variance)
        np.testing.assert_allclose(known, (0.1, 0.5, 4.0, 1e-3), rtol=1e-6)


def test_pose_twist_and_odometry(simulation, read):
    motion, found = simulation.motion("rod.tip"), simulation.sensors()
    for message in read("pose"):
        assert message.header.frame_id == "robot/ground"
        assert xyz(message.pose.position) == found["pose"]["position"].tolist()
        assert wxyz(message.pose.orientation) == found["pose"]["orientation"].tolist()
    for message in read("twist"):
        assert message.header.frame_id == "robot/ground"
        np.testing.assert_allclose(xyz(message.twist.linear), motion.velocity, atol=1e-14)
    for message in read("own_twist"):
        assert message.header.frame_id == "robot/own_twist_frame"
        np.testing.assert_allclose(xyz(message.twist.linear), motion.pose.rotation.T @ motion.velocity, atol=1e-14)
    for message in read("odometry"):
        assert (message.header.frame_id, message.child_frame_id) == ("robot/ground", "robot/rod")
        assert xyz(message.pose.pose.position) == found["odometry"]["position"].tolist()
        assert wxyz(message.pose.pose.orientation) == found["odometry"]["orientation"].tolist()
        assert xyz(message.twist.twist.linear) == found["odometry"]["velocity"].tolist()
        assert xyz(message.twist.twist.angular) == found["odometry"]["angular_velocity"].tolist()
        np.testing.assert_allclose(np.diag(message.pose.covariance.reshape(6, 6)), [10.0] * 3 + [0.0] * 3, rtol=1e-12)
        np.testing.assert_allclose(np.diag(message.twist.covariance.reshape(6, 6)), [90.0] * 3 + [0.0] * 3, rtol=1e-12)


def test_the_urdf_has_the_frames_of_the_sensors(simulation):
    robot = ElementTree.fromstring(to_urdf(simulation.mechanism))
    links = {link.attrib["name"] for link in robot.findall("link")}
    assert links == {"ground", "rod", "imu_frame", "acc_frame", "own_twist_frame", "pose_frame", "twist_frame"}
    joint = next(joint for joint in robot.findall("joint") if joint.find("child").attrib["link"] == "imu_frame")
    assert joint.attrib["type"] == "fixed"
    assert joint.find("parent").attrib["link"] == "rod"
    assert joint.find("origin").attrib["xyz"] == "0.5 0.0 0.0"
    np.testing.assert_allclose(np.array(joint.find("origin").attrib["rpy"].split(), float), [0.1, 0.2, 0.3], atol=1e-15)
