"""End states computed independently of this project, against the default method at 1 ms.

The reference values have twelve digits; the tolerances are the measured errors.
"""

from __future__ import annotations

import numpy as np
import pytest

from mbd_sim import Simulation
from test.generators.mechanisms import PROJECTILE

TIGHT = 1e-11  # 3e-12 is reached, which is the resolution of the reference values


def relative(found, expected):
    """The largest error, relative to the largest component."""
    return np.max(np.abs(found - np.array(expected))) / np.max(np.abs(expected))


def run(sim, until):
    assert (sim.model.method.name, sim.step_size) == ("adams11", 1e-3)
    sim.run(until=until)
    assert abs(sim.energies.residual) < 1e-11
    return sim


def test_rod_pendulum():
    sim = run(Simulation.from_file("rod_pendulum"), 3.0)
    assert relative([*sim.q, *sim.u], [-1.49723795473, 1.47067031257]) < TIGHT


def test_double_rod():
    sim = run(Simulation.from_file("double_rod"), 3.0)
    expected = [1.02508601229, 0.495734647627, -4.59335710547, 1.18432088061]
    assert relative([*np.cumsum(sim.q), *np.cumsum(sim.u)], expected) < TIGHT


def test_tumbling():
    sim = run(Simulation.from_file("tumbling"), 10.0)
    assert relative(sim.u[3:], [-0.0410499679708, -1.99960368577, 0.0250672420395]) < TIGHT
    assert np.all(sim.u[:3] == 0.0)


@pytest.mark.parametrize(("method", "most"), [("rk4", 1e-9), ("midpoint", 5e-4)])
def test_other_methods_reach_their_own_accuracy(method, most):
    sim = Simulation.from_file("double_rod", method=method)
    sim.run(until=3.0)
    expected = [1.02508601229, 0.495734647627, -4.59335710547, 1.18432088061]
    assert relative([*np.cumsum(sim.q), *np.cumsum(sim.u)], expected) < most


def test_projectile_follows_its_parabola():
    """x = V cos θ0 t and z = V sin θ0 t - g t²/2, at any time while the body tumbles; the method integrates it exactly."""
    sim = Simulation.from_text(PROJECTILE)
    for until in (0.5, 1.0, 2.0):
        sim.run(until=until)
        assert sim.q[:3] == pytest.approx([12.0 * until, 0.0, 9.0 * until - 0.5 * 9.81 * until**2], abs=1e-12)
        assert sim.u[:3] == pytest.approx([12.0, 0.0, 9.0 - 9.81 * until], abs=1e-12)
