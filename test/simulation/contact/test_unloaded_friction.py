"""Friction of contacts that touch without a force, beside friction at its limit: it holds nothing."""

import numpy as np
import pytest

from mbd_sim import Simulation

TABLE = """
mechanism: blocks_on_a_tilting_table
integrator: {step: 2 ms}
parts:
  table: {shape: {type: block, size: [3, 0.2, 0.1], at: [0, 0, -0.05], mass: 2}}
  low: {shape: {type: block, size: [0.2, 0.1, 0.1], mass: 1.155}}
  tall: {shape: {type: block, size: [0.16, 0.1, 0.24], mass: 2.167}}
joints:
  table: {type: revolute, between: [ground, table], axis: [0, 1, 0], drive: 0.313*t}
  low: {type: planar, between: [ground, low], axis: [0, -1, 0], x_axis: [1, 0, 0], position: [0.1, 0.05, 0]}
  tall: {type: planar, between: [ground, tall], axis: [0, -1, 0], x_axis: [1, 0, 0], position: [-0.08, 0.12, 0]}
contacts:
  low: {between: [low, table], friction: 0.76}
  tall: {between: [tall, table], friction: 0.232}
  faces: {between: [low, tall], friction: 0.4}
"""
LIMITS = {"low": 0.76, "tall": 0.232, "faces": 0.4}


def test_blocks_that_lean_on_each_other_on_a_tilting_table_part():
    """Where the faces lose their force, their friction seemed to hold the lower block, and no forces were found."""
    sim, worst, pulls, states = Simulation.from_text(TABLE), 0.0, 0.0, set()
    while 0.313 * sim.time < 0.9:
        sim.step(5)
        for name, contact in sim.contacts().items():
            friction, limit = np.linalg.norm(contact.friction), LIMITS[name.split(".")[0]] * contact.normal
            worst, pulls = max(worst, friction - limit), min(pulls, contact.normal)
            states.add((name.split(".")[0], contact.state))
    assert worst < 1e-7 and pulls > -1e-8  # N
    assert {("faces", "open"), ("low", "slides"), ("tall", "slides")} <= states
    assert sim.energies.residual == pytest.approx(0.0, abs=1e-10)
