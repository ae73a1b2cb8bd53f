"""Recorded measurements: bit for bit from the start and from every later file, through resets and set states; damage."""

import math
import random
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.cli.main import main
from mbd_sim.recordings.run.reader import open_recording
from mbd_sim.recordings.run.verification import verify
from test.recordings.rewriting import rewrite, with_bit_flipped
from test.recordings.runs import stepped_node

FILE = """
mechanism: sensed
ground: {points: {wall: {at: [0, 0, -3]}}}
parameters: {l: 0.5}
parts:
  upper: {mass: 2, center: [0, 0, -l], inertia: [0.1, 0.2, 0.3], points: {end: [0, 0, -l]}}
  lower: {mass: 1, center: [0, 0, -l], inertia: [0.1, 0.1, 0.1], points: {tip: [0, 0, -l]}}
joints:
  shoulder: {type: revolute, between: [ground, upper], axis: [0, -1, 0], position: 80 deg}
  elbow: {type: revolute, between: [upper.end, lower], axis: [0, -1, 0], damping: 0.1}
sensors:
  imu: {type: imu, at: lower.tip, rate: 250 Hz, delay: 7 ms, orientation: {noise_density: 0.1 deg},
        angular_velocity: {noise_density: 0.02, bias_walk: 0.1, resolution: 0.001, limit: 4},
        specific_force: {noise_density: 0.1, bias: 0.2}}
  load: {type: force_torque, joint: elbow, rate: 100 Hz, force: {noise_density: 0.1}}
  encoder: {type: encoder, joint: elbow, counts: 1000, index: 0, drop_out: 0.3}
  tacho: {type: tachometer, joint: shoulder, delay: 40 ms, noise_density: 0.1, drop_out: 0.5}
  floor: {type: range, at: lower, plane: ground.wall, most: 5, rate: 20 Hz, delay: 100 ms}
  odometry: {type: odometry, at: lower.tip, rate: 50 Hz, position: {bias_walk: 1 mm}}
"""
NAMES = ("imu", "load", "encoder", "tacho", "floor", "odometry")


def commanded_run(path):
    sim = Simulation.from_text(FILE, live=["joints.elbow.damping"], wrenches=["lower"])
    sim.step(37)
    with sim.recording(path, rate=100):
        sim.step(60)
        sim.set_efforts({"elbow": 2.0})
        sim.step(33)
        sim.set_wrench("lower", force=(0.0, 0.0, 5.0))
        kept = sim.snapshot()
        sim.step(51)
        sim.set_live({"joints.elbow.damping": 0.3})
        sim.set_state({"elbow": 0.7})
        sim.step(20)
        sim.reset()
        sim.step(47)
        sim.restore(kept)
        sim.step(66)
        sim.restore(sim.state, steps=1000)
        sim.step(70)
        sim.reset(q=[0.3, 0.1], u=[0.0, -1.0])
        for _ in range(120):
            sim.step()
    return sim


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    path = tmp_path_factory.mktemp("run") / "run.mcap"
    commanded_run(path)
    return path


def test_measurements_recompute_bit_for_bit_through_all_that_a_script_does(run):
    (found,) = verify(run)
    assert found.agrees, found
    assert found.tolerance is None
    times = [message.time_ns for message in open_recording(run).messages() if message.topic.endswith("/load")]
    assert found.compared["sensors"] > 500
    assert len(times) > 40
    topics = open_recording(run).topics
    assert {name for name in topics if "/sensors/" in name} == {f"/sim_node/sensors/{name}" for name in NAMES}
    assert topics["/sim_node/sensors/odometry"].type == "nav_msgs/msg/Odometry"


def test_the_recorded_run_is_shown_and_exported_like_others(run, tmp_path):
    assert main(["export", str(run), "--out", str(tmp_path / "run.csv"), "--quiet"]) == 0
    header = (tmp_path / "run.csv").read_text().splitlines()[0]
    assert "shoulder" in header and "elbow" in header


@pytest.mark.parametrize("name", ["imu", "encoder", "odometry"])
def test_a_damaged_measurement_is_found(run, tmp_path, name):
    topic = f"/sim_node/sensors/{name}"
    count = sum(message.topic == topic for message in open_recording(run).messages())
    chance = random.Random(name)
    for number in random.Random(name).sample(range(4), 1):
        chosen, seen = chance.randrange(count), iter(range(count))

        def change(_, message, chosen=chosen, seen=seen, number=number):
            if message.topic != topic or next(seen) != chosen:
                return message
            place = (-1, 4, 9, len(message.payload) // 2)[number]
            return with_bit_flipped(message, place, chance.randrange(8))

        rewrite(run, tmp_path / "damaged.mcap", change)
        (found,) = verify(tmp_path / "damaged.mcap")
        assert not found.agrees
        text = found.failure or found.first.topic
        assert topic in text


def test_a_measurement_at_a_step_without_one_is_found(run, tmp_path):
    topic = "/sim_node/sensors/load"

    def move(number, message):
        if message.topic == topic and message.sequence == 40:
            return replace(message, sequence=41, time_ns=message.time_ns + 1_000_000)
        return message

    rewrite(run, tmp_path / "moved.mcap", move)
    (found,) = verify(tmp_path / "moved.mcap")
    assert "no measurement arrives at this step" in found.failure


def test_other_noise_does_not_verify(run, tmp_path):
    text = open_recording(run).mechanism_text
    other = run.read_bytes().replace(text.encode(), text.replace("bias: 0.2", "bias: 0.3").encode())
    (tmp_path / "other.mcap").write_bytes(other)
    (found,) = verify(tmp_path / "other.mcap")
    assert found.first.name.startswith("specific_force")


def test_with_a_tolerance_a_rounded_value_may_differ_by_one_step(run):
    (found,) = verify(run, tolerance=1e-9)
    assert found.agrees, found


def test_the_files_of_a_node_recompute_each_on_its_own(tmp_path):
    (tmp_path / "sensed.yaml").write_text(FILE)
    with stepped_node(tmp_path, str(tmp_path / "sensed.yaml"), publish_rate=50.0, frame_prefix="robot/") as node:
        thread = node.stepping_thread
        for steps in (113, 1, 46, 29):
            assert thread.step(steps) == ""
            assert node.recordings.split()[0]
            thread.set_state(({"elbow": 0.2}, {}))
        thread.reset()
        assert thread.step(150) == ""
    files = sorted(tmp_path.glob("*.mcap"))
    assert len(files) == 5
    compared = []
    for path in files:
        (found,) = verify(path)
        assert found.agrees, found
        compared.append(found.compared["sensors"])
    assert all(compared)
    recording = open_recording(files[-1])
    imu = next(message for message in recording.messages() if message.topic.endswith("/imu"))
    decoded = recording.decoded(imu)
    assert decoded.header.frame_id == "robot/imu_frame"


def test_the_measurements_of_a_node_are_those_of_a_script(tmp_path):
    (tmp_path / "sensed.yaml").write_text(FILE)
    with stepped_node(tmp_path, str(tmp_path / "sensed.yaml"), live="''") as node:
        node.stepping_thread.step(230)
    (path,) = tmp_path.glob("*.mcap")
    sim = Simulation.from_text(FILE, wrenches=["upper", "lower"])
    with sim.recording(tmp_path / "script.mcap", rate=100):
        sim.step(230)

    def measurements(file):
        return [
            (message.topic, message.sequence, message.payload)
            for message in open_recording(file).messages()
            if "/sensors/" in message.topic
        ]

    node_side, script_side = measurements(path), measurements(tmp_path / "script.mcap")
    assert node_side == script_side
    assert len(node_side) > 300
    loads = [sequence for topic, sequence, _ in node_side if topic.endswith("/load")]
    assert loads == list(range(0, 231, 10))
    floors = [sequence for topic, sequence, _ in node_side if topic.endswith("/floor")]
    assert floors == [100, 150, 200]
    counts = [sequence for topic, sequence, _ in node_side if topic.endswith("/encoder")]
    assert 0.6 < len(counts) / 231 < 0.8 and all(one < other for one, other in pairwise(counts))


def test_a_changed_run_leaves_out_what_it_does_not_compute(run, tmp_path):
    sim = Simulation.from_text(FILE)
    with sim.recording(tmp_path / "full.mcap", violation=True, accelerations=["coordinates"]):
        sim.run(until=0.1)
    out = tmp_path / "changed.mcap"
    arguments = [
        "rerun-with",
        str(tmp_path / "full.mcap"),
        "--set",
        "joints.elbow.damping=0.4",
        "--out",
        str(out),
        "--quiet",
    ]
    assert main(arguments) == 0
    assert {topic.rpartition("/")[2] for topic in open_recording(out).topics} >= {"joint_states", "energies"}
    (found,) = verify(out)
    assert found.agrees, found
    assert math.isfinite(float(np.sum([message.time_ns for message in open_recording(out).messages()])))
