"""Contacts with friction in a plane that is not one of ground's: slip across it is round-off, and has no row."""

from __future__ import annotations

import numpy as np

from mbd_sim import Simulation
from mbd_sim.base.geometry import rotation as rot
from mbd_sim.files.load import parse_mechanism

TEXT = """
mechanism: rolls
gravity: {gravity}
parts: {{wheel: {{shape: {{type: disc, mass: 1, radius: 0.1, axis: {across}}}}}}}
joints:
  wheel:
    type: planar
    between: [ground, wheel]
    axis: {across}
    x_axis: {along}
    position: [0, 0.12, 0]
    velocity: [1, 0, 3]
contacts:
  floor: {{parts: [wheel], plane: ground, normal: {normal}, friction: 0.3, restitution: 0.3}}
"""


def motion(axis, angle):
    turned = rot.about(rot.unit(axis), angle)
    vectors = {"gravity": (1, 0, -9.81), "across": (0, -1, 0), "along": (1, 0, 0), "normal": (0, 0, 1)}
    written = {name: (turned @ np.array(vector, dtype=float)).tolist() for name, vector in vectors.items()}
    simulation = Simulation(parse_mechanism(TEXT.format(**written)), method="tsitouras8")
    simulation.step(600)
    return np.concatenate([simulation.q, simulation.u])


def test_a_wheel_that_bounces_slides_and_rolls_moves_alike_in_all_axes():
    """With sticking friction across the plane the state became infinite."""
    expected = motion((0, 0, 1), 0.0)
    assert abs(expected[3] + 0.1 * expected[5]) < 1e-12  # it rolls
    np.testing.assert_allclose(motion((1, 2, 3), 0.8), expected, atol=1e-10)
