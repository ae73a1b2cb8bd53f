"""Runs of a script, recorded without ROS: other readers open the files, and they recompute bit for bit."""

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from mbd_sim import DivergedError, InputError, Simulation
from mbd_sim.recordings.run.paths import RecordingError
from mbd_sim.recordings.run.reader import open_recording
from mbd_sim.recordings.run.run_recorder import RunRecorder
from mbd_sim.recordings.run.verification import verify
from mbd_sim.recordings.views.table import read_table
from mbd_sim.simulation.run.events import EventKind


def verified(path):
    """The verification of the only file, which agrees bit for bit."""
    (found,) = verify(path)
    assert found.agrees, found
    assert found.tolerance is None
    assert not found.problem
    return found


def commanded_run(path, **options):
    """A run with all that a script can do to a simulation."""
    sim = Simulation.from_file("double_rod", wrenches=["lower"], live=["gravity[2]", "joints.*.damping"])
    sim.step(17)
    with sim.recording(path, **options) as recorder:
        sim.run(until=0.2)
        sim.set_efforts({"elbow": 2.0})
        sim.step(33)
        sim.set_wrench("lower", force=(0.0, 0.0, 5.0), at="tip", axes="part")
        sim.step(50)
        sim.set_live({"joints.elbow.damping": 0.3, "gravity[2]": -1.62})
        kept = sim.snapshot()
        sim.step(101)
        sim.reset()
        sim.step(20)
        sim.restore(kept)
        sim.step(7)
        sim.reset(q=[0.3, 0.1], u=[0.0, -1.0])
        sim.set_efforts([0.5, 0.5])
        for _ in range(25):
            sim.step()
    return sim, recorder


def test_everything_that_a_script_does_recomputes_bit_for_bit(tmp_path):
    sim, recorder = commanded_run(tmp_path / "run.mcap")
    found = verified(tmp_path / "run.mcap")
    assert found.steps == 183 + 33 + 50 + 101 + 20 + 7 + 25
    assert found.commands == {
        "applied_efforts": 2, "applied_wrenches": 1, "live_values": 1, "new_states": 2, "resets": 2,
    }  # fmt: skip
    assert found.compared["joint_states"] == found.compared["energies"] == recorder.states
    table = read_table(open_recording(tmp_path / "run.mcap"))
    assert list(table.position[-1]) == list(sim.q)
    assert table.times[0] == 0.017


@pytest.mark.parametrize(("name", "has_contacts"), [("double_rod", False), ("bounce", True)])
def test_states_of_contacts_are_recorded_where_there_are_any(tmp_path, name, has_contacts):
    """A topic whose messages are all empty, or contacts without one."""
    with Simulation.from_file(name).recording(tmp_path / "run.mcap") as recorder:
        pass
    topics = open_recording(recorder.path).topics
    assert ("/contact_states" in topics) == has_contacts and "/contact_forces" not in topics


def test_a_damaged_command_is_found(tmp_path):
    sim = Simulation.from_file("double_rod")
    with sim.recording(tmp_path / "run.mcap"):
        sim.step(10)
        sim._memory.inputs[0] = 1e-9  # without a report
        sim.step(10)
    (found,) = verify(tmp_path / "run.mcap")
    assert not found.agrees


def test_commands_that_change_nothing_are_not_recorded(tmp_path):
    """As in a node: the first command of a file as well, and the same ones after a reset."""
    sim = Simulation.from_file("double_rod", wrenches=["lower"])
    sim.set_efforts([0.0, 1.0])
    with sim.recording(tmp_path / "run.mcap"):
        for efforts in ([0.0, 1.0], [0.0, 1.0], [0.0, 2.0], {"elbow": 2.0}):
            sim.set_efforts(efforts)
            sim.set_wrench("lower")
            sim.step(5)
        for _ in range(2):
            sim.set_wrench("lower", force=(0.0, 0.0, 1.0))
            sim.step(5)
        sim.reset()
        for efforts in ([0.0, 0.0], [0.0, 2.0], [0.0, 2.0]):
            sim.set_efforts(efforts)
            sim.set_wrench("lower")
            sim.step(5)
    found = verified(tmp_path / "run.mcap").commands
    assert found == {"applied_efforts": 2, "applied_wrenches": 1, "resets": 1}


def test_the_run_is_the_same_as_without_a_recording(tmp_path):
    plain, recorded = (Simulation.from_file("double_rod") for _ in range(2))
    with recorded.recording(tmp_path / "run.mcap", rate=333.0):
        for sim in (plain, recorded):
            sim.step(7)
            sim.set_efforts([0.0, 1.0])
            sim.run(until=0.5)
    assert recorded.state.tobytes() == plain.state.tobytes()
    assert recorded.steps == plain.steps == 500
    recorded.step()  # not recorded any more
    assert len(read_table(open_recording(tmp_path / "run.mcap"))) == 1 + 166 + 1


def test_rosbags_reads_all_topics(tmp_path):
    commanded_run(tmp_path / "run.mcap", reactions=True, violation=True, poses=["*"])
    with AnyReader([tmp_path / "run.mcap"], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        kinds = {connection.topic: connection.msgtype for connection in reader.connections}
        last = {c.topic: reader.deserialize(raw, c.msgtype) for c, _, raw in reader.messages()}
    assert kinds["/joint_states"] == "sensor_msgs/msg/JointState"
    assert {"/joint_reactions", "/constraint_violation", "/sim_node/poses/upper", "/sim_node/poses/lower"} < set(last)
    assert len(last["/joint_reactions"].wrench) == 2
    assert last["/robot_description"].data.startswith("<?xml")
    assert [dim.size for dim in last["/sim_node/new_states"].layout.dim][:4] == [1, 1, 7, 2 + 15 + 3]


def test_states_are_recorded_at_the_rate(tmp_path):
    sim = Simulation.from_file("double_rod")
    with sim.recording(tmp_path / "run.mcap", rate=300.0):
        sim.step(100)
    table = read_table(open_recording(tmp_path / "run.mcap"))
    assert list(table.steps[:7]) == [0, 4, 7, 10, 14, 17, 20]
    assert table.steps[-1] == 100


def test_a_step_that_was_obtained_before_is_counted(tmp_path):
    sim = Simulation.from_file("double_rod")
    step = sim.step
    with sim.recording(tmp_path / "run.mcap"):
        step(13)
        sim.set_efforts([0.0, 1.0])
        step(20)
    assert verified(tmp_path / "run.mcap").steps == 33


def test_a_divergence_ends_the_run_and_is_recorded(tmp_path):
    sim = Simulation.from_file("double_rod")
    with pytest.raises(DivergedError), sim.recording(tmp_path / "run.mcap"):
        sim.run(until=0.053)
        sim.set_efforts({"elbow": 1e300})
        sim.run(until=5.0)
    assert np.all(np.isfinite(sim.state))
    found = verified(tmp_path / "run.mcap")
    assert found.steps == sim.steps
    (_, text), *_ = read_table(open_recording(tmp_path / "run.mcap")).events
    assert text.startswith(f"{EventKind.WARNING}: ")


def test_changed_values_are_recorded_with_the_run(tmp_path):
    sim = Simulation.from_file("double_rod", set={"l": np.float64(0.8), "joints.elbow.position": "30 deg"})
    assert sim.mechanism.parameters["l"] == 0.8
    assert sim.q[1] == np.deg2rad(30.0)
    with sim.recording(tmp_path / "run.mcap"):
        sim.step(50)
    verified(tmp_path / "run.mcap")


def test_a_value_that_does_not_exist_is_refused():
    with pytest.raises(Exception, match=r"joints\.elbo.*Did you mean 'elbow'"):
        Simulation.from_file("double_rod", set={"joints.elbo.damping": 1.0})


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("run.bag", {}, r"run\.bag: a run is recorded to an \.mcap file"),
        ("no/run.mcap", {}, "there is no folder"),
        ("run.mcap", {"rate": 5000.0}, r"5000 Hz cannot be recorded.*up to 1000 Hz"),
        ("run.mcap", {"rate": 0.0}, "0 Hz cannot be recorded"),
        ("run.mcap", {"poses": ["uper"]}, "there is no part 'uper'.*upper"),
    ],
)
def test_what_cannot_be_recorded_is_refused(tmp_path, name, options, message):
    sim = Simulation.from_file("double_rod")
    with pytest.raises(InputError, match=message):
        sim.recording(tmp_path / name, **options)
    assert not list(tmp_path.iterdir())
    sim.recording(tmp_path / "run.mcap").close()


def test_one_recording_at_a_time(tmp_path):
    sim = Simulation.from_file("double_rod")
    with sim.recording(tmp_path / "one.mcap"), pytest.raises(InputError, match="recorded already"):
        RunRecorder(sim, tmp_path / "two.mcap")
    assert not (tmp_path / "two.mcap").exists()


def test_a_full_disk_ends_the_recording_but_not_the_simulation(tmp_path, monkeypatch):
    sim = Simulation.from_file("double_rod")
    recorder = sim.recording(tmp_path / "run.mcap")
    sim.step(100)
    monkeypatch.setattr(recorder._writer._file, "free", lambda: 1000)
    monkeypatch.setattr(recorder, "_flushed", 0.0)
    with pytest.raises(RecordingError, match="disk"):
        sim.step(100)
    sim.step(100)
    recorder.close()
    assert sim.steps == 210
    assert verified(tmp_path / "run.mcap").steps == 110


def test_a_subclass_with_its_own_step_is_recorded(tmp_path):
    class Counting(Simulation):
        calls = 0

        def step(self, n=1):
            self.calls += 1
            super().step(n)

    sim = Counting.from_file("double_rod")
    with sim.recording(tmp_path / "run.mcap"):
        sim.step(30)
    sim.step()
    assert sim.calls == 2
    assert verified(tmp_path / "run.mcap").steps == 30


def test_single_names_may_be_given_by_themselves(tmp_path):
    sim = Simulation.from_file("double_rod")
    for name, options in (("one", {"poses": "lower"}), ("all", {"poses": "*", "accelerations": "coordinates"})):
        sim.recording(tmp_path / f"{name}.mcap", **options).close()
    one, every = (set(open_recording(tmp_path / f"{name}.mcap").topics) for name in ("one", "all"))
    poses = {topic for topic in every if "poses" in topic}
    assert len(poses) == 2 and poses & one == {topic for topic in poses if topic.endswith("lower")}
    assert any("accelerations" in topic for topic in every)
