"""A node whose mechanism strikes, sticks and slides hundreds of times while its recording is split."""

from pathlib import Path

from mbd_sim import Simulation
from mbd_sim.recording.reader import open_recording
from mbd_sim.recording.recomputation import Recomputation
from mbd_sim.recording.run_start import read_run_start
from mbd_sim.recording.verification import verify
from test.system.nodes import nanoseconds, running
from test.system.test_recording_services import state_ticks

UNTIL = 4.0  # s


def test_each_file_of_a_split_recording_with_hundreds_of_events_verifies(tmp_path: Path) -> None:
    options = {"mechanism": "woodpecker", "record": True, "record_dir": "logs", "record_split_duration": 0.411}
    with running(tmp_path, real_time_factor=4.0, **options) as (process, listener):
        listener.until(
            lambda: listener.states and nanoseconds(listener.states[-1].header.stamp) > UNTIL * 1e9, "the last file"
        )
        process.end()
    paths = sorted((tmp_path / "logs").glob("*.mcap"), key=lambda path: state_ticks(path)[0])
    ticks = [tick for path in paths for tick in state_ticks(path)]
    assert len(paths) > 7 and ticks == list(range(0, ticks[-1] + 1, 20))
    files = [open_recording(path).files[0] for path in paths]
    begun, states = Recomputation(files[0]).simulation, set()
    for path, file in zip(paths, files, strict=True):
        (found,) = verify(path)
        assert found.agrees and found.tolerance is None and found.compared["joint_states"] > 0
        start = read_run_start(file)
        begun.restore(start.y, start.steps, start.inputs)
        states |= {state.state for state in begun.contacts().values()}
    assert states == {"open", "sticks", "slides"}  # where files begin
    whole = Simulation.from_file("woodpecker")
    whole.run(until=UNTIL)
    assert len(whole.contact_events) > 300
