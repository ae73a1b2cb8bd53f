"""A ring of the last seconds: how much it keeps, when it is written, and that what it writes is a recording."""

import numpy as np
import pytest

from mbd_sim import InputError, Simulation
from mbd_sim.cli.main import main
from mbd_sim.recordings.run.reader import open_recording
from mbd_sim.recordings.run.ring import RingRecorder
from mbd_sim.recordings.views.table import read_table


def times(path):
    return read_table(open_recording(path)).times


@pytest.mark.parametrize("until", [0.3, 1.0, 1.7, 2.0])
def test_at_least_the_last_seconds_are_written_and_at_most_twice_as_many(tmp_path, until):
    sim = Simulation.from_file("double_rod")
    with RingRecorder(sim, tmp_path / "end.mcap", 0.5) as ring:
        for _ in range(7):
            sim.run(until=sim.time + until / 7)
    every = np.concatenate([times(path) for path in ring.written])
    assert every[-1] == pytest.approx(sim.time)
    assert min(0.5, until) - 1e-9 <= every[-1] - every[0] <= 1.0 + 1e-9
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(path.name for path in ring.written)
    assert main(["verify", "--quiet", *map(str, ring.written)]) == 0


def test_a_condition_ends_the_recording_and_not_the_run(tmp_path):
    sim = Simulation.from_file("double_rod")
    with RingRecorder(sim, tmp_path / "fast.mcap", 0.2, when="abs(elbow.velocity) > 3", after=0.1) as ring:
        sim.run(until=2.0)
    assert sim.time == pytest.approx(2.0) and not ring.is_recording
    table = read_table(open_recording(ring.written[-1]))
    speed = np.abs(table.velocity[:, table.names.index("elbow")])
    event = float(ring.cause.rpartition("t = ")[2].removesuffix(" s"))
    assert table.times[-1] == pytest.approx(event + 0.1)
    assert np.interp(event, table.times, speed) == pytest.approx(3.0, abs=0.05)
    assert np.all(np.concatenate([times(path) for path in ring.written]) <= event + 0.1 + 1e-9)


def test_without_its_event_nothing_is_written(tmp_path):
    sim = Simulation.from_file("double_rod")
    with RingRecorder(sim, tmp_path / "never.mcap", 0.2, when="t > 100") as ring:
        sim.run(until=0.5)
    assert ring.written == () and not list(tmp_path.iterdir())
    with RingRecorder(sim, tmp_path / "asked.mcap", 0.2, when="t > 100") as ring:
        sim.run(until=0.6)
        assert ring.write() and ring.cause == "request"
        sim.run(until=0.7)
    assert times(ring.written[-1])[-1] == pytest.approx(0.6)


def test_an_impact_is_an_event(tmp_path):
    sim = Simulation.from_file("bounce")
    with RingRecorder(sim, tmp_path / "hit.mcap", 0.2, when="impact", after=0.05) as ring:
        sim.run(until=1.0)
    assert "impact at 0.4515" in ring.cause
    assert times(ring.written[-1])[-1] == pytest.approx(0.4515 + 0.05, abs=2e-3)


def test_wrong_conditions_and_options_are_refused(tmp_path, capsys):
    sim = Simulation.from_file("double_rod")
    for when, message in (("elbw > 1", "Did you mean .elbow."), ("elbow >", "not a number")):
        with pytest.raises(InputError, match=message):
            RingRecorder(sim, tmp_path / "a.mcap", 1.0, when=when)
    assert not list(tmp_path.iterdir())
    sim.run(until=0.01)  # nobody listens any more
    assert main(["run", "double_rod", "--when", "impact", "--out", str(tmp_path / "a.mcap")]) == 1
    assert "Give --last too" in capsys.readouterr().err
