"""The keyframe `start`: all coordinates and speeds of an exported mechanism return."""

import numpy as np

from mbd_sim import Simulation
from mbd_sim.files.load import parse_mechanism
from mbd_sim.files.mjcf.writer import to_mjcf

TEXT = """
mechanism: moving
parts:
  a: {shape: {type: block, mass: 1, size: [0.1, 0.2, 0.3]}}
  b: {shape: {type: block, mass: 1, size: [0.1, 0.2, 0.3]}}
  c: {shape: {type: block, mass: 1, size: [0.1, 0.2, 0.3], at: [0.2, 0, 0]}}
joints:
  fly: {type: free, between: [ground, a], position: [1, 2, 3], orientation: {axis: [1, 2, 3], angle: 0.5},
    velocity: [0.1, 0.2, 0.3], angular_velocity: [0.4, 0.5, 0.6]}
  ball: {type: spherical, between: [a, b], orientation: {axis: [0, 1, 1], angle: 0.7}, angular_velocity: [1, 2, 3]}
  hinge: {type: revolute, between: [b, c], axis: [0, 1, 0], position: 0.3, velocity: -0.4}
"""


def test_starts_return():
    mechanism = parse_mechanism(TEXT)
    again = parse_mechanism(to_mjcf(mechanism).text)
    one, other = Simulation(mechanism), Simulation(again)
    np.testing.assert_allclose(other.q, one.q, atol=1e-14)
    np.testing.assert_allclose(other.u, one.u, atol=1e-14)


def test_other_keyframes_are_noted():
    notes = parse_mechanism(to_mjcf(parse_mechanism(TEXT)).text.replace('name="start"', 'name="home"')).source.notes
    assert any("keyframes" in note and "key[home]" in note for note in notes)
