"""The arrows of a bench agree with what is known in closed form."""

import numpy as np
import pytest

from mbd_sim import load_mechanism, parse_mechanism
from mbd_sim.lab.scene.vectors import efforts, reactions, velocities
from mbd_sim.lab.session.bench import Bench

PENDULUM = """
mechanism: pendulum
parameters: {l: 0.8}
parts: {rod: {shape: {type: rod, to: [l, 0, 0], mass: 2}, points: {tip: [l, 0, 0]}}}
joints: {pin: {type: revolute, between: [ground, rod], axis: [0, -1, 0], velocity: 3}}
"""


@pytest.fixture
def bench():
    return Bench.of(parse_mechanism(PENDULUM))


def test_velocities_are_omega_times_the_radius(bench):
    found = {tuple(np.round(point, 12)): vector for point, vector in velocities(bench).straight}
    assert found[(0.4, 0.0, 0.0)] == pytest.approx([0.0, 0.0, 1.2])
    assert found[(0.8, 0.0, 0.0)] == pytest.approx([0.0, 0.0, 2.4])


def test_they_are_at_the_points_that_a_changed_length_gives(bench):
    bench.simulation.set_live({"parameters.l": 1.0}, reassemble=True)
    ends = [point[0] for point, _ in velocities(bench).straight]
    assert ends == pytest.approx([0.5, 1.0])


def test_reactions_of_a_rod_that_falls_from_the_horizontal(bench):
    """At rest, its pin carries a quarter of the weight; turning, also the centripetal force."""
    ((_, force),) = reactions(bench).straight
    assert force == pytest.approx([-2.0 * 0.4 * 3.0**2, 0.0, 2.0 * 9.81 / 4.0], abs=1e-9)


def test_efforts_turn_about_the_axis_of_their_joint(bench):
    bench.simulation.set_efforts({"pin": 1.5})
    ((point, couple),) = efforts(bench).turning
    assert point == pytest.approx([0.0, 0.0, 0.0])
    assert couple == pytest.approx([0.0, -1.5, 0.0])


def test_the_torque_of_a_motor_is_shown():
    bench = Bench.of(load_mechanism("motor_drive"))
    bench.simulation.set_commands({"drive": {"velocity": 2.0}})
    bench.advance(200)
    (state,) = bench.simulation.actuators().values()
    ((_, couple),) = efforts(bench).turning
    assert np.linalg.norm(couple) == pytest.approx(abs(state.effort))
    assert state.effort != 0.0
