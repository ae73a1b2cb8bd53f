"""Recorded runs recomputed with a change."""

import re

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.cli.main import main
from mbd_sim.recordings.messages import cdr
from mbd_sim.recordings.run.changed_run import compute_changed_run
from mbd_sim.recordings.run.metadata import RecomputeError
from mbd_sim.recordings.run.reader import open_recording
from mbd_sim.recordings.run.recomputation import Recomputation
from mbd_sim.recordings.run.verification import verify
from test.docs.notebooks import undrawn
from test.recordings.runs import record_run


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return record_run(tmp_path_factory.mktemp("run"), "double_rod", seconds=2.0, seed=1, commands=12)


def changed_run(path, **changes):
    return compute_changed_run(Recomputation(open_recording(path).files[0], **changes))


def test_without_a_change_nothing_deviates(run):
    found = changed_run(run)
    for series in (*found.coordinates.values(), found.energies):
        assert [one.largest_deviation[0] for one in series] == [0.0] * len(series)


def test_a_changed_value_has_the_same_effect_as_editing_the_mechanism_file(tmp_path):
    path = record_run(tmp_path, "double_rod", seconds=0.5, commands=1, seed=1)  # one command, before the first step
    found = changed_run(path, changes={"joints.elbow.damping": 0.2})
    efforts = [
        cdr.multi_array(m.payload).values for m in open_recording(path).messages() if "applied_efforts" in m.topic
    ]
    simulation = Simulation.from_text(open_recording(path).mechanism_text.replace("elbow:", "elbow:\n    damping: 0.2"))
    simulation.set_efforts(efforts[0])
    simulation.step(240)
    elbow = {one.name: one for one in found.coordinates["position"]}["elbow position"]
    at = int(np.flatnonzero(np.isclose(elbow.times, 0.24))[0])
    assert elbow.changed[at] == pytest.approx(simulation.q[1], abs=1e-13)  # of a kernel without wrenches
    assert elbow.recorded[at] != elbow.changed[at]
    size, time = elbow.largest_deviation
    assert size == np.max(np.abs(elbow.recorded - elbow.changed)) and time in elbow.times


def test_another_method_and_step_give_nearly_the_same_motion(run):
    found = changed_run(run, method="rk4", step=0.0005)
    assert found.recomputation.simulation.model.method.name == "rk4"
    assert all(0.0 < one.largest_deviation[0] < 1e-9 for one in found.coordinates["position"])
    coarse = changed_run(run, step=0.002)
    assert all(one.largest_deviation[0] > 0.0 for one in coarse.coordinates["velocity"])


def test_the_file_of_a_changed_run_can_be_verified(run, tmp_path, capsys):
    for number, options in enumerate((["--set", "l=0.9", "--set", "gravity[2]=-1.62"], ["--step", "0.0005"])):
        out = tmp_path / f"{number}.mcap"
        assert main(["rerun-with", str(run), *options, "--out", str(out), "--quiet"]) == 0
        (found,) = verify(out)
        assert found.agrees and found.compared["joint_states"] > 150
        assert found.steps == 2000 * (1 + number)
    printed = capsys.readouterr().out
    assert re.search(
        r"largest deviations\n    elbow position +\S+ rad +t = .*\n    .*\n    elbow velocity +\S+ rad/s +t", printed
    )
    assert re.search(r"\n    residual +\S+ J +t = ", printed)
    assert main(["rerun-with", str(run), "--step", "0.0005", "--out", str(run), "--quiet"]) == 1


UNDEFINED = """
mechanism: undefined
parameters: {l: 1, d: 1/(l - 1.5) + 3}
parts: {mass: {mass: 1}}
joints:
  rail: {type: prismatic, between: [ground, mass], axis: [1, 0, 0], position: 0.6, stiffness: l, damping: d}
"""


def test_a_live_value_may_be_given_where_its_formula_is_not_defined(tmp_path):
    sim = Simulation.from_text(UNDEFINED, live=["l", "d"])
    with sim.recording(tmp_path / "run.mcap"):
        sim.set_live({"d": 2.0})
        sim.run(until=0.1)
        sim.set_live({"l": 1.5})
        sim.run(until=0.2)
    found = changed_run(tmp_path / "run.mcap", changes={"joints.rail.position": 0.7})
    assert found.recomputation.simulation.live == {"l": 1.5, "d": 2.0}


def test_both_runs_are_plotted_and_the_deviations_printed(run, tmp_path, capsys):
    picture = tmp_path / "x.png"
    with undrawn():
        options = ["--set", "joints.elbow.damping=0.2", "--plot", str(picture), "--quiet"]
        assert main(["rerun-with", str(run), *options]) == 0
    assert picture.exists()
    out = capsys.readouterr().out
    assert "with joints.elbow.damping = 0.2" in out and "elbow position" in out and "t = " in out


def test_an_html_page_contains_both_runs_and_its_library(run, tmp_path):
    pytest.importorskip("plotly")
    page = tmp_path / "x.html"
    assert main(["rerun-with", str(run), "--set", "joints.elbow.damping=0.2", "--plot", str(page), "--quiet"]) == 0
    text = page.read_text(encoding="utf-8")
    assert "joints.elbow.damping = 0.2" in text and "elbow velocity" in text and "<script src=" not in text


def test_an_unknown_picture_format_is_an_error(run, tmp_path, capsys):
    path = tmp_path / "x.docx"
    assert main(["rerun-with", str(run), "--set", "l=0.9", "--plot", str(path), "--quiet"]) == 1
    assert "x.docx: this file format is not supported" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ([], "no change is given"),
        (["--set", "joints.elbw.damping=1"], "elbow"),
        (["--set", "damping"], "not of the form KEY=VALUE"),
        (["--method", "rk5"], "there is no method 'rk5'"),
    ],
)
def test_an_invalid_change_is_reported_by_name(run, capsys, options, words):
    assert main(["rerun-with", str(run), *options, "--quiet"]) == 1
    assert words in capsys.readouterr().err


def test_a_recording_without_a_run_is_an_error(tmp_path):
    from mcap.writer import Writer

    with (tmp_path / "x.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        writer.finish()
    with pytest.raises(RecomputeError, match=r"x.mcap: is not a recording of sim_node"):
        changed_run(tmp_path / "x.mcap")


def test_a_changed_parameter_also_changes_live_values_that_follow_it(tmp_path):
    text = """
mechanism: following
parameters: {d: 0.1, k: 2}
parts: {arm: {mass: 1, center: [0, 0, -1]}}
joints: {hip: {type: revolute, between: [ground, arm], axis: [0, 1, 0], position: 1, damping: d, stiffness: k}}
"""
    live = ["parameters.*", "joints.*.damping"]
    simulation = Simulation.from_text(text, live=live)
    with simulation.recording(tmp_path / "run.mcap"):
        simulation.step(200)
        simulation.set_live({"parameters.d": 0.2})
        simulation.step(200)
    for changes, later in (({"d": 5.0}, {}), ({"k": 3.0}, {"parameters.d": 0.2})):
        found = changed_run(tmp_path / "run.mcap", changes=changes).recomputation.simulation
        expected = Simulation.from_text(text, set=changes, live=live)
        expected.step(200)
        expected.set_live(later)
        expected.step(found.steps - 200)
        assert found.q == pytest.approx(expected.q, abs=1e-13)
    (verified,) = verify(tmp_path / "run.mcap")
    assert verified.agrees


def test_states_between_two_steps_are_left_out_and_counted(tmp_path, capsys):
    path = tmp_path / "run.mcap"
    assert main(["run", "double_rod", "--time", "0.2", "--out", str(path), "--quiet"]) == 0
    found = compute_changed_run(Recomputation(open_recording(path).files[0], step=0.003))
    position = found.coordinates["position"][0]
    assert found.left_out == 14 and position.times == pytest.approx(np.arange(7) * 0.03)
    assert 0.0 < position.largest_deviation[0] < 1e-9, "the method is accurate; half a step would be 3e-3"
    assert main(["rerun-with", str(path), "--step", "0.003", "--quiet"]) == 0
    assert "not compared     14 states between two steps of 0.003 s" in capsys.readouterr().out
