"""Sensors in the file: every mistake has its line, key and remedy; `check` lists them; random sections never crash."""

import numpy as np
import pytest

from mbd_sim import MechanismError, Simulation, load_mechanism, parse_mechanism
from mbd_sim.cli.main import main
from test.files.checks.test_json_schema import MANY_KEYS
from test.generators.changed_sections import changed_files, loaded_or_refused

FILE = """mechanism: sensed
parts:
  rod: {shape: {type: rod, to: [0, 0, 1], mass: 1}, points: {tip: [0, 0, 1]}}
  bob: {mass: 1}
joints:
  pivot: {type: revolute, between: [ground, rod], axis: [0, 1, 0]}
  slide: {type: prismatic, between: [rod.tip, bob], axis: [0, 0, 1]}
sensors:
  one: SENSOR
"""
MISTAKES = {
    "an unknown type": ("{type: gyro, at: rod}", "one.type", "unknown type 'gyro'", "imu"),
    "no type": ("{at: rod}", "one", "'type' is missing", "imu"),
    "an unknown part": ("{type: imu, at: rad}", "one.at", "there is no part 'rad'", "Did you mean 'rod'?"),
    "an unknown point": ("{type: pose, at: rod.tap}", "one.at", "'rod' has no point 'tap'", "Did you mean 'tip'?"),
    "an unknown joint": ("{type: encoder, joint: pivat, counts: 9}", "one.joint", "there is no joint 'pivat'", "'pivot'?"),
    "a coordinate of a simple joint": (
        "{type: tachometer, joint: pivot.x}", "one.joint", "'pivot.x' is not a coordinate", "Name one of pivot.",
    ),
    "a load on another part": (
        "{type: force_torque, joint: slide, at: rod.tip}", "one.at", "'rod.tip' is not on the second part", "Name 'bob'",
    ),
    "an unknown key": ("{type: imu, at: rod, rat: 2}", "one.rat", "unknown key 'rat'", "Did you mean 'rate'?"),
    "an unknown error": (
        "{type: imu, at: rod, angular_velocity: {noise: 3}}", "one.angular_velocity.noise", "unknown key 'noise'", "",
    ),
    "a wrong unit": (
        "{type: imu, at: rod, angular_velocity: {bias: 3 m}}", "one.angular_velocity.bias", "the unit 'm' does not fit: a value in rad/s", "",
    ),
    "a wrong unit of a coordinate": (
        "{type: encoder, joint: pivot, resolution: 3 mm}", "one.resolution", "the unit 'mm' does not fit: a value in rad", "",
    ),
    "a wrong unit of a speed": ("{type: tachometer, joint: slide, bias: 3 deg/s}", "one.bias", "the unit 'deg/s' does not fit: a value in m/s", ""),
    "counts of a slider": (
        "{type: encoder, joint: slide, counts: 9}", "one.counts", "'slide' does not turn", "Give 'resolution' in m",
    ),
    "a resolution in counts": (
        "{type: encoder, joint: pivot, resolution: 4096}", "one.resolution", "4096 rad is more than half a turn", "'counts'",
    ),
    "two resolutions": (
        "{type: encoder, joint: pivot, counts: 9, resolution: 1}", "one", "has resolution and counts", "Give one",
    ),
    "no resolution": ("{type: encoder, joint: pivot}", "one", "has neither resolution nor counts", "Give one of them"),
    "a broken count": ("{type: encoder, joint: pivot, counts: 1.5}", "one.counts", "is 1.5", "Write a whole number"),
    "a rate": ("{type: imu, at: rod, rate: 300}", "one.rate", "the period of 300 Hz is not", "250 Hz or 333.333333333 Hz"),
    "a delay": ("{type: imu, at: rod, delay: 0.3 ms}", "one.delay", "0.0003 s is not a whole", "are 0 s or 0.001 s"),
    "a negative noise": (
        "{type: accelerometer, at: rod, noise_density: -1}", "one.noise_density", "must be at least 0", "Write 0",
    ),
    "a probability": ("{type: imu, at: rod, drop_out: 2}", "one.drop_out", "must be at most 1", "Write 1"),
    "no target": ("{type: range, at: rod, most: 1}", "one", "has neither plane nor point", "Give one of them"),
    "two targets": ("{type: range, at: rod, most: 1, plane: ground, point: bob}", "one", "has plane and point", "Give one"),
    "its own part": ("{type: range, at: rod, most: 1, point: rod.tip}", "one.point", "is on 'rod' like", "another part"),
    "a range upside down": ("{type: range, at: rod, most: 1, least: 2, plane: ground}", "one", "least 2 is not below", "Give a smaller least"),
    "a normal of a point": (
        "{type: range, at: rod, most: 1, point: bob, normal: [1, 0, 0]}", "one", "normal has no effect", "Add 'plane'",
    ),
    "a limit of an orientation": (
        "{type: imu, at: rod, orientation: {limit: 1}}", "one.orientation.limit", "unknown key 'limit'", "",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_named_with_its_line_key_and_remedy(name):
    sensor, key, message, remedy = MISTAKES[name]
    with pytest.raises(MechanismError) as caught:
        parse_mechanism(FILE.replace("SENSOR", sensor), "file.yaml")
    (problem,) = caught.value.problems
    assert (problem.line, problem.key.removesuffix(".type")) == (9, f"sensors.{key}".removesuffix(".type"))
    assert problem.message.startswith(message)
    assert remedy in problem.remedy


def test_a_joint_that_closes_a_loop_can_be_measured():
    text = load_mechanism("four_bar").source.text
    closing = next(iter(load_mechanism("four_bar").closing))
    measured = parse_mechanism(text + f"\nsensors: {{one: {{type: tachometer, joint: {closing}}}}}\n")
    assert measured.joints[closing].splits


def test_orientations_are_not_coordinates_that_can_be_measured():
    text = FILE.replace("revolute", "spherical").replace(", axis: [0, 1, 0]", "", 1)
    with pytest.raises(MechanismError, match="A spherical joint has none; use a 'pose'"):
        parse_mechanism(text.replace("SENSOR", "{type: tachometer, joint: pivot}"))


def test_the_name_of_a_frame_must_not_be_that_of_a_part():
    text = FILE.replace("bob", "one_frame").replace("SENSOR", "{type: imu, at: rod.tip}")
    with pytest.raises(MechanismError, match="its frame would be named like the part 'one_frame'"):
        parse_mechanism(text)


def test_sensors_are_reported_beside_other_mistakes():
    text = FILE.replace("SENSOR", "{type: imu, at: rad}").replace("mass: 1}", "mas: 1}", 1)
    with pytest.raises(MechanismError) as caught:
        parse_mechanism(text)
    assert [problem.line for problem in caught.value.problems] == [3, 9]


def test_values_and_patterns_reach_sensors():
    mechanism = parse_mechanism(FILE.replace("SENSOR", "{type: tachometer, joint: pivot, noise_density: 0.1}"))
    sim = Simulation(mechanism, set={"sensors.one.noise_density": "1 deg/s", "sensor_seed": 4})
    assert sim.mechanism.sensors[0].errors[0].noise_density == pytest.approx(np.pi / 180.0)
    assert sim.mechanism.sensor_seed == 4
    with pytest.raises(MechanismError, match="the equations of motion do not depend on it"):
        Simulation(mechanism, live=["sensors.one.noise_density"])


def test_check_lists_the_sensors(tmp_path, capsys):
    path = tmp_path / "file.yaml"
    sensor = "{type: imu, at: rod.tip, rate: 200 Hz, delay: 2 ms, drop_out: 1 %, angular_velocity: {bias: 1, limit: 4}}"
    path.write_text(FILE.replace("SENSOR", sensor) + "  two: {type: encoder, joint: slide, resolution: 1 mm}\n")
    assert main(["check", str(path)]) == 0
    out = capsys.readouterr().out
    assert (
        "Sensor              one: imu at rod [0, 0, 1], 200 Hz, 0.002 s later, 1 % lost; "
        "angular_velocity bias 1, limit 4 rad/s\n"
        "Sensor              two: encoder at slide, 1000 Hz; position resolution 0.001 m\n"
    ) in out


def test_random_sections_load_or_say_what_is_wrong_and_where():
    lines = MANY_KEYS.replace("  one:\n    mass: 3\n", "  one:\n    mass: 30\n").splitlines()
    section = range(lines.index("sensors:") + 1, len(lines))

    def use(mechanism):
        assert all(np.isfinite(sensor.sampling.delay) for sensor in mechanism.sensors)

    loaded = [loaded_or_refused(one, section, "sensors", use) for one in changed_files(lines, section, 50, seed=14)]
    assert 0 < loaded.count(True) < 30


@pytest.mark.parametrize(
    ("seed", "words"), [("1.5", "is 1.5. Write a whole number"), ("-1", "must be at least 0"), ("x", "unknown name")]
)
def test_a_seed_is_a_whole_number(seed, words):
    with pytest.raises(MechanismError) as caught:
        parse_mechanism(FILE.replace("SENSOR", "{type: imu, at: rod}") + f"sensor_seed: {seed}\n")
    (problem,) = caught.value.problems
    assert words in str(problem)
    assert (problem.line, problem.key) == (10, "sensor_seed")


@pytest.mark.parametrize(
    "sensor",
    [
        "{type: encoder, joint: pivot, counts: n, index: n}",
        "{type: imu, at: rod, rate: n, delay: n, drop_out: n, angular_velocity: {bias: n, limit: n}}",
        "{type: range, at: rod, plane: ground, normal: [n, 0, 1], least: n, most: n}",
    ],
)
def test_a_wrong_parameter_is_reported_once_and_not_at_each_use(sensor):
    text = FILE.replace("SENSOR", sensor) + "parameters: {n: undefined}\nsensor_seed: n\n"
    with pytest.raises(MechanismError) as caught:
        parse_mechanism(text)
    assert [problem.key for problem in caught.value.problems] == ["parameters.n"]
