"""Four-bars that pass configurations in which their constraints lose rank (Grashof's change points).

If two bars together are as long as the other two, the mechanism can lie flat and continue in two ways. It continues on
its branch, conserves its energy, and its loop stays closed.
"""

from __future__ import annotations

import re

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.files.text.library import shipped
from test.generators.mechanisms import violation

# Lengths of ground, crank, coupler and rocker in m, and start angles in degrees.
CHANGE_POINTS = {
    "antiparallelogram": ((1.5, 0.5, 1.5, 0.5), (90, -130, -60)),
    "of four lengths": ((1.5, 0.5, 1.1, 0.9), (90, -60, 100)),
}


def four_bar(lengths, angles):
    text = shipped()["four_bar"].read_text().replace("velocity: 2 rad/s", "velocity: 8 rad/s")
    for name, length in zip(("base", "crank", "coupler", "rocker"), lengths, strict=True):
        text = re.sub(rf"(?m)^  {name}: [\d.]+ m", f"  {name}: {length} m", text)
    for old, new in zip(("90", "-60", "100"), angles, strict=True):
        text = text.replace(f"position: {old} deg", f"position: START {new} deg", 1)
    return text.replace("START ", "")


@pytest.mark.parametrize("name", CHANGE_POINTS)
def test_change_points_are_passed(name):
    sim = Simulation.from_text(four_bar(*CHANGE_POINTS[name]))
    largest = worst = 0.0
    motion = [sim.q.copy()]
    while sim.time < 10.0:
        sim.step(10)
        motion.append(sim.q.copy())
        largest = max(largest, sim.energies.kinetic)
        worst = max(worst, violation(sim, sim.model.equations))
        assert abs(sim.energies.residual) < 1e-7 * largest
    assert sim.q[0] > 2.0 * np.pi * 7
    assert worst < 1e-9
    accelerations = np.diff(motion, n=2, axis=0) / 0.01**2
    assert np.max(np.abs(accelerations)) < 50.0 * np.max(np.abs(np.diff(motion, axis=0))) / 0.01


def test_it_passes_its_change_points_with_efforts_at_its_joints():
    """A moment at a pin loads the flat loop; the energy audit includes its work."""
    sim = Simulation.from_text(four_bar((1.5, 0.5, 1.5, 0.5), (90, -90, 90)))
    sim.set_efforts({"crank_pin": 0.3, "rocker_pivot": 0.5})
    sim.run(until=10.0)
    crank, coupler, rocker = sim.q
    assert [coupler, rocker] == pytest.approx([-crank, crank], abs=1e-9)
    assert sim.energies.work_applied == pytest.approx(-0.3 * (crank - np.pi / 2) + 0.5 * (crank - np.pi / 2), rel=1e-9)
    assert abs(sim.energies.residual) < 1e-7 * sim.energies.kinetic


# Of 20 slopes from 0° to 95°, that of 45° has the largest error for 1e-6 kg: 3.6e-13 of the speeds, and twice that of the
# energy. It is round-off: in other orders of operations, other slopes have up to 7e-13.
@pytest.mark.parametrize(
    ("mass", "slope", "allowed"),
    [(1e-4, 0, 3e-13), (1e-6, 45, 2e-12), (1e-8, 90, 5e-12)],
)
def test_a_parallelogram_with_a_light_rocker_passes_its_change_points(mass, slope, allowed):
    """Without gravity, a crank of 1 kg and a bar of 1 kg beside a rocker of `mass` turn at a constant speed.

    Energy changes in the steps that end beside a change point, by a few times ε / δ: the nearest is δ = 0.3 mrad away,
    which gives 7e-13 of it. How much of that depends on round-off, such as that of the slope.
    """
    start, (x, z) = 0.5 + np.radians(slope), (np.cos(np.radians(slope)), np.sin(np.radians(slope)))
    sim = Simulation.from_text(f"""
mechanism: light_rocker
gravity: [0, 0, 0]
ground: {{points: {{d: [{x}, 0, {z}]}}}}
parts:
  crank: {{mass: 1, shape: {{type: rod, to: [0.4, 0, 0]}}, points: {{tip: [0.4, 0, 0]}}}}
  bar: {{mass: 1, shape: {{type: rod, to: [1, 0, 0]}}, points: {{tip: [1, 0, 0]}}}}
  rocker: {{mass: {mass}, shape: {{type: rod, to: [0.4, 0, 0]}}, points: {{tip: [0.4, 0, 0]}}}}
joints:
  main: {{type: revolute, between: [ground, crank], axis: [0, -1, 0], position: {start}, velocity: 3}}
  pin: {{type: revolute, between: [crank.tip, bar], axis: [0, -1, 0], position: -0.5, guess: true}}
  other: {{type: revolute, between: [ground.d, rocker], axis: [0, -1, 0], position: {start}, guess: true}}
  eye: {{type: revolute, between: [bar.tip, rocker.tip], axis: [0, -1, 0]}}
""")
    sim.run(until=20.0)
    assert sim.violation.position < 1e-14
    assert sim.u == pytest.approx([3.0, -3.0, 3.0], rel=allowed)
    assert sim.q == pytest.approx([start + 60.0, -60.5, start + 60.0], abs=20.0 * 3.0 * allowed)
    assert abs(sim.energies.residual) < allowed * sim.energies.kinetic
