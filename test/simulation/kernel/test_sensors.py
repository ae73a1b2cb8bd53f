"""What sensors measure: closed forms, the joints' reactions, sampling, delays, quantization, and reproducible noise."""

import math

import numpy as np
import pytest

from mbd_sim import Ensemble, MechanismError, Simulation, load_mechanism, parse_mechanism
from mbd_sim.base.geometry.rotation import from_quaternion

W, R = 3.0, 0.5
SPIN = f"""
mechanism: spin
ground:
  points: {{wall: {{at: [2, 0, 0], rotate: {{axis: [0, 1, 0], angle: -90 deg}}}}}}
parts:
  rotor:
    mass: 2
    inertia: [0.1, 0.2, 0.3]
    points: {{edge: [{R}, 0, 0], tilted: {{at: [0, {R}, 0], rotate: {{axis: [1, 0, 0], angle: 30 deg}}}}}}
joints:
  spin: {{type: revolute, between: [ground, rotor], axis: [0, 0, 1], velocity: {W}}}
"""
EXACT = """
sensors:
  imu: {type: imu, at: rotor.edge, orientation: {}}
  tilted: {type: accelerometer, at: rotor.tilted}
  wrist: {type: force_torque, joint: spin}
  encoder: {type: encoder, joint: spin, counts: 1024, index: 0.1}
  tachometer: {type: tachometer, joint: spin}
  wall: {type: range, at: rotor, plane: ground.wall, most: 3}
  far: {type: range, at: rotor.edge, point: ground.wall, most: 3}
  pose: {type: pose, at: rotor.tilted}
  twist: {type: twist, at: rotor.edge}
  own_twist: {type: twist, at: rotor.edge, axes: frame}
  odometry: {type: odometry, at: rotor.edge}
"""


def spinning(sensors, **options):
    return Simulation.from_text(SPIN + sensors, **options)


def values(simulation, name):
    return dict(simulation.sensors()[name].values)


def test_an_imu_measures_centripetal_and_specific_force_in_a_spin():
    sim = spinning(EXACT)
    for steps in (0, 200, 333):
        sim.step(steps)
        found = values(sim, "imu")
        np.testing.assert_allclose(found["angular_velocity"], [0.0, 0.0, W], atol=1e-12)
        np.testing.assert_allclose(found["specific_force"], [-(W**2) * R, 0.0, 9.81], atol=1e-12)
        angle = W * sim.time
        quaternion = [math.cos(angle / 2.0), 0.0, 0.0, math.sin(angle / 2.0)]
        np.testing.assert_allclose(found["orientation"] * np.sign(found["orientation"][0]), quaternion, atol=1e-12)
        tilt = from_quaternion(np.array([math.cos(math.pi / 12), math.sin(math.pi / 12), 0.0, 0.0]))
        expected = tilt.T @ [0.0, -(W**2) * R, 9.81]
        np.testing.assert_allclose(values(sim, "tilted")["specific_force"], expected, atol=1e-12)


def test_an_imu_at_rest_reads_minus_gravity_and_in_free_fall_nothing():
    text = "\nsensors: {imu: {type: imu, at: rotor.tilted}}"
    sim = spinning(text)
    sim.reset(u=[0.0])
    tilt = math.radians(30.0)
    expected = [0.0, 9.81 * math.sin(tilt), 9.81 * math.cos(tilt)]
    np.testing.assert_allclose(values(sim, "imu")["specific_force"], expected, atol=1e-12)
    free = SPIN.replace("type: revolute", "type: free").replace(f", axis: [0, 0, 1], velocity: {W}", "")
    falling = Simulation.from_text(free + text)
    falling.step(100)
    np.testing.assert_allclose(values(falling, "imu")["specific_force"], 0.0, atol=1e-12)


def test_pose_twist_and_odometry_are_the_motion_of_the_point():
    sim = spinning(EXACT)
    sim.step(137)
    edge, tilted = sim.motion("rotor.edge"), sim.motion("rotor.tilted")
    pose, odometry = values(sim, "pose"), values(sim, "odometry")
    np.testing.assert_allclose(pose["position"], tilted.pose.position, atol=1e-15)
    np.testing.assert_allclose(from_quaternion(pose["orientation"]), tilted.pose.rotation, atol=1e-15)
    np.testing.assert_allclose(values(sim, "twist")["velocity"], edge.velocity, atol=1e-14)
    np.testing.assert_allclose(values(sim, "twist")["angular_velocity"], [0.0, 0.0, W], atol=1e-14)
    own = values(sim, "own_twist")
    np.testing.assert_allclose(own["velocity"], edge.pose.rotation.T @ edge.velocity, atol=1e-14)
    np.testing.assert_allclose(odometry["position"], edge.pose.position, atol=1e-15)
    np.testing.assert_array_equal(odometry["velocity"], own["velocity"])
    np.testing.assert_array_equal(odometry["angular_velocity"], own["angular_velocity"])


def test_range_finders_measure_along_their_beam_or_to_a_point():
    sim = spinning(EXACT)
    for _ in range(4):
        angle = W * sim.time
        expected = 2.0 / math.cos(angle) if math.cos(angle) > 0.0 and 2.0 / math.cos(angle) <= 3.0 else math.inf
        assert values(sim, "wall")["distance"][0] == pytest.approx(expected, abs=1e-12)
        far = math.hypot(2.0 - R * math.cos(angle), R * math.sin(angle))
        assert values(sim, "far")["distance"][0] == pytest.approx(far, abs=1e-12)
        sim.step(250)
    near = spinning("\nsensors: {near: {type: range, at: rotor, plane: ground.wall, least: 2.5, most: 3}}")
    assert values(near, "near")["distance"][0] == -math.inf


def test_an_encoder_counts_whole_steps_and_marks_its_index_in_each_turn():
    sim = spinning(EXACT)
    step, pulses = 2.0 * math.pi / 1024, 0
    index = math.floor(0.1 / step)
    for _ in range(300):
        sim.step()
        found = values(sim, "encoder")
        count = math.floor(sim.q[0] / step)
        assert found["position"][0] == count * step
        assert found["index"][0] == float(count % 1024 == index)
        pulses += found["index"][0]
        assert values(sim, "tachometer")["velocity"].tolist() == sim.u.tolist()
    assert pulses in range(2, 4)  # a turn, and a step lasts 2 or 3 ms


@pytest.mark.parametrize("name", ["double_rod", "four_bar"])
def test_force_and_torque_are_the_reactions_in_the_axes_of_the_joint(name):
    """Of the last joint, which closes the loop if there is one."""
    plain = load_mechanism(name)
    joint = list(plain.all_joints)[-1]
    sim = Simulation.from_text(f"{plain.source.text}\nsensors: {{wrist: {{type: force_torque, joint: {joint}}}}}\n")
    sim.step(40)
    reaction, sensor = sim.reactions()[joint], sim.mechanism.sensors[0]
    rotation = sensor.at.pose.rotation
    if sensor.at.part != "ground":
        rotation = sim.poses()[sensor.at.part].rotation @ rotation
    found = values(sim, "wrist")
    size = 1.0 + np.linalg.norm(reaction.force) + np.linalg.norm(reaction.moment)
    np.testing.assert_allclose(found["force"], rotation.T @ reaction.force, atol=1e-12 * size)
    np.testing.assert_allclose(found["torque"], rotation.T @ reaction.moment, atol=1e-12 * size)


def test_sensors_see_the_forces_of_contacts():
    text = """
mechanism: resting_ball
parts: {ball: {shape: {type: sphere, radius: 0.1, mass: 2}}}
joints: {flight: {type: free, between: [ground, ball], position: [0, 0, 0.1]}}
contacts: {floor: {parts: [ball], plane: ground}}
sensors: {imu: {type: imu, at: ball}}
"""
    sim = Simulation.from_text(text)
    sim.step(10)
    np.testing.assert_allclose(values(sim, "imu")["specific_force"], [0.0, 0.0, 9.81], atol=1e-12)
    sim.reset(q=[0.0, 0.0, 0.15, 1.0, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(values(sim, "imu")["specific_force"], 0.0, atol=1e-12)


def test_sensors_do_not_change_the_motion_or_the_kernel():
    sim, plain = spinning(EXACT), spinning("")
    for steps in (1, 10, 137):
        sim.step(steps)
        plain.step(steps)
    assert sim.state.tolist() == plain.state.tolist()
    assert str(sim.model.equations.rates) == str(plain.model.equations.rates)


SAMPLED = """
sensors:
  slow: {type: tachometer, joint: spin, rate: 100 Hz}
  late: {type: encoder, joint: spin, resolution: 1e-9 rad, delay: 3 ms}
  slow_late: {type: pose, at: rotor, rate: 250 Hz, delay: 10 ms, position: {noise_density: 1 mm}}
  lost: {type: accelerometer, at: rotor, drop_out: 0.4}
"""


def test_rates_and_delays_are_whole_steps_and_exact():
    sim = spinning(SAMPLED)
    assert set(sim.sensors()) == {"slow", "lost"} or set(sim.sensors()) == {"slow"}
    assert sim.arrivals[0].sensor == 0
    previous = -1.0
    for step in range(1, 80):
        sim.step()
        found = sim.sensors()
        assert found["slow"].time == pytest.approx(step // 10 * 0.01, abs=1e-15)
        if step >= 3:
            assert found["late"].time == (step - 3) * sim.step_size
            assert found["late"]["position"][0] == pytest.approx(W * (step - 3) * 1e-3, abs=2e-9)
        if step >= 10:
            assert found["slow_late"].time == (step - 10) // 4 * 4 * sim.step_size
            assert found["slow_late"].sample == (step - 10) // 4
        assert ("slow_late" in found) == (step >= 10)
        if "lost" in found:
            assert found["lost"].time >= previous
            previous = found["lost"].time
        arriving = {sim.sensor_model.sensors[number].name for number, _ in sim.arrivals}
        assert ("slow" in arriving) == (step % 10 == 0)
        assert ("slow_late" in arriving) == (step >= 10 and (step - 10) % 4 == 0)
        assert ("lost" in arriving) == (found.get("lost") is not None and found["lost"].sample == step)
    lost = sum(sim.sensor_model.noises[3].is_lost(sample) for sample in range(80))
    assert 16 <= lost <= 48


def readings(simulation, steps):
    """All measurements of a run, step by step."""
    found = []
    for count in steps:
        simulation.step(count)
        found.append({
            name: (one.time, one.sample, [value.tolist() for value in one.values.values()])
            for name, one in simulation.sensors().items()
        })  # fmt: skip
    return found


def test_measurements_are_the_same_in_any_division_of_the_run_and_from_a_snapshot():
    one, other = spinning(SAMPLED), spinning(SAMPLED)
    first = readings(one, [1] * 60)
    assert readings(other, [7, 3, 13, 1, 36]) == [first[index] for index in (6, 9, 22, 23, 59)]
    kept = one.snapshot()
    after = readings(one, [1] * 30)
    third = spinning(SAMPLED)
    third.restore(kept)
    assert readings(third, [1] * 30) == after
    one.reset()
    assert readings(one, [1] * 60) == first


def test_the_seed_selects_other_noise():
    text = "\nsensors: {tachometer: {type: tachometer, joint: spin, noise_density: 0.01 rad/s, bias_walk: 0.02}}"
    one, same, other = spinning(text), spinning(text), spinning(text, set={"sensor_seed": 3})
    first, again, different = ([found["tachometer"][2] for found in readings(s, [1] * 5)] for s in (one, same, other))
    assert first == again != different


def test_a_restored_state_alone_forgets_measurements_under_way():
    sim = spinning(SAMPLED)
    sim.step(50)
    state = sim.state
    sim.restore(state, steps=20)
    assert "slow_late" not in sim.sensors()
    assert sim.sensors()["slow"].time == 0.02
    sim.step(10)
    assert sim.sensors()["slow_late"].time == 0.02


def test_a_set_state_is_measured_in_place_of_the_one_before():
    sim = spinning(
        "\nsensors: {tachometer: {type: tachometer, joint: spin}, late: {type: tachometer, joint: spin, delay: 1 ms}}"
    )
    sim.step(5)
    sim.set_state(velocities={"spin": -1.0})
    assert values(sim, "tachometer")["velocity"][0] == -1.0
    assert values(sim, "late")["velocity"][0] == pytest.approx(W)
    sim.step()
    assert values(sim, "late")["velocity"][0] == -1.0


def test_live_values_move_sensors_with_their_points():
    text = SPIN.replace("mechanism: spin", "mechanism: spin\nparameters: {r: 0.5}").replace(f"edge: [{R}", "edge: [r")
    sim = Simulation.from_text(text + "\nsensors: {imu: {type: imu, at: rotor.edge}}", live=["r"])
    sim.set_live({"r": 1.5})
    sim.step()
    np.testing.assert_allclose(values(sim, "imu")["specific_force"], [-(W**2) * 1.5, 0.0, 9.81], atol=1e-12)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ("rate: 300 Hz", "the period of 300 Hz is not a whole number of steps of 0.001 s. The nearest rates are 250 Hz or 333.333333333 Hz."),
        ("rate: 2 kHz", "2000 Hz is more than one measurement for each step of 0.001 s. Write at most 1000 Hz, or"),
        ("delay: 1.5 ms", "0.0015 s is not a whole number of steps of 0.001 s. The nearest delays are 0.001 s or 0.002 s."),
    ],
)  # fmt: skip
def test_times_that_are_no_whole_steps_are_refused_with_the_nearest(keys, words):
    text = f"\nsensors: {{imu: {{type: imu, at: rotor, {keys}}}}}"
    with pytest.raises(MechanismError) as caught:
        spinning(text)
    assert words in str(caught.value)
    assert caught.value.problems[0].key == f"sensors.imu.{keys.partition(':')[0]}"
    spinning("\nsensors: {imu: {type: imu, at: rotor, rate: 100 Hz, delay: 2 ms}}", step=5e-4)
    with pytest.raises(MechanismError, match=r"sensors\.imu\.rate: the period of 100 Hz is not .* of 0\.003 s"):
        spinning("\nsensors: {imu: {type: imu, at: rotor, rate: 100 Hz}}", step=3e-3)


def test_ensembles_have_no_sensors_and_say_so():
    members = Ensemble(parse_mechanism(SPIN + EXACT), 2)
    members.step(3)
    with pytest.raises(NotImplementedError, match="Use a Simulation for each"):
        members.sensors()


DRIVEN = """
actuators:
  motor:
    type: dc_motor
    joint: spin
    torque_constant: 0.05
    resistance: 1.2
    inductance: 2 mH
    gear_ratio: 5
    rotor_inertia: 2e-5
    servo: {controls: velocity, kp: 2, ki: 20, sample_rate: 100 Hz}
sensors:
  current: {type: current, actuator: motor}
  coarse: {type: current, actuator: motor, resolution: 10 mA, limit: 2 A, rate: 100 Hz}
  imu: {type: imu, at: rotor.edge}
"""


def test_the_current_of_a_motor_and_accelerations_under_actuators():
    sim = spinning(DRIVEN)
    sim.set_commands({"motor": 8.0})
    for _ in range(30):
        sim.step()
        state, found = sim.actuators()["motor"], sim.sensors()
        assert found["current"]["current"][0] == pytest.approx(state.current, rel=1e-13)
        rates = sim.model.equations.rates.call([sim.time, sim.state, sim.inputs])[0]
        assert sim.u_rates[0] == pytest.approx(float(rates[1]), rel=1e-12)
        np.testing.assert_allclose(found["imu"]["specific_force"][1], sim.u_rates[0] * R, atol=1e-12)
    coarse = sim.sensors()["coarse"]["current"][0]
    assert coarse in (2.0, -2.0) or coarse == pytest.approx(round(coarse / 0.01) * 0.01, abs=1e-12)
    assert abs(sim.u_rates[0]) > 0.1


@pytest.mark.parametrize(
    ("actuator", "words"),
    [
        ("moter", "there is no actuator 'moter'. Did you mean 'motor'?"),
        ("push", "'push' has no current. Name an actuator"),
    ],
)
def test_a_current_needs_a_motor(actuator, words):
    text = DRIVEN.replace("sensors:", "  push: {type: effort, joint: spin}\nsensors:").replace(
        "actuator: motor}", f"actuator: {actuator}}}"
    )
    with pytest.raises(MechanismError) as caught:
        spinning(text)
    assert words in str(caught.value)
