"""Verification of recorded runs by recomputing them."""

import json
import math
import random
from dataclasses import replace

import numpy as np
import pytest
from mcap.reader import make_reader

from mbd_sim.cli.main import main
from mbd_sim.cli.runs.verify import verify_text
from mbd_sim.recordings.messages import cdr
from mbd_sim.recordings.messages.cdr import RUN_METADATA
from mbd_sim.recordings.run.metadata import RecomputeError
from mbd_sim.recordings.run.reader import open_recording
from mbd_sim.recordings.run.recomputation import Recomputation
from mbd_sim.recordings.run.verification import environment_differences, verify
from test.recordings.rewriting import rewrite, with_bit_flipped
from test.recordings.runs import ACTIONS, drive, record_run, stepped_node

# States with loops, quaternions, drives and friction, each by another family of methods.
KINDS = {"four_bar": "dop853", "moving_support_pendulum": "rk4", "tumbling": "gauss4", "stick_slip": "rosenbrock"}


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Two seconds of a double rod with commands of all kinds, without a reset."""
    return record_run(tmp_path_factory.mktemp("run"), "double_rod", seconds=2.0, seed=3, commands=12, resets=False)


def only(path, **options):
    (found,) = verify(path, **options)
    return found


@pytest.mark.parametrize("name", KINDS)
def test_a_run_under_random_commands_is_recomputed_bit_for_bit(name, tmp_path):
    path = record_run(tmp_path, name, seconds=0.5, seed=len(name), method=KINDS[name], constraint_violation=True)
    found = only(path)
    assert found.agrees and found.tolerance is None, verify_text(found)
    assert found.method == KINDS[name]
    assert found.compared["joint_states"] == found.compared["energies"] == found.compared["constraint_violation"] > 20
    assert sum(found.commands.values()) >= 3
    assert found.steps * found.step == pytest.approx(0.5, abs=0.1)


def test_a_truncated_file_is_verified_up_to_its_end(run, tmp_path):
    data, whole = rewrite(run, tmp_path / "x.mcap").read_bytes(), only(run)
    for fraction in (0.3, 0.5):
        path = tmp_path / "cut.mcap"
        path.write_bytes(data[: int(fraction * len(data))])
        found = only(path)
        assert found.agrees and "cut off" in found.problem, verify_text(found)
        assert 0 < found.compared["joint_states"] < whole.compared["joint_states"]


def test_a_flipped_bit_in_a_recorded_state_is_reported(run, tmp_path):
    recording = open_recording(run)
    states = [(n, m) for n, m in enumerate(recording.messages()) if m.topic == "/joint_states"]
    number, message = states[57]
    for place, name in ((-56, "elbow position"), (-40, "shoulder velocity"), (-8, "elbow effort")):
        path = rewrite(run, tmp_path / "x.mcap", lambda n, m, p=place: with_bit_flipped(m, p, 0) if n == number else m)
        found = only(path)
        assert (found.first.topic, found.first.name, found.first.tick) == ("/joint_states", name, message.sequence)
        assert found.first.time == pytest.approx(message.time_ns * 1e-9)
        wrong = np.concatenate(cdr.joint_states(with_bit_flipped(message, place, 0).payload)[3:])
        right = np.concatenate(cdr.joint_states(message.payload)[3:])
        (at,) = np.flatnonzero(wrong != right)
        assert (found.first.recorded, found.first.computed) == (wrong[at], right[at])
        assert found.differing == 1 and "this record is damaged" in verify_text(found)


def test_a_flipped_bit_in_an_energy_a_stamp_or_a_name_is_reported(run, tmp_path):
    numbers = {}
    for number, message in enumerate(open_recording(run).messages()):
        numbers.setdefault(message.topic, []).append(number)
    for topic, place, words in (
        ("/energies", -8, "residual"),
        ("/energies", -56, "kinetic"),
        ("/joint_states", 8, "stamp"),
        ("/joint_states", 30, "names of the joints"),
    ):
        flipped = numbers[topic][20]
        path = rewrite(
            run, tmp_path / "x.mcap", lambda n, m, f=flipped, p=place: with_bit_flipped(m, p, 0) if n == f else m
        )
        found = only(path)
        assert (found.first.topic, found.first.name, found.differing) == (topic, words, 1)


def test_a_flipped_bit_in_a_recorded_command_is_reported(run, tmp_path):
    recording = open_recording(run)
    commands = [(n, m) for n, m in enumerate(recording.messages()) if m.topic.endswith("applied_efforts")]
    number, message = commands[1]
    path = rewrite(run, tmp_path / "x.mcap", lambda n, m: with_bit_flipped(m, -8, 0) if n == number else m)
    found = only(path)
    assert not found.agrees and found.first.tick > message.sequence
    text = verify_text(found)
    assert "likely cause     an earlier command: " in text
    assert f"/sim_node/applied_efforts at step {message.sequence}" in text
    assert "elbow" in found.first.name and found.differing > 1
    assert found.largest.size >= found.first.size


def test_a_live_value_that_contradicts_its_event_is_reported(run, tmp_path):
    numbers = [n for n, m in enumerate(open_recording(run).messages()) if m.topic.endswith("live_values")]
    path = rewrite(run, tmp_path / "x.mcap", lambda n, m: with_bit_flipped(m, -8, 0) if n == numbers[1] else m)
    found = only(path)
    assert not found.agrees and found.first.topic == "live_values"


def test_a_missing_command_and_a_wrong_step_are_detected(run, tmp_path):
    recording = open_recording(run)
    commands = [n for n, m in enumerate(recording.messages()) if m.topic.endswith("applied_efforts")]
    found = only(rewrite(run, tmp_path / "x.mcap", lambda n, m: None if n == commands[0] else m))
    assert not found.agrees
    moved = only(
        rewrite(run, tmp_path / "y.mcap", lambda n, m: replace(m, sequence=m.sequence + 1) if n == commands[0] else m)
    )
    assert moved.first.name == "time of the step" and moved.first.topic == "/sim_node/applied_efforts"


def test_a_flipped_bit_in_the_file_itself_is_detected(run, tmp_path):
    data = bytearray(run.read_bytes())
    with run.open("rb") as stream:
        chunk = max(make_reader(stream).get_summary().chunk_indexes, key=lambda index: index.chunk_length)
    data[chunk.chunk_start_offset + chunk.chunk_length // 2] ^= 4
    path = tmp_path / "x.mcap"
    path.write_bytes(data)
    found = only(path)
    assert not found.agrees and "damaged" in found.failure + found.problem, verify_text(found)


def test_another_start_or_method_in_the_metadata_is_detected(run, tmp_path):
    about = open_recording(run).about
    start = json.loads(about["start"])
    start[0] = math.nextafter(float.fromhex(start[0]), 9.0).hex()
    found = only(rewrite(run, tmp_path / "x.mcap", about={"start": json.dumps(start)}))
    assert (found.first.name, found.first.tick) == ("shoulder position", 0)
    other = only(rewrite(run, tmp_path / "y.mcap", about={"method": "rk4"}))
    assert not other.agrees and other.first.tick > 0


def test_a_recording_of_another_version_is_compared_to_a_tolerance_if_bits_differ(run, tmp_path):
    path = rewrite(run, tmp_path / "x.mcap", about={"casadi": "3.1", "processor": "other"})
    found = only(path)
    assert found.agrees and found.tolerance is None and found.differing == 0
    text, compared = verify_text(found), found.compared
    assert "casadi 3.1, here" in text and "processor other, here" in text and "verified, bit for bit" in text
    number = [n for n, m in enumerate(open_recording(run).messages()) if m.topic == "/joint_states"][80]
    small = rewrite(path, tmp_path / "y.mcap", lambda n, m: with_bit_flipped(m, -56, 0) if n == number else m)
    found = only(small)
    assert found.agrees and found.tolerance == 1e-9
    assert found.compared == compared and "verified, to 1e-09" in verify_text(found)
    large = rewrite(path, tmp_path / "z.mcap", lambda n, m: with_bit_flipped(m, -51, 4) if n == number else m)
    assert only(large).first.name == "elbow position"


def test_a_recording_made_with_earlier_equations_says_so(run, tmp_path):
    """Recordings without an entry were made with the first ones; the rounding errors of the present ones differ."""
    found = only(rewrite(run, tmp_path / "x.mcap", about={"equations": "1"}))
    assert found.agrees and found.environment_differences == ["equations 1, here 2"]
    recorded = open_recording(run).files[0].metadata[RUN_METADATA]
    assert environment_differences(recorded, recorded) == []
    earlier = {key: value for key, value in recorded.items() if key != "equations"}
    assert environment_differences(earlier, recorded) == ["equations 1, here 2"]


@pytest.mark.parametrize("name", ["tumbling", "four_bar"])
def test_with_a_tolerance_each_interval_starts_from_the_recorded_state(name, tmp_path):
    found = only(record_run(tmp_path, name, seconds=0.5, seed=1, method=KINDS[name]), tolerance=1e-11)
    assert found.agrees, verify_text(found)


def test_a_recording_started_in_the_middle_of_a_run_is_verified(run, tmp_path):
    recording = open_recording(run)
    tick = next(m.sequence for m in recording.messages() if m.topic.endswith("applied_efforts")) + 7
    recomputation = Recomputation(recording.files[0])
    for message in recording.messages():
        if message.sequence > tick:
            break
        recomputation.advance(message.sequence)
        recomputation.apply(message)
    recomputation.advance(tick)
    simulation = recomputation.simulation

    def exact(values):
        return json.dumps([value.hex() for value in values.tolist()])

    about = {
        "start": exact(simulation.y), "inputs": exact(simulation.inputs), "first_tick": str(tick), "first_clock": str(tick * 1_000_000),
        "first_step": str(simulation.steps), "history": exact(simulation.history), "start_energy": float(simulation.start_energy).hex(),
        "live": json.dumps({name: value.hex() for name, value in simulation.live.items()}),
    }  # fmt: skip
    assert any(simulation.inputs[:2]), "an effort is applied at that tick"
    path = rewrite(run, tmp_path / "x.mcap", lambda n, m: m if m.sequence > tick else None, about=about)
    found = only(path)
    assert found.agrees and found.compared["joint_states"] > 100, verify_text(found)
    assert found.steps == 2000 - tick


@pytest.mark.parametrize(("name", "form"), [("double_rod", "mcap"), ("moving_support_pendulum", "rosbag2")])
def test_recordings_started_and_split_during_a_run_are_each_verified_alone(name, form, tmp_path):
    chance = random.Random(5)
    with stepped_node(tmp_path, name, record=False, record_format=form) as node:
        recordings = node.publishing_thread.recordings
        for order in (recordings.start, recordings.split, recordings.stop, recordings.start):
            drive(node, 0.5, 6, chance, ACTIONS)
            done, answer = order()
            assert done, answer
        drive(node, 0.5, 6, chance, ACTIONS)
    found = [one for path in sorted(tmp_path.iterdir()) for one in verify(path)]
    assert len(found) == 3 and all(one.agrees for one in found), "\n".join(map(verify_text, found))
    assert all(one.compared["joint_states"] > 40 and one.commands for one in found)


def test_metadata_that_prevents_recomputation_is_reported(run, tmp_path):
    for about, words in (
        ({"start": "[]"}, "its metadata does not fit its mechanism"),
        ({"start": "[1]"}, "its metadata 'mbd_sim' cannot be read"),
        ({"first_tick": "x"}, "its metadata 'mbd_sim' cannot be read"),
        ({"parameters": "{x"}, "its metadata 'mbd_sim' cannot be read"),
        ({"parameters": "[]"}, "its metadata 'mbd_sim' cannot be read"),
        ({"wrenches": '["nothing"]'}, "there is no part 'nothing'"),
    ):
        path = rewrite(run, tmp_path / "x.mcap", about=about)
        with pytest.raises(RecomputeError, match=words):
            verify(path)


def test_the_verify_command_reports_its_result(run, tmp_path, capsys):
    assert main(["verify", str(run), "--quiet"]) == 0
    out = capsys.readouterr().out
    assert "verified, bit for bit" in out and "× real time" in out and "2000 steps, 2 s simulated" in out
    path = rewrite(run, tmp_path / "x.mcap", lambda n, m: with_bit_flipped(m, -8, 0) if n == 99 else m)
    assert main(["verify", str(run), str(path), "--quiet"]) == 1
    assert "x.mcap: DIFFERS from step" in capsys.readouterr().out
    assert main(["verify", str(tmp_path / "none.mcap"), "--quiet"]) == 1
    assert "none.mcap: there is no such file" in capsys.readouterr().err
