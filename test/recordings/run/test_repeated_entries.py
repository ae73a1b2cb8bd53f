"""Recordings of mechanisms with functions and repeated entries: recomputed, split, changed, and made by a script."""

import random
from pathlib import Path

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.cli.main import main
from mbd_sim.files.checks.override import with_values
from mbd_sim.files.load import load_mechanism
from mbd_sim.recordings.run.changed_run import compute_changed_run
from mbd_sim.recordings.run.reader import open_recording
from mbd_sim.recordings.run.recomputation import Recomputation
from mbd_sim.recordings.run.verification import verify
from test.recordings.runs import ACTIONS, drive, stepped_node

CHAIN = """mechanism: chain
parameters: {n: 3, l: 40 cm, w: 4 rad/s, m: 0.3 kg}

functions:
  taper(i): 1 - i/(2*n)
  rock(t, phase): 0.35*sin(w*t + phase)

parts:
  handle: {mass: 0}
  link_{i}:
    for: {i: 1..n}
    shape: {type: rod, to: [0, 0, -l*taper(i)], mass: m*taper(i)}
    points: {tip: [0, 0, -l*taper(i)]}

joints:
  wrist: {type: revolute, between: [ground, handle], axis: [0, -1, 0], drive: "rock(t, 0)"}
  pin_1: {type: revolute, between: [handle, link_1], axis: [0, -1, 0]}
  pin_{i}:
    for: {i: 2..n}
    type: revolute
    between: ["link_{i-1}.tip", "link_{i}"]
    axis: [0, -1, 0]
    damping: 0.01*i
"""


@pytest.fixture(scope="module")
def chain(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("mechanism") / "chain.yaml"
    path.write_text(CHAIN)
    return path


@pytest.fixture(scope="module")
def files(chain, tmp_path_factory) -> list[Path]:
    """A run with commands, wrenches, live values and resets, in two files, the second begun in the middle."""
    folder, chance = tmp_path_factory.mktemp("run"), random.Random(12)
    with stepped_node(folder, str(chain)) as node:
        assert {"parameters.w", "joints.pin_3.damping"} <= set(node.simulation.live)
        drive(node, 0.5, 10, chance, ACTIONS)
        node.stepping_thread.set_live({"joints.pin_2.damping": 0.1})
        node.commands.by_order([0.0, 0.1, -0.1])
        done, answer = node.publishing_thread.recordings.split()
        assert done, answer
        drive(node, 0.5, 10, chance, ACTIONS)
    return sorted(folder.iterdir())


def test_both_files_of_a_split_recording_are_verified(files):
    found = [one for path in files for one in verify(path)]
    assert len(found) == 2
    for one in found:
        assert one.agrees and one.steps == 500 and one.compared["joint_states"] > 40 and one.commands
    assert all(open_recording(path).mechanism_text == CHAIN for path in files)


def test_a_changed_live_value_is_that_of_one_entry(chain, files, tmp_path, capsys):
    out = tmp_path / "damped.mcap"
    changes = ["--set", "joints.pin_3.damping=0.2", "--set", "l=0.5"]
    assert main(["rerun-with", str(files[0]), *changes, "--out", str(out), "--quiet"]) == 0
    assert "with joints.pin_3.damping = 0.2" in capsys.readouterr().out
    assert [one.agrees for one in verify(out)] == [True]
    mechanism = Recomputation(open_recording(out).files[0]).simulation.mechanism
    expected = with_values(load_mechanism(chain), {"joints.pin_3.damping": 0.2, "l": 0.5})
    assert {name: joint.damping.tolist() for name, joint in mechanism.joints.items()} == {
        name: joint.damping.tolist() for name, joint in expected.joints.items()
    }
    assert mechanism.parts["link_3"].mass == expected.parts["link_3"].mass


def test_a_parameter_of_a_function_changes_all_of_its_calls(chain, tmp_path):
    sim = Simulation.from_file(chain)
    with sim.recording(tmp_path / "run.mcap", rate=100.0):
        sim.run(until=0.5)
    (found,) = verify(tmp_path / "run.mcap")
    assert found.agrees and found.steps == 500
    run = compute_changed_run(Recomputation(open_recording(tmp_path / "run.mcap").files[0], changes={"w": 5.0}))
    faster = Simulation.from_file(chain, set={"w": 5.0})
    faster.run(until=0.5)
    last = [one.changed[-1] for one in run.coordinates["position"] if one.name != "wrist position"]
    np.testing.assert_allclose(last, faster.q, rtol=0.0, atol=1e-13)


def test_another_number_of_entries_is_another_mechanism(files, capsys):
    assert main(["rerun-with", str(files[0]), "--set", "n=4", "--quiet"]) == 1
    error = capsys.readouterr().err
    assert "other coordinates ('pin_4' is added)" in error and "mbd_sim run" in error
    assert main(["rerun-with", str(files[0]), "--set", "n=2", "--quiet"]) == 1
    assert "other coordinates ('pin_3' is missing)" in capsys.readouterr().err
