"""Recordings of runs with contacts recompute bit for bit, also from the middle of a run."""

import pytest

from mbd_sim import Simulation
from mbd_sim.cli.main import main


@pytest.mark.parametrize(("name", "set_", "end"), [
    ("belt", {}, 3.0),
    ("bounce", {"e": 0.97}, 4.0),
    ("detent", {}, 0.6),  # whose slots have features, which the second recording must begin with
])  # fmt: skip
def test_a_recording_with_events_verifies_from_its_start_and_from_the_middle(tmp_path, capsys, name, set_, end):
    sim = Simulation.from_file(name, set=set_)
    with sim.recording(tmp_path / "first.mcap"):
        sim.run(until=0.43 * end)
    with sim.recording(tmp_path / "second.mcap"):
        sim.run(until=end)
    for part in ("first", "second"):
        assert main(["verify", str(tmp_path / f"{part}.mcap")]) == 0
        assert "verified, bit for bit" in capsys.readouterr().out
    assert len(sim.contact_events) > 3


def test_commands_at_a_contact_are_recomputed(tmp_path, capsys):
    sim = Simulation.from_file("belt", live=["parameters.muk"])
    with sim.recording(tmp_path / "run.mcap"):
        for index in range(40):
            sim.step(50)
            sim.set_efforts([30.0 if index % 7 == 3 else 0.0])
            if index == 20:
                sim.set_live({"parameters.muk": 0.1})
    assert main(["verify", str(tmp_path / "run.mcap")]) == 0
    assert "verified, bit for bit" in capsys.readouterr().out


def test_a_changed_run_finds_its_own_contacts(tmp_path, capsys):
    sim = Simulation.from_file("bounce")
    sim.run(until=0.5)
    with sim.recording(tmp_path / "run.mcap"):
        sim.run(until=2.0)
    assert main(["rerun-with", str(tmp_path / "run.mcap"), "--set", "e=0.5"]) == 0
