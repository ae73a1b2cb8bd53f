"""Potentials of expressions far beyond the range of their panels, against antiderivatives."""

import casadi as ca
import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.dynamics.math.piecewise import integral, panels_of, potential, repetition, table_of

X = ca.SX.sym("x")
LAWS = {
    "sin": (lambda x: 80 * ca.sin(x), lambda x: 80 * (1 - np.cos(x)), 1),
    "four-stroke": (
        lambda x: 40 + 90 * ca.cos(x / 2) ** 2 - 7 * ca.sin(3 * x),
        lambda x: 85 * x + 45 * np.sin(x) - 7 / 3 * (1 - np.cos(3 * x)),
        1,
    ),
    "half angle": (lambda x: 5 * ca.sin(x / 2), lambda x: 10 * (1 - np.cos(x / 2)), 2),
    "ripple on a line": (lambda x: 3 * x + ca.cos(2 * x), lambda x: 1.5 * x**2 + np.sin(2 * x) / 2, 1),
    "cubic": (lambda x: x + 2 * x**3, lambda x: x**2 / 2 + x**4 / 2, None),
    "saturated": (lambda x: ca.tanh(x), lambda x: np.abs(x) + np.log1p(np.exp(-2 * np.abs(x))) - np.log(2), None),
    "late kink": (lambda x: ca.fmax(x - 30, 0), lambda x: np.maximum(x - 30, 0) ** 2 / 2, None),
}


@pytest.mark.parametrize("name", LAWS)
def test_the_potential_is_exact_far_away(name):
    f, exact, turns = LAWS[name]
    found = repetition(f)
    assert (found.turns if found else None) == turns
    at = ca.Function("at", [X], [potential(f, table_of(f, -20.0, 20.0), X)])
    inside = ca.Function("inside", [X], [integral(f, panels_of(f, -20.0, 20.0), X)])
    for x in (-19.9, -3.0, 0.0, 1e-3, 12.5, 20.0):  # the same bits as without further panels
        assert float(at(x)) == float(inside(x))
    scale = max(abs(float(f(ca.DM(x)))) for x in (3.0, 11.0, 19.0))
    for x in (20.1, -25.0, 47.3, -500.0, 1234.5, -9.9e4, 1e5):
        assert float(at(x)) == pytest.approx(exact(x), rel=1e-13, abs=1e-14 * abs(x) * max(scale, 1.0))


def test_an_engine_keeps_its_account_over_many_turns():
    text = """
mechanism: engine
gravity: [0, 0, 0]
parts: {wheel: {mass: 1, inertia: [0.5, 0.5, 0.5]}}
joints:
  shaft: {type: revolute, between: [ground, wheel], axis: [0, 0, 1], velocity: 100, spring: {force: "80*sin(x) + 30*sin(2*x)"}}
"""
    sim = Simulation.from_text(text)
    sim.run(until=3.0)
    assert sim.q[0] > 250.0
    assert abs(sim.energies.residual) < 1e-9
