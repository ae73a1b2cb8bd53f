"""Recordings written by the viewer, read back with Rerun's reader."""

import os
import signal
import subprocess
import sys
import time
from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest
import rerun_cli

from mbd_sim import Simulation
from mbd_sim.base.geometry import rotation as rot
from mbd_sim.pictures.rerun import Viewer, ViewerError
from mbd_sim.pictures.rerun.scene import DisplayOptions, LoggedEvent, RowMaker, describe_scene
from mbd_sim.pictures.rerun.viewer import EventFilter
from mbd_sim.simulation.run.events import parse_event
from test.waiting import wait_until


class Recorded:
    """A recording read back: the rows of each entity in order of time, and the static components of each entity."""

    def __init__(self, path):
        from rerun.chunk import RrdReader

        reader = RrdReader(path)
        (self.entry,) = reader.recordings()
        self.blueprints = reader.blueprints()
        self.static, rows = defaultdict(dict), defaultdict(list)
        for chunk in reader.stream().to_chunks():
            table = chunk.to_record_batch().to_pydict()
            if chunk.is_static:
                self.static[chunk.entity_path] |= table
            else:
                columns = [name for name in table if name not in ("rerun.controls.RowId", "sim_time")]
                for index, time in enumerate(table["sim_time"]):
                    row = {name: table[name][index] for name in columns}
                    rows[chunk.entity_path].append((time.total_seconds(), row))
        self.rows = {entity: sorted(found, key=lambda row: row[0]) for entity, found in rows.items()}

    def times(self, entity):
        return [time for time, _ in self.rows[entity]]

    def column(self, entity, name):
        return np.array([row[name] for _, row in self.rows[entity]])


def offer(viewer, sim):
    viewer.offer(sim.time, sim.state, sim.inputs.copy(), sim.energies)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Two seconds of two rods, 100 samples per second, with the simulation's own values at each.

    Twice as many are offered.
    """
    path = tmp_path_factory.mktemp("viewer") / "run.rrd"
    sim = Simulation.from_file("double_rod")
    moments = []
    with Viewer(sim.model, str(path), rate=100.0) as viewer:
        sim.set_efforts({"elbow": 0.5})
        viewer.event(0.0, "released")
        for index in range(201):
            offer(viewer, sim)
            moments.append((sim.time, sim.poses(), sim.q.copy(), sim.u.copy(), sim.efforts.copy(), sim.energies))
            if index == 100:
                viewer.flush()  # so that the recording consists of several batches
            if index < 200:
                sim.step(5)
                offer(viewer, sim)
                sim.step(5)
        viewer.event(sim.time, "end")
    assert viewer.failure is None
    assert viewer.dropped == 0
    assert viewer.address == str(path)
    return Recorded(path), moments, path


def test_every_sample_is_recorded_at_its_time(run):
    recorded, moments, _ = run
    times = [moment[0] for moment in moments]
    moving = {"/world/parts/upper", "/world/parts/lower", "/world/traces/lower"}
    arcs = {"/world/efforts/shoulder/couple", "/world/efforts/elbow/couple"}
    plotted = {"/joints/position/angular", "/joints/velocity/angular", "/joints/effort/angular"}
    audit = {"/energy/account", "/energy/stack", "/energy/residual", "/energy/residual_pJ"}
    events = {"/events/log", "/events/states/run", "/events/states/commands"}
    assert set(recorded.rows) == moving | arcs | plotted | audit | events
    for entity in moving | arcs | plotted | audit:
        np.testing.assert_allclose(recorded.times(entity), times, rtol=0, atol=1e-6)


@pytest.mark.parametrize("part", ["upper", "lower"])
def test_parts_have_the_poses_of_the_model(run, part):
    recorded, moments, _ = run
    entity = f"/world/parts/{part}"
    positions = recorded.column(entity, "Transform3D:translation")[:, 0]
    quaternions = recorded.column(entity, "Transform3D:quaternion")[:, 0]
    for (_, poses, *_), position, xyzw in zip(moments, positions, quaternions, strict=True):
        np.testing.assert_allclose(position, poses[part].position, rtol=0, atol=1e-6)
        np.testing.assert_allclose(rot.from_quaternion(np.roll(xyzw, 1)), poses[part].rotation, rtol=0, atol=1e-6)


def test_plots_contain_the_simulations_numbers(run):
    recorded, moments, _ = run
    _, _, q, u, efforts, energies = (list(column) for column in zip(*moments, strict=True))
    scalars = {entity: recorded.column(entity, "Scalars:scalars") for entity in recorded.rows if "energy" in entity}
    for name, values in (("position", q), ("velocity", u), ("effort", efforts)):
        np.testing.assert_array_equal(recorded.column(f"/joints/{name}/angular", "Scalars:scalars"), values)
    account = [(e.kinetic, e.potential, e.total, e.dissipated, e.work_applied) for e in energies]
    np.testing.assert_array_equal(scalars["/energy/account"], account)
    np.testing.assert_allclose(scalars["/energy/stack"][:, -1], energies[0].total, atol=1e-11)
    residuals = np.array([e.residual for e in energies])
    np.testing.assert_allclose(scalars["/energy/residual_pJ"][:, 0] * 1e-12, residuals, rtol=1e-14)
    shown = 10.0 ** scalars["/energy/residual"][:, 0]
    large = np.abs(residuals) > 3e-15
    assert np.count_nonzero(large) > 30
    np.testing.assert_allclose(shown[large], np.abs(residuals)[large], rtol=1e-12)
    assert np.all(shown < 1e-11)


def test_the_trace_is_the_path_of_the_tip(run):
    recorded, moments, _ = run
    tips = np.array([poses["lower"].position - poses["lower"].rotation[:, 2] for _, poses, *_ in moments])
    pieces = recorded.column("/world/traces/lower", "LineStrips3D:strips")[:, 0]
    np.testing.assert_allclose(pieces[:, 1], tips, atol=1e-6)
    np.testing.assert_allclose(pieces[1:, 0], tips[:-1], atol=1e-6)


def test_names_events_and_static_shapes(run):
    recorded, _, _ = run
    assert recorded.entry.application_id == "mbd_sim"
    assert len(recorded.blueprints) == 1
    assert recorded.static["/__properties"]["RecordingInfo:name"] == [["double_rod"]]
    assert recorded.static["/joints/position/angular"]["SeriesLines:names"] == [["shoulder", "elbow"]]
    assert recorded.static["/world/parts/upper/0_rod"]["Capsules3D:lengths"] == [[1.0]]
    assert "/world/parts/upper/joints/elbow" in recorded.static
    events = [(time, row["TextLog:text"]) for time, row in recorded.rows["/events/log"]]
    assert events == [(0.0, ["released"]), (2.0, ["end"])]


def test_reruns_own_check_passes(run):
    program = Path(rerun_cli.__file__).parent / "rerun"
    done = subprocess.run([program, "rrd", "verify", run[2]], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_a_slow_viewer_loses_the_oldest_samples_counts_them_and_prints_nothing(tmp_path, capfd):
    sim = Simulation.from_file("rod_pendulum")
    viewer = Viewer(sim.model, str(tmp_path / "a.rrd"), rate=1000.0, capacity=200)
    os.kill(viewer._worker.pid, signal.SIGSTOP)
    try:
        for _ in range(5000):  # more than the pipe can buffer
            offer(viewer, sim)
            sim.step()
            if sim.steps % 100 == 0:
                viewer._wake.set()
                time.sleep(1e-3)
    finally:
        os.kill(viewer._worker.pid, signal.SIGCONT)
    viewer.flush()
    viewer.close()
    assert viewer.failure is None
    assert tuple(capfd.readouterr()) == ("", "")  # also of the process that writes
    assert viewer.dropped > 0
    times = Recorded(tmp_path / "a.rrd").times("/joints/position/angular")
    assert len(times) == sim.steps - viewer.dropped
    assert times[-1] == pytest.approx(sim.time - 1e-3)
    np.testing.assert_allclose(times[-200:], np.arange(sim.steps - 200, sim.steps) * 1e-3, atol=1e-9)


def test_a_killed_viewer_does_not_disturb_the_caller(tmp_path):
    sim = Simulation.from_file("rod_pendulum")
    viewer = Viewer(sim.model, str(tmp_path / "a.rrd"))
    viewer._worker.kill()
    offer(viewer, sim)
    with pytest.raises(ViewerError, match="no longer accepts data"):
        viewer.flush()
    sim.step(100)
    offer(viewer, sim)
    viewer.event(sim.time, "nobody reads this")
    viewer.close()
    viewer.close()
    assert viewer.failure is not None


def test_the_recording_is_complete_when_the_simulation_is_killed(tmp_path):
    code = """if True:
        import os, signal, sys
        from mbd_sim import Simulation
        from mbd_sim.pictures.rerun import Viewer
        sim = Simulation.from_file("rod_pendulum")
        viewer = Viewer(sim.model, sys.argv[1], rate=1000.0)
        for _ in range(100):
            viewer.offer(sim.time, sim.state, sim.inputs.copy(), sim.energies)
            sim.step()
        viewer.flush()
        print(viewer._worker.pid, flush=True)
        os.kill(os.getpid(), signal.SIGKILL)
    """
    path = tmp_path / "a.rrd"
    done = subprocess.run([sys.executable, "-c", code, path], stdout=subprocess.PIPE, text=True, check=False)
    assert done.returncode == -signal.SIGKILL
    worker = Path(f"/proc/{done.stdout.strip()}")
    wait_until(lambda: not worker.exists(), "the end of the worker")
    assert len(Recorded(path).times("/world/parts/rod")) == 100


def test_the_trace_starts_again_after_a_reset(tmp_path):
    from mbd_sim.pictures.rerun.stream import RerunStream

    sim = Simulation.from_file("rod_pendulum")
    writer, rows = RowMaker(sim.model), []
    for tick in range(20):
        if tick == 10:
            sim.reset()
        rows.append(writer.row(tick * 1e-3, sim.time, sim.state, sim.inputs, sim.energies))
        sim.step()
    scene = describe_scene(sim.model, writer.layout, DisplayOptions(traces=("rod", "rod.tip")))
    stream = RerunStream(scene, str(tmp_path / "a.rrd"))
    stream.send_samples(np.array(rows))
    stream.close()
    recorded = Recorded(tmp_path / "a.rrd")
    for entity in ("/world/traces/rod", "/world/traces/rod.tip"):
        lengths = np.linalg.norm(np.diff(recorded.column(entity, "LineStrips3D:strips")[:, 0], axis=1), axis=2)[:, 0]
        assert lengths[0] == lengths[10] == 0.0
        assert np.all(lengths[1:10] > 0.0)


def test_a_trace_of_an_unknown_point_is_refused(tmp_path):
    with pytest.raises(ValueError, match="no point"):
        Viewer(Simulation.from_file("rod_pendulum").model, str(tmp_path / "a.rrd"), traces=["rod.tp"])


def test_events_become_lines_and_lanes(tmp_path):
    from mbd_sim.pictures.rerun.stream import RerunStream

    sim, event_filter = Simulation.from_file("rod_pendulum"), EventFilter()
    writer = RowMaker(sim.model)
    stream = RerunStream(describe_scene(sim.model, writer.layout, DisplayOptions()), str(tmp_path / "a.rrd"))
    stream.send_samples(writer.row(0.0, 0.0, sim.state, sim.inputs, sim.energies)[None])
    texts = ["command", "command", "commands expired: efforts set to zero", "command", "paused", "running", "reset"]
    events = [(float(second), parse_event(text)) for second, text in enumerate(texts, 1)]
    shown = [(time, event) for time, event in events if event_filter.accepts(event.kind)]
    stream.send_events([LoggedEvent(time, event.kind, event.text) for time, event in shown])
    stream.close()
    recorded = Recorded(tmp_path / "a.rrd")
    log = [(at, row["TextLog:text"][0], row["TextLog:level"][0]) for at, row in recorded.rows["/events/log"]]
    assert log == [
        (1.0, "commands are accepted", "INFO"),
        (3.0, "commands expired: efforts set to zero", "WARN"),
        (4.0, "commands are accepted", "INFO"),
        (5.0, "paused", "INFO"),
        (6.0, "running", "INFO"),
        (7.0, "reset", "INFO"),
    ]
    lanes = {
        name: [(at, row["StateChange:state"][0]) for at, row in recorded.rows[f"/events/states/{name}"]]
        for name in ("run", "commands")
    }
    assert lanes["run"] == [(0.0, "running"), (5.0, "paused"), (6.0, "running")]
    assert lanes["commands"] == [(0.0, "none"), (1.0, "taken"), (3.0, "expired"), (4.0, "taken"), (7.0, "none")]


@pytest.mark.parametrize("rate", [0.0, -1.0, float("nan"), float("inf")])
def test_the_rate_must_be_positive(tmp_path, rate):
    with pytest.raises(ValueError, match="rate must be a positive number"):
        Viewer(Simulation.from_file("rod_pendulum").model, str(tmp_path / "a.rrd"), rate=rate)
