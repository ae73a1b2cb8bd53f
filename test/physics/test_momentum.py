"""Linear and angular momentum of a floating mechanism with an internal loop, a spring and a damper."""

from __future__ import annotations

import numpy as np
import pytest

from mbd_sim import Simulation
from test.oracles import kane

FLOAT = "flight: {type: free, between: [ground, base], position: [0.2, 0.5, -0.3]}"

FOUR_BAR = f"""
mechanism: floating_four_bar
gravity: [0, 0, 0]
parts:
  base: {{mass: 2, center: [0.7, 0, 0.1], inertia: [0.2, 0.5, 0.4], points: {{far: [1.5, 0, 0]}}}}
  crank: {{mass: 0.5, shape: {{type: rod, to: [0.5, 0, 0]}}, points: {{tip: [0.5, 0, 0]}}}}
  coupler: {{mass: 1.4, shape: {{type: rod, to: [1.4, 0, 0]}}, points: {{tip: [1.4, 0, 0]}}}}
  rocker: {{mass: 1.2, shape: {{type: rod, to: [1.2, 0, 0]}}, points: {{tip: [1.2, 0, 0]}}}}
joints:
  {FLOAT}
  crank_pivot: {{type: revolute, between: [base, crank], axis: [0, -1, 0], position: 90 deg, damping: 0.05}}
  crank_pin: {{type: revolute, between: [crank.tip, coupler], axis: [0, -1, 0], position: -60 deg, guess: true}}
  rocker_pivot: {{type: revolute, between: [base.far, rocker], axis: [0, -1, 0], position: 100 deg, guess: true}}
  rocker_pin: {{type: revolute, between: [coupler.tip, rocker.tip], axis: [0, -1, 0]}}
forces:
  band: {{type: spring, between: [base, coupler.tip], stiffness: 20, length: 1, damping: 0.2}}
"""


def center_of_mass(sim):
    mechanism, moving = sim.mechanism, kane.motions(sim.mechanism, sim.q, sim.u)
    return sum(part.mass * moving[name].center.d[0] for name, part in mechanism.parts.items()) / mechanism.mass


def momenta(sim):
    """Linear momentum, and angular momentum about the center of mass."""
    linear, angular = kane.momentum(sim.mechanism, sim.q, sim.u)
    return linear, angular - np.cross(center_of_mass(sim), linear)


def test_a_plane_loop_may_tumble():
    """The set of independent equations does not change as the plane of the loop rotates relative to ground."""
    sim, rng = Simulation.from_text(FOUR_BAR, step=5e-4), np.random.default_rng(1)
    sim.reset(u=rng.uniform(-3.0, 3.0, len(sim.u)), nearest_speeds=True)
    (linear, angular), normal = momenta(sim), []
    for _ in range(60):
        sim.step(100)
        normal.append(sim.poses()["base"].rotation[1, 1])
    moved, spun = momenta(sim)
    assert min(normal) < -0.5
    assert moved == pytest.approx(linear, abs=2e-12) and spun == pytest.approx(angular, abs=2e-12)
    assert abs(sim.energies.residual) < 2e-12
