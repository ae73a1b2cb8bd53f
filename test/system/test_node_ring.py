"""The last seconds of a node's run: written on request, after an event and at the end; how much, and that it verifies."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from std_srvs.srv import Trigger

from mbd_sim.recordings.run.reader import open_recording
from mbd_sim.recordings.views.table import read_table
from test.system.growing_recordings import verified
from test.system.nodes import Listener, refusal, running


def written(listener: Listener, count: int) -> list[str]:
    """What the node says of each recording, once there are so many."""

    def said() -> list[str]:
        return [text for text in listener.events if "recorded the last" in text]

    listener.until(lambda: len(said()) >= count, f"{count} recordings")
    return said()


def test_the_last_seconds_are_written_on_request_after_an_event_and_at_the_end(tmp_path: Path) -> None:
    options = {"start_paused": True, "step_count": 900, "record_dir": "run", "record_last": 0.4}
    event = {"record_when": "'abs(elbow.velocity) > 3'", "record_after": 0.1}
    with running(tmp_path, **options, **event) as (process, listener):
        assert listener.step().success
        (text,) = written(listener, 1)
        assert "abs(elbow.velocity) > 3 at t = " in text
        answer = listener.call(Trigger, "record_last")
        assert answer.success
        _, requested = written(listener, 2)
        assert requested.endswith(": request")
        assert process.end() == 0
    after_event, on_request = sorted((tmp_path / "run").iterdir())  # none at the end: there is a condition
    for path, said in ((after_event, text), (on_request, requested)):
        assert path.name in said
        verified(path)
        times = read_table(open_recording(path)).times
        assert 0.4 - 0.011 <= times[-1] - times[0] <= 0.5 + 0.011, "a state each 0.01 s"
    table = read_table(open_recording(after_event))
    begin = float(text.rpartition("t = ")[2].removesuffix(" s"))
    assert begin + 0.09 - 1e-9 <= table.times[-1] <= begin + 0.1 + 1e-9
    speed = np.abs(table.velocity[:, table.names.index("elbow")])
    assert np.interp(begin, table.times, speed) == pytest.approx(3.0, abs=0.05)
    assert read_table(open_recording(on_request)).times[-1] == pytest.approx(0.9, abs=0.01)


def test_each_impact_is_an_event_unless_it_follows_within_the_time_that_is_kept(tmp_path: Path) -> None:
    options = {"mechanism": "bounce", "start_paused": True, "step_count": 3000, "record_dir": "run"}
    ring = {"record_last": 0.3, "record_when": "impact", "record_format": "rosbag2"}
    with running(tmp_path, **ring, **options) as (process, listener):
        assert listener.step().success
        said = written(listener, 3)
        assert process.end() == 0
    assert all("impact at " in text for text in said)
    instants = [float(text.partition("impact at ")[2].split()[0]) for text in said]
    assert instants[0] == pytest.approx(0.4515, abs=1e-3) and np.diff(instants).min() >= 0.3 - 2e-3
    for folder in (tmp_path / "run").iterdir():
        assert (folder / "metadata.yaml").exists()
        verified(folder)


def test_the_end_of_a_run_is_written_with_record(tmp_path: Path) -> None:
    options = {"start_paused": True, "step_count": 900, "record_dir": "run", "record": True}
    with running(tmp_path, record_last=0.2, **options) as (process, listener):
        assert listener.step().success
        assert process.end() == 0
        assert "end of the run" in process.text
    (path,) = (tmp_path / "run").iterdir()
    verified(path)
    times = read_table(open_recording(path)).times
    assert times[-1] == pytest.approx(0.9) and 0.2 - 0.011 <= times[-1] - times[0] <= 0.25 + 0.011


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"record_when": "impact"}, "Give record_last"),
        ({"record_last": 1.0, "record_after": 0.5}, "Give record_when"),
        ({"record_last": 1.0, "record_when": "'elbw > 3'"}, "elbow"),
        ({"record_last": -1.0}, "between 0"),
    ],
)
def test_wrong_parameters_are_refused(tmp_path: Path, parameters: dict[str, object], words: str) -> None:
    text = refusal(tmp_path, parameters)
    assert words in text and "record_" in text
