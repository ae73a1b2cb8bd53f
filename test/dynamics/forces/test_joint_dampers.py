"""Dampers of a joint with several coordinates, each with its own coefficient, and no other forces."""

import numpy as np
import pytest

from mbd_sim.dynamics.lagrange import lagrange_equations
from mbd_sim.files.load import parse_mechanism
from test.generators.mechanisms import accelerations, derived

TEXT = """
mechanism: dampers
gravity: [0, 0, 0]
parts: {body: {mass: 2, inertia: [3, 3, 4]}}
joints: {slide: {type: planar, between: [ground, body], axis: [0, 0, 1], x_axis: [1, 0, 0], damping: [1, 3, 5]}}
"""


def test_each_speed_has_its_own_damper():
    """Finds the coefficient of the first coordinate in place of the others', in the force and in Rayleigh's function."""
    q, u = np.array([0.3, -0.2, 0.5]), np.array([0.7, -1.1, 1.3])
    expected = -u * [1.0, 3.0, 5.0] / [2.0, 2.0, 4.0]
    assert accelerations(derived(TEXT), q, u) == pytest.approx(expected, rel=1e-14)
    lagrange = lagrange_equations(parse_mechanism(TEXT))
    assert np.ravel(lagrange.accelerations(q, u, np.zeros(3))) == pytest.approx(expected, rel=1e-14)
    assert float(lagrange.dissipation(0.0, q, u)) == pytest.approx(0.5 * u**2 @ [1.0, 3.0, 5.0], rel=1e-14)
