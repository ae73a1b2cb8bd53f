"""Sensors over DDS: what another process receives is what a simulation of the same file measures, to the last bit."""

import numpy as np
import pytest
from geometry_msgs.msg import WrenchStamped
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Imu, JointState, Range

from mbd_sim import load_mechanism, parse_mechanism
from mbd_sim.recordings.run.reader import open_recording
from mbd_sim.recordings.run.verification import verify
from test.system.nodes import Listener, SimNodeProcess, as_in_the_node, nanoseconds, new_domain

SENSORS = """
sensors:
  imu: {type: imu, at: lower.tip, rate: 250 Hz, delay: 4 ms, angular_velocity: {noise_density: 0.01, bias_walk: 0.1}}
  load: {type: force_torque, joint: elbow, rate: 100 Hz, force: {noise_density: 0.1, resolution: 0.01}}
  encoder: {type: encoder, joint: shoulder, counts: 4096, drop_out: 0.2}
  floor: {type: range, at: lower, plane: ground, most: 20, rate: 50 Hz, noise_density: 1 mm}
"""
TYPES = {"imu": Imu, "load": WrenchStamped, "encoder": JointState, "floor": Range}
STEPS, AT_ONCE = 200, 8  # of which a sensor of any rate publishes fewer messages than its publisher keeps


def numbers(message):
    """The numbers of a message that a sensor measures."""
    match message:
        case Imu():
            vectors = message.angular_velocity, message.linear_acceleration
        case WrenchStamped():
            vectors = message.wrench.force, message.wrench.torque
        case JointState():
            return list(message.position)
        case Range():
            return [message.range]
    return [number for vector in vectors for number in (vector.x, vector.y, vector.z)]


@pytest.fixture(scope="module")
def expected():
    """The measurements of a run, by sensor and time stamp in ns: each with the number of steps before its arrival."""
    sim = as_in_the_node(parse_mechanism(load_mechanism("double_rod").source.text + SENSORS + "sensor_seed: 7\n"))
    found = {name: {} for name in TYPES}
    for _ in range(STEPS):
        for number, sample in sim.arrivals:
            name = sim.sensor_model.sensors[number].name
            reading = sim.sensor_model.reading(number, sample)
            values = [value for quantity in reading.values.values() for value in quantity.tolist()]
            found[name][round(reading.time * 1e9)] = sim.steps, values
        sim.step()
    return found


def test_another_process_receives_the_measurements_of_a_simulation(tmp_path, expected):
    path = tmp_path / "sensed.yaml"
    path.write_text(load_mechanism("double_rod").source.text + SENSORS)
    domain = new_domain()
    parameters = {"mechanism": path, "start_paused": True, "step_count": AT_ONCE, "sensor_seed": 7, "record": True}
    node, listener = SimNodeProcess(domain, tmp_path, parameters), Listener(domain)
    profiles = {"reliable": 1000, "sensor data": qos_profile_sensor_data}
    received = {(name, profile): {} for name in TYPES for profile in profiles}
    try:
        for (name, profile), messages in received.items():

            def take(message, messages=messages):
                messages[nanoseconds(message.header.stamp)] = numbers(message)

            topic = f"sim_node/sensors/{name}"
            listener.node.create_subscription(TYPES[name], topic, take, profiles[profile])
        listener.all_matched()
        for steps in range(AT_ONCE, STEPS, AT_ONCE):
            due = {(name, time) for name in TYPES for time, (tick, _) in expected[name].items() if 0 < tick <= steps}
            assert listener.step().success
            listener.until(
                lambda due=due: all(time in received[name, "reliable"] for name, time in due), "measurements"
            )
        assert node.end() == 0
    finally:
        listener.close()
        node.kill()
    for (name, profile), messages in received.items():
        assert messages
        for time, measured in messages.items():
            _, exact = expected[name][time]
            assert measured == (np.float32(exact).tolist() if name == "floor" else exact), (name, time, profile)
    (recorded,) = (tmp_path / "recordings").glob("*.mcap")
    assert "sensor_seed: 7" in (open_recording(recorded).mechanism_text or "")
    (verification,) = verify(recorded)
    assert verification.is_intact and verification.agrees, verification.first
