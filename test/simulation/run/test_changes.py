"""Positions and speeds set by name: loops close, or nothing changes."""

import math

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.base.errors import CommandError


def test_values_of_a_tree_are_set_as_given_and_the_audit_stays_balanced():
    simulation = Simulation.from_file("double_rod")
    simulation.step(300)
    q, u = simulation.q.copy(), simulation.u.copy()
    simulation.set_state({"elbow": 0.25}, {"shoulder": -1.5})
    assert simulation.q.tolist() == [q[0], 0.25]
    assert simulation.u.tolist() == [-1.5, u[1]]
    assert (simulation.steps, simulation.time) == (300, 0.3)
    assert abs(simulation.energies.residual) < 1e-10
    simulation.step(300)
    assert abs(simulation.energies.residual) < 1e-9


def test_coordinates_of_a_loop_that_are_not_named_follow():
    simulation = Simulation.from_file("four_bar")
    simulation.step(100)
    name = simulation.coordinate_names[0]
    simulation.set_state({name: simulation.q[0] + 0.3}, {name: 2.0})
    assert max(simulation.violation) < 1e-9
    assert simulation.u[0] == 2.0
    q = simulation.q.copy()
    with pytest.raises(CommandError, match="the loops cannot be closed with these positions") as caught:
        simulation.set_state(dict(zip(simulation.coordinate_names, q + [0.0, 0.1, 0.0][: q.size], strict=True)))
    assert "or give" in str(caught.value)
    assert simulation.q.tolist() == q.tolist()


def test_all_positions_of_a_loop_with_six_digits_are_close_enough():
    simulation = Simulation.from_file("four_bar")
    simulation.step(123)
    rounded = {name: round(value, 7) for name, value in zip(simulation.coordinate_names, simulation.q, strict=True)}
    simulation.set_state(rounded)
    assert max(simulation.violation) < 1e-9
    assert simulation.q == pytest.approx(list(rounded.values()), abs=1e-6)


def test_speeds_that_a_loop_does_not_allow_are_refused():
    simulation = Simulation.from_file("four_bar")
    names, before = simulation.coordinate_names, simulation.state
    with pytest.raises(CommandError, match="the constraints do not allow these speeds"):
        simulation.set_state(velocities=dict.fromkeys(names, 1.0))
    assert simulation.state.tolist() == before.tolist()


@pytest.mark.parametrize(
    ("positions", "velocities", "words"),
    [
        ({"elbw": 1.0}, {}, "there is no joint 'elbw'. Did you mean 'elbow'?"),
        ({"elbow": math.nan}, {}, "the position of elbow is not finite"),
        ({}, {"elbow": math.inf}, "the velocity of elbow is not finite"),
        ({}, {}, "it sets nothing"),
    ],
)
def test_bad_values_are_refused_and_change_nothing(positions, velocities, words):
    simulation = Simulation.from_file("double_rod")
    simulation.step(10)
    before = simulation.state
    with pytest.raises(CommandError) as caught:
        simulation.set_state(positions, velocities)
    assert words in str(caught.value)
    assert simulation.state.tolist() == before.tolist()


def test_an_orientation_is_given_as_a_rotation_vector_and_other_joints_keep_their_bits():
    simulation = Simulation.from_file("heavy_top")
    simulation.step(200)
    before = simulation.q.copy()
    names = simulation.coordinate_names
    simulation.set_state(velocities={names[-1]: 3.0})
    assert simulation.q.tolist() == before.tolist()
    vector = [0.1, -0.2, 0.3]
    simulation.set_state(dict(zip(names, vector, strict=True)))
    assert simulation.model.coordinates(simulation.y) == pytest.approx(vector, abs=1e-15)
    assert np.linalg.norm(simulation.q) == pytest.approx(1.0, abs=1e-15)


def test_a_driven_joint_cannot_be_set():
    simulation = Simulation.from_file("moving_support_pendulum")
    driven = simulation.model.driven_names[0]
    with pytest.raises(CommandError, match="is driven: its drive prescribes the motion"):
        simulation.set_state({driven: 0.1})


def test_speeds_in_a_flat_parallelogram_are_those_of_one_of_its_branches():
    simulation = Simulation.from_text("""
mechanism: parallelogram
gravity: [0, 0, 0]
ground: {points: {d: [1, 0, 0]}}
parts:
  crank: {mass: 1, shape: {type: rod, to: [0.4, 0, 0]}, points: {tip: [0.4, 0, 0]}}
  bar: {mass: 1, shape: {type: rod, to: [1, 0, 0]}, points: {tip: [1, 0, 0]}}
  rocker: {mass: 1, shape: {type: rod, to: [0.4, 0, 0]}, points: {tip: [0.4, 0, 0]}}
joints:
  main: {type: revolute, between: [ground, crank], axis: [0, -1, 0], position: 0.5}
  pin: {type: revolute, between: [crank.tip, bar], axis: [0, -1, 0], position: -0.5, guess: true}
  other: {type: revolute, between: [ground.d, rocker], axis: [0, -1, 0], position: 0.5, guess: true}
  eye: {type: revolute, between: [bar.tip, rocker.tip], axis: [0, -1, 0]}
""")
    simulation.set_state({"main": 0.0, "pin": 0.0, "other": 0.0}, {"main": 3.0})
    assert simulation.u == pytest.approx([3.0, -3.0, 3.0], rel=1e-13)
    before = simulation.energies.kinetic
    simulation.run(until=0.1)
    assert simulation.energies.kinetic == pytest.approx(before, rel=1e-12)
