"""Recordings written by the viewer, read back with Rerun's own reader."""

import subprocess
import sys
import threading
from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest
import rerun_cli
from rerun.chunk import RrdReader

from mbd_sim import Simulation
from mbd_sim.mechanism import rotation as rot
from mbd_sim.viewer import Viewer, ViewerError


class Recorded:
    """A recording read back: the rows of each entity in the order of time, and the names of what is static."""

    def __init__(self, path):
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
    viewer.offer(sim.time, sim.state, sim.efforts.copy(), sim.energies)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Two seconds of two rods, 100 samples a second, with what the simulation itself said at each."""
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
                viewer.flush()  # so that the recording has a seam between two batches
            if index < 200:
                sim.step(10)
        viewer.event(sim.time, "end")
    assert viewer.failure is None
    assert viewer.dropped == 0
    assert viewer.address == str(path)
    return Recorded(path), moments, path


def test_every_sample_is_recorded_at_its_time(run):
    recorded, moments, _ = run
    times = [moment[0] for moment in moments]
    moving = {"/world/parts/upper", "/world/parts/lower", "/world/traces/lower"}
    plotted = {"/joints/position", "/joints/velocity", "/joints/effort"}
    audit = {"/energy/balance", "/energy/exchange", "/energy/residual_pJ"}
    assert set(recorded.rows) == moving | plotted | audit | {"/events"}
    for entity in moving | plotted | audit:
        np.testing.assert_allclose(recorded.times(entity), times, rtol=0, atol=1e-6)


@pytest.mark.parametrize("part", ["upper", "lower"])
def test_parts_stand_where_the_model_says(run, part):
    recorded, moments, _ = run
    entity = f"/world/parts/{part}"
    positions = recorded.column(entity, "Transform3D:translation")[:, 0]
    quaternions = recorded.column(entity, "Transform3D:quaternion")[:, 0]
    for (_, poses, *_), position, xyzw in zip(moments, positions, quaternions, strict=True):
        np.testing.assert_allclose(position, poses[part].position, rtol=0, atol=1e-6)
        np.testing.assert_allclose(rot.from_quaternion(np.roll(xyzw, 1)), poses[part].rotation, rtol=0, atol=1e-6)


def test_plots_hold_the_simulations_numbers(run):
    recorded, moments, _ = run
    _, _, q, u, efforts, energies = (list(column) for column in zip(*moments, strict=True))
    np.testing.assert_array_equal(recorded.column("/joints/position", "Scalars:scalars"), q)
    np.testing.assert_array_equal(recorded.column("/joints/velocity", "Scalars:scalars"), u)
    np.testing.assert_array_equal(recorded.column("/joints/effort", "Scalars:scalars"), efforts)
    balance = [(e.kinetic, e.potential, e.total) for e in energies]
    np.testing.assert_array_equal(recorded.column("/energy/balance", "Scalars:scalars"), balance)
    exchange = [(e.dissipated, e.work_applied, e.work_drives) for e in energies]
    np.testing.assert_array_equal(recorded.column("/energy/exchange", "Scalars:scalars"), exchange)
    picojoules = recorded.column("/energy/residual_pJ", "Scalars:scalars")[:, 0]
    np.testing.assert_allclose(picojoules * 1e-12, [e.residual for e in energies], rtol=1e-14)


def test_the_trace_is_the_way_of_the_tip(run):
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
    assert recorded.static["/joints/position"]["SeriesLines:names"] == [["shoulder", "elbow"]]
    assert recorded.static["/world/parts/upper/0_rod"]["Capsules3D:lengths"] == [[1.0]]
    assert "/world/parts/upper/joints/elbow" in recorded.static
    events = [(time, row["TextLog:text"]) for time, row in recorded.rows["/events"]]
    assert events == [(0.0, ["released"]), (2.0, ["end"])]


def test_reruns_own_check_passes(run):
    program = Path(rerun_cli.__file__).parent / "rerun"
    done = subprocess.run([program, "rrd", "verify", run[2]], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_rate_thins_out_the_samples(tmp_path):
    sim = Simulation.from_file("rod_pendulum")
    with Viewer(sim.model, str(tmp_path / "a.rrd"), rate=10.0) as viewer:
        for _ in range(101):
            offer(viewer, sim)
            sim.step(10)
    times = Recorded(tmp_path / "a.rrd").times("/world/parts/rod")
    np.testing.assert_allclose(times, np.arange(11) / 10.0, atol=1e-6)


def test_a_slow_viewer_loses_the_oldest_samples_and_counts_them(tmp_path, monkeypatch):
    sim = Simulation.from_file("rod_pendulum")
    busy, go_on = threading.Event(), threading.Event()
    viewer = Viewer(sim.model, str(tmp_path / "a.rrd"), rate=1000.0, capacity=5)
    send = viewer._columns.send

    def slow(samples):
        busy.set()
        assert go_on.wait(10.0)
        send(samples)

    monkeypatch.setattr(viewer._columns, "send", slow)
    offer(viewer, sim)
    assert busy.wait(10.0)
    for _ in range(12):
        sim.step()
        offer(viewer, sim)
    go_on.set()
    viewer.flush()
    assert viewer.dropped == 7
    viewer.close()
    times = Recorded(tmp_path / "a.rrd").times("/joints/position")
    np.testing.assert_allclose(times, [0.0, 0.008, 0.009, 0.010, 0.011, 0.012], atol=1e-9)


def test_a_failing_viewer_leaves_the_caller_alone(tmp_path, monkeypatch):
    sim = Simulation.from_file("rod_pendulum")
    viewer = Viewer(sim.model, str(tmp_path / "a.rrd"))

    def broken(samples):
        raise RuntimeError("disk full")

    monkeypatch.setattr(viewer._columns, "send", broken)
    offer(viewer, sim)
    with pytest.raises(ViewerError, match="disk full"):
        viewer.flush()
    sim.step(100)
    offer(viewer, sim)
    viewer.event(sim.time, "nobody reads this")
    viewer.close()
    viewer.close()
    assert "disk full" in str(viewer.failure)


@pytest.mark.parametrize("rate", [0.0, -1.0, float("nan"), float("inf")])
def test_the_rate_must_be_positive(tmp_path, rate):
    with pytest.raises(ValueError, match="rate must be a positive number"):
        Viewer(Simulation.from_file("rod_pendulum").model, str(tmp_path / "a.rrd"), rate=rate)


def test_importing_the_viewer_does_not_import_rerun():
    code = "import sys, mbd_sim.viewer; assert not {'rerun', 'rclpy', 'scipy'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)
