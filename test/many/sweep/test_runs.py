from dataclasses import replace

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.files.checks.override import with_values
from mbd_sim.files.load import load_mechanism
from mbd_sim.many.sweep import runs
from mbd_sim.many.sweep.runs import Settings, chunks, compute, joined


def settings(name="double_rod", **more):
    source = load_mechanism(name).source
    return Settings(source.text, source.file, until=0.5, every=0.01, **more)


def test_a_row_holds_what_a_single_run_ends_with():
    changes = [{"l": 0.7, "efforts.elbow": 1.5}, {"l": 1.3, "efforts.elbow": 0.0}]
    found = compute(settings(), chunks(changes)[0]).runs
    for row, change in enumerate(changes):
        single = Simulation(with_values(load_mechanism("double_rod"), {"l": change["l"]}))
        single.set_efforts({"elbow": change["efforts.elbow"]})
        angles = []
        for _ in range(51):
            angles.append(single.q[1])
            single.step(10)
        single.reset()
        single.set_efforts({"elbow": change["efforts.elbow"]})
        single.run(0.5)
        assert found["run"][row] == row
        assert found["l"][row] == change["l"]
        assert found["elbow.position"][row] == pytest.approx(single.q[1], abs=1e-11)
        assert found["elbow.velocity"][row] == pytest.approx(single.u[1], abs=1e-10)
        assert found["elbow.least"][row] == pytest.approx(min(angles), abs=1e-11)
        assert found["elbow.most"][row] == pytest.approx(max(angles), abs=1e-11)
        assert found["work_applied"][row] == pytest.approx(single.energies.work_applied, abs=1e-10)
    assert found["finite"].all()
    assert np.abs(found["residual"]).max() < 1e-11


def test_histories_have_a_row_for_each_time():
    found = compute(settings("rod_pendulum", histories=True), chunks([{"gravity[2]": -9.81}, {"gravity[2]": -1.6}])[0])
    table = found.histories
    assert table["time"].tolist() == pytest.approx(np.tile(np.arange(51) * 0.01, 2).tolist())
    assert table["run"].tolist() == [0] * 51 + [1] * 51
    name = load_mechanism("rod_pendulum").coordinate_names[0]
    assert table[name][50] == found.runs[f"{name}.position"][0]


def test_runs_that_share_no_equations_are_computed_one_by_one():
    changes = [{"joints.elbow.axis[1]": -1.0}, {"joints.elbow.axis[1]": 1.0}]
    found = compute(settings(), chunks(changes)[0])
    assert found.runs["finite"].all()
    assert found.runs["elbow.position"][0] == pytest.approx(-found.runs["elbow.position"][1], abs=1e-10)


BARS = """
mechanism: bars
tolerance: 0
parameters: {crank: 0.5}
ground: {points: {pivot: [1.5, 0, 0]}}
parts:
  crank: {mass: 1, inertia: [0.1, 0.1, 0.1], points: {tip: [crank, 0, 0]}}
  rocker: {mass: 1, inertia: [0.1, 0.1, 0.1], points: {tip: [1.2, 0, 0]}}
joints:
  crank: {type: revolute, between: [ground, crank], axis: [0, 0, 1], position: 1.5, velocity: 1}
  rocker: {type: revolute, between: [ground.pivot, rocker], axis: [0, 0, 1], position: 1.7, guess: true}
constraints: {coupler: {type: distance, between: [crank.tip, rocker.tip], length: 1.4}}
"""


def test_a_run_that_cannot_be_built_is_reported_and_the_others_continue():
    short = Settings(BARS, "bars.yaml", until=0.01, every=0.01, method="rk4", quantities=("energies.total",))
    found = compute(short, chunks([{"crank": 0.5}, {"crank": 5.0}, {"crank": 0.4}])[0])
    assert found.runs["finite"].tolist() == [True, False, True]
    assert np.isnan(found.runs["residual"]).tolist() == [False, True, False]
    assert np.isnan(found.runs["energies.total.rms"]).tolist() == [False, True, False]
    (problem,) = found.problems
    assert problem.startswith("run 1: bars.yaml:")
    assert "constraints.coupler: this constraint is violated by" in problem


def test_chunks_are_put_together_in_order(monkeypatch):
    monkeypatch.setattr(runs, "CHUNK", 4)
    changes = [{"gravity[2]": -float(n)} for n in range(7)]
    work = chunks(changes)
    assert [len(chunk.changes) for chunk in work] == [4, 3]
    quick = Settings(**{**vars(settings("rod_pendulum")), "until": 0.01})
    table = joined([compute(quick, chunk) for chunk in work]).runs
    assert table["run"].tolist() == list(range(7))
    assert table["gravity[2]"].tolist() == [-float(n) for n in range(7)]


def test_runs_with_contacts_end_as_single_simulations_bit_for_bit():
    changes = [{"mu": mu, "efforts.ball.x": effort} for mu in (0.1, 0.3) for effort in (0.0, 0.4)]
    found = compute(replace(settings("spinning_ball"), until=0.6), chunks(changes)[0])
    for row, change in enumerate(changes):
        single = Simulation.from_file("spinning_ball", live=["parameters.mu"])
        single.set_live({"parameters.mu": change["mu"]})
        single.reset()
        single.set_efforts({"ball.x": change["efforts.ball.x"]})
        single.run(0.6)
        assert len(single.contact_events) > 0
        assert [found.runs[f"{name}.position"][row] for name in single.coordinate_names] == single.q.tolist()
        assert [found.runs[f"{name}.velocity"][row] for name in single.coordinate_names] == single.u.tolist()
        assert found.runs["dissipated"][row] == single.energies.dissipated
    assert np.abs(found.runs["residual"]).max() < 1e-11


def test_a_run_whose_contacts_have_no_solution_at_the_start_is_reported():
    text = """
    mechanism: ram
    parameters: {v: 0}
    parts: {ram: {shape: {type: particle, mass: 1}}, ball: {shape: {type: particle, mass: 1}}}
    joints:
      ram: {type: prismatic, between: [ground, ram], axis: [0, 0, 1], drive: -v*t}
      ball: {type: prismatic, between: [ground, ball], axis: [0, 0, 1]}
    constraints: {floor: {type: on_plane, point: ram, bound: at_least}}
    """
    found = compute(Settings(text, "ram.yaml", until=0.1, every=0.01), chunks([{"v": 0.0}, {"v": 0.5}])[0])
    assert found.runs["finite"].tolist() == [True, False]
    assert np.isnan(found.runs["ball.position"]).tolist() == [False, True]
    (problem,) = found.problems
    assert problem.startswith("run 1: ")
