"""Linear and angular momentum of floating mechanisms with internal loops, constraints and forces.

All forces between the parts are internal, including those of constraints and rolling.
"""

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

# A ring of three bodies in space: two ball joints, a cut universal joint, a massless rod, and a gear.
RING = f"""
mechanism: floating_ring
gravity: [0, 0, 0]
parts:
  base: {{mass: 2, center: [0.1, 0, 0.1], inertia: [0.3, 0.4, 0.4], points: {{left: [0, -0.5, 0], right: [0, 0.5, 0]}}}}
  left: {{mass: 1, center: [0.3, 0, 0], inertia: [0.1, 0.2, 0.2], points: {{tip: [0.8, 0, 0.1]}}}}
  right: {{mass: 1.5, center: [0.4, 0, 0], inertia: [0.1, 0.25, 0.2], points: {{tip: [0.9, 0, 0]}}}}
  wheel: {{mass: 0.4, inertia: [0.02, 0.02, 0.03]}}
  other: {{mass: 0.6, inertia: [0.03, 0.03, 0.05]}}
joints:
  {FLOAT}
  one: {{type: spherical, between: [base.left, left], damping: 0.02}}
  two: {{type: spherical, between: [base.right, right], guess: true}}
  axle: {{type: revolute, between: [base, wheel], axis: [1, 0, 1]}}
  shaft: {{type: revolute, between: [base.left, other], axis: [0, 1, 0]}}
constraints:
  rod: {{type: distance, between: [left.tip, right.tip], length: 1.1}}
  thread: {{type: cable, through: [left.tip, base, right], length: 1.4}}
  mesh: {{type: gear, joints: [axle, shaft], radii: [0.2, 0.3]}}
forces:
  band: {{type: spring, between: [left, right.tip], stiffness: 15, length: 0.8}}
"""

# A ball and a blade on a floating plate: their constraint forces are internal.
PLATE = f"""
mechanism: floating_plate
gravity: [0, 0, 0]
parts:
  base: {{mass: 3, inertia: [0.4, 0.5, 0.8], points: {{edge: [0.4, 0.3, 0]}}}}
  ball: {{mass: 0.8, shape: {{type: sphere, radius: 0.1}}}}
  sledge: {{mass: 0.7, center: [0.05, 0, 0], inertia: [0.02, 0.03, 0.04]}}
joints:
  {FLOAT}
  loose: {{type: free, between: [base, ball], position: [0, 0, 0.1], guess: true}}
  table: {{type: planar, between: [base.edge, sledge], axis: [0, 0, 1], position: [0, 0, 0]}}
constraints:
  contact: {{type: rolling, wheel: ball, radius: 0.1, plane: base}}
  blade: {{type: knife_edge, at: sledge, direction: [1, 0, 0], plane: base}}
"""

FLOATING = {"ring": RING, "plate": PLATE}


def center_of_mass(sim):
    mechanism, moving = sim.mechanism, kane.motions(sim.mechanism, sim.q, sim.u)
    return sum(part.mass * moving[name].center.d[0] for name, part in mechanism.parts.items()) / mechanism.mass


def momenta(sim):
    """Linear momentum, and angular momentum about the center of mass."""
    linear, angular = kane.momentum(sim.mechanism, sim.q, sim.u)
    return linear, angular - np.cross(center_of_mass(sim), linear)


def push(sim, rng):
    """Efforts of the joints between parts."""
    inside = [name for name in sim.coordinate_names if not name.startswith(("flight", "loose"))]
    sim.set_efforts(dict(zip(inside, rng.uniform(-0.3, 0.3, len(inside)), strict=True)))


@pytest.mark.parametrize("name", FLOATING)
def test_momenta_of_a_floating_mechanism(name):
    """p grows by m g t, the center of mass follows its parabola, and the spin about it is conserved."""
    sim, rng = Simulation.from_text(FLOATING[name].replace("[0, 0, 0]", "[1, -2, -9]", 1)), np.random.default_rng(150)
    sim.reset(u=rng.uniform(-1.5, 1.5, len(sim.u)), nearest_speeds=True)
    (linear, angular), center = momenta(sim), center_of_mass(sim)
    mass, g = sim.mechanism.mass, sim.mechanism.gravity
    assert np.linalg.norm(angular) > 0.3
    start, worst = sim.q.copy(), np.zeros(3)
    for _ in range(10):
        push(sim, rng)
        sim.step(200)
        moved, spun = momenta(sim)
        t = sim.time
        expected = center + (linear / mass + 0.5 * g * t) * t
        worst = np.maximum(
            worst,
            [
                np.abs(moved - linear - mass * g * t).max(),
                np.abs(spun - angular).max(),
                np.abs(center_of_mass(sim) - expected).max(),
            ],
        )
    assert np.max(worst) < 1e-12
    assert np.max(np.abs(sim.q - start)) > 0.3 and sim.energies.work_applied != 0.0
    assert abs(sim.energies.residual) < 1e-11
    assert max(sim.violation) < 1e-13


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
