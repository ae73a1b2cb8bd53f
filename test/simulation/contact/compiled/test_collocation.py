"""Slip whose direction friction turns fast, beside SciPy's integrator of stiff equations."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from mbd_sim import Simulation

BEGINS, ENDS = 0.05, 0.09  # s
BRIEF = 1e-7  # s, after which the comparison starts
# A point on the floor, with different masses along x and y, is dragged by a force that turns and exceeds friction from
# `BEGINS` on.
DRAGGED = f"""
mechanism: dragged
parameters: {{mu: 0.3, mx: 1, my: 1, growth: 2, turning: 3, damping: 0}}
parts:
  a: {{mass: mx, inertia: [1, 1, 1]}}
  b: {{mass: my, inertia: [1, 1, 1]}}
  c: {{shape: {{type: particle, mass: 2}}}}
joints:
  x: {{type: prismatic, between: [ground, a], axis: [1, 0, 0], damping: damping}}
  y: {{type: prismatic, between: [a, b], axis: [0, 1, 0], damping: damping}}
  z: {{type: prismatic, between: [b, c], axis: [0, 0, 1]}}
constraints: {{floor: {{type: on_plane, point: c, bound: at_least, friction: mu}}}}
forces:
  fx: {{type: effort, coordinate: x, effort: mu*2*9.81*(1 + growth*(t - {BEGINS}))*cos(turning*t)}}
  fy: {{type: effort, coordinate: y, effort: mu*2*9.81*(1 + growth*(t - {BEGINS}))*sin(turning*t)}}
"""


def dragged(mu, mx, my, growth, turning, damping):
    """The place (2,) and the velocity (2,) at the end: from a short while after the beginning, where they are known."""
    masses, friction = np.array([mx + my + 2.0, my + 2.0]), mu * 2.0 * 9.81

    def rates(t, state):
        v = state[2:]
        force = friction * (1.0 + growth * (t - BEGINS)) * np.array([np.cos(turning * t), np.sin(turning * t)])
        return np.concatenate([v, (force - friction * v / np.hypot(*v) - damping * v) / masses])

    along = np.array([np.cos(turning * BEGINS), np.sin(turning * BEGINS)])
    start = [0.0, 0.0, *(0.5 * BRIEF**2 * friction * growth / (along @ (masses * along)) * along)]
    return solve_ivp(rates, (BEGINS + BRIEF, ENDS), start, method="Radau", rtol=1e-11, atol=1e-17).y[:, -1]


@pytest.fixture(scope="module")
def simulation():
    return Simulation.from_text(DRAGGED, step=2e-3, live=["parameters.*"])


@pytest.mark.parametrize("seed", (1, 2))
def test_slip_follows_a_force_that_turns(simulation, seed):
    """It begins, and where it is damped, it stays so slow that friction turns it within a hundredth of a step.

    Friction along the slip at the end of each part of a step has errors of 1e-8.
    """
    rng = np.random.default_rng(seed)
    bounds = {"mu": (0.1, 0.8), "mx": (0.1, 5.0), "my": (0.1, 5.0), "growth": (0.5, 10.0), "turning": (-10.0, 10.0)}
    values = {name: rng.uniform(*each) for name, each in bounds.items()}
    values["damping"] = (seed % 2) * 500.0
    simulation.set_live({f"parameters.{name}": value for name, value in values.items()})
    simulation.reset()
    simulation.run(until=ENDS)
    expected = dragged(**values)
    assert simulation.q[:2] == pytest.approx(expected[:2], abs=1e-9)
    assert simulation.u[:2] == pytest.approx(expected[2:], abs=1e-9)
    assert abs(simulation.energies.residual) < 1e-11
