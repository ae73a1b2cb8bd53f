"""Linkages whose redundant constraints cannot be dropped once and for all, against least squares over all rows."""

import functools

import numpy as np
import pytest

from mbd_sim import Simulation
from test.generators.mechanisms import accelerations
from test.generators.overconstrained import linkage_text
from test.oracles import kane

NAMES = ("bennett", "goldberg", "parallel_cranks", "spatial_parallelogram")


@functools.cache
def simulation(name, driven):
    return Simulation.from_text(linkage_text(name, int(driven), driven=driven))


def relative_error(sim):
    """The error of u' in the metric of the masses."""
    state = np.array(sim.q), np.array(sim.u), np.array(sim.efforts)
    oracle = kane.equations(sim.mechanism, *state, sim.time)
    exact = oracle.accelerations
    error = accelerations(sim.model.equations, *state, sim.time) - exact
    return np.linalg.norm(oracle.scale * error) / max(np.linalg.norm(oracle.scale * exact), 1.0)


@pytest.mark.parametrize(("name", "driven"), [(name, name == NAMES[-1]) for name in NAMES])
def test_accelerations_and_energy_through_the_motion(name, driven):
    sim = simulation(name, driven)
    sim.reset()
    largest = 1.0
    for _ in range(4):
        sim.step(450)
        energies = sim.energies
        largest = max(largest, abs(energies.kinetic), abs(energies.work_drives))
        if sim.u.size:
            assert relative_error(sim) < 1e-11
        assert abs(energies.residual) < 1e-11 * largest
        assert max(sim.violation) < 1e-11


def test_the_power_of_the_drives_is_the_rate_of_the_energy():
    """The rate of T + V by a difference quotient of order four."""
    sim = simulation(NAMES[-1], True)
    sim.reset()
    h = sim.step_size
    for _ in range(3):
        sim.step(296)
        energy, power = [], 0.0
        for place in range(5):
            energy.append(sim.energies.kinetic + sim.energies.potential)
            if place == 2:
                power = sum(drive.velocity * drive.force for drive in sim.drives().values())
            sim.step(1)
        rate = (energy[0] - 8.0 * energy[1] + 8.0 * energy[3] - energy[4]) / (12.0 * h)
        assert power == pytest.approx(rate, rel=1e-7, abs=1e-8)
