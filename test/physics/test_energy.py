"""The power theorem d(T + V)/dt = power of the efforts - dissipated power, and conserved quantities."""

from __future__ import annotations

import numpy as np
import pytest

from mbd_sim import Simulation
from test.generators.mechanisms import PROJECTILE, audited
from test.oracles import kane


def commanded(sim, seconds, record=None):
    """Run with efforts that change every 0.1 s, and pass every state to `record`."""
    rng = np.random.default_rng(20)
    per_command = round(0.1 / sim.step_size)
    for _ in range(round(seconds / 0.1)):
        sim.set_efforts(rng.uniform(-4.0, 4.0, len(sim.u)))
        if record is None:
            sim.step(per_command)
            continue
        states = [(sim.q.copy(), sim.u.copy())]
        for _ in range(per_command):
            sim.step()
            states.append((sim.q.copy(), sim.u.copy()))
        record(sim.efforts.copy(), states)


def boole(values, h):
    """The integral of equally spaced values by Boole's rule, with an error of O(h⁶); 4 n + 1 values."""
    values = np.asarray(values)
    weights = np.zeros(len(values))
    for k in range(0, len(values) - 1, 4):
        weights[k : k + 5] += np.array([7.0, 32.0, 12.0, 32.0, 7.0]) * 2.0 / 45.0
    return h * weights @ values


def test_work_and_dissipation_are_the_integrals_of_the_powers():
    sim = Simulation.from_text(audited(stops=False))
    damping = np.array([3.0, 0.2, 0.1])
    work, dissipated = [], []

    def record(efforts, states):
        speeds = np.array([u for _, u in states])
        work.append(boole(speeds @ efforts, sim.step_size))
        dissipated.append(boole(speeds**2 @ damping, sim.step_size))

    commanded(sim, 2.0, record)
    audit = sim.energies
    assert audit.dissipated > 0.5 and abs(audit.work_applied) > 0.5
    assert audit.work_applied == pytest.approx(np.sum(work), rel=1e-11)
    assert audit.dissipated == pytest.approx(np.sum(dissipated), rel=1e-11)
    assert audit.work_drives == 0.0
    assert audit.total == audit.kinetic + audit.potential
    assert abs(audit.residual) < 1e-12


def test_the_energies_are_those_of_the_state():
    sim = Simulation.from_text(audited(stops=True))
    start = kane.equations(sim.mechanism, sim.q, sim.u, np.zeros(3))
    commanded(sim, 1.0)
    end = kane.equations(sim.mechanism, sim.q, sim.u, np.zeros(3))
    audit = sim.energies
    assert audit.kinetic == pytest.approx(end.kinetic, rel=1e-13)
    assert audit.potential == pytest.approx(end.potential, rel=1e-12)
    expected = audit.total - (start.kinetic + start.potential) - audit.work_applied + audit.dissipated
    assert audit.residual == pytest.approx(expected, abs=1e-12)


def residual(method, step, stops, seconds=1.0):
    sim = Simulation.from_text(audited(stops), method=method, step=step)
    commanded(sim, seconds)
    return abs(sim.energies.residual)


@pytest.mark.parametrize(("method", "order", "steps"), [("midpoint", 2, 500), ("rk4", 4, 100), ("dop853", 8, 40)])
def test_the_residual_is_the_error_of_the_method(method, order, steps):
    """It decreases with h to the power of the order: it contains the error of the integration and nothing else."""
    coarse, fine = (residual(method, 1.0 / n, stops=False) for n in (steps, 4 * steps))
    assert 4.0 ** (order - 1) < coarse / fine < 4.0 ** (order + 1)


def test_the_residual_with_elastic_stops():
    """A stop is a kink in the force: each contact leaves a small part of k v² h² with any method."""
    sim = Simulation.from_text(audited(stops=True))
    touched = []
    commanded(sim, 3.0, lambda efforts, states: touched.extend(q[1] < -0.6 or q[1] > 2.0 for q, _ in states))
    assert 50 < sum(touched) < len(touched) - 50
    assert abs(sim.energies.residual) < 1e-5
    coarse, fine = (residual("dop853", step, stops=True, seconds=3.0) for step in (1e-2, 2.5e-4))
    assert fine < coarse / 400.0


def test_an_effort_on_a_free_joint_is_a_force_and_a_couple():
    """Force in ground's axes, couple in the body's; the momenta change by their impulses."""
    sim = Simulation.from_text(PROJECTILE.replace("mechanism: projectile", "mechanism: pushed\ngravity: [0, 0, 0]"))
    sim.set_efforts({"flight.x": 3.0, "flight.z": -1.0})
    before, _ = kane.momentum(sim.mechanism, sim.q, sim.u)
    sim.run(until=1.0)
    after, _ = kane.momentum(sim.mechanism, sim.q, sim.u)
    assert after - before == pytest.approx([3.0, 0.0, -1.0], abs=1e-11)
    assert sim.energies.work_applied == pytest.approx(3.0 * sim.q[0] - 1.0 * sim.q[2], rel=1e-13)
