"""Springs between points, applied forces and couples."""

import numpy as np
import pytest

from mbd_sim import MechanismError, Simulation, parse_mechanism

BALL = """
mechanism: ball
gravity: [0, 0, 0]
parts:
  ball: {mass: 2, inertia: [0.2, 0.3, 0.4], points: {rim: [0.1, 0, 0]}}
joints:
  flight: {type: free, between: [ground, ball], position: [3, 0, 0]}
forces:
  FORCE
"""


def ball(force, **changes):
    text = BALL.replace("FORCE", force)
    for old, new in changes.values():
        text = text.replace(old, new)
    return Simulation.from_text(text)


def test_a_mass_on_a_spring_oscillates_at_its_natural_frequency():
    sim = ball("s: {type: spring, between: [ground, ball], stiffness: 50, length: 2}")
    sim.run(until=1.3)
    assert sim.q[0] == pytest.approx(2 + np.cos(5 * 1.3), rel=1e-12)
    assert abs(sim.energies.residual) < 1e-13


def test_a_spring_of_zero_length_attracts_from_every_direction():
    sim = ball("s: {type: spring, between: [ground, ball], stiffness: 50}")
    sim.reset(u=[0, 4, 0, 0, 0, 0])
    sim.run(until=1.3)
    assert sim.q[:3] == pytest.approx([3 * np.cos(6.5), 4 / 5 * np.sin(6.5), 0], abs=1e-12)


def test_a_damper_dissipates_c_v_squared():
    sim = ball("s: {type: spring, between: [ground, ball], damping: 4}")
    sim.reset(u=[1, 0, 0, 0, 0, 0])
    sim.run(until=0.5)
    assert sim.u[0] == pytest.approx(np.exp(-2 * 0.5), rel=1e-12)
    assert sim.energies.dissipated == pytest.approx(1 - np.exp(-2.0), rel=1e-12)
    assert abs(sim.energies.residual) < 1e-13


def test_a_force_in_grounds_axes_at_the_center_of_mass_does_not_rotate_the_part():
    sim = ball('f: {type: force, at: ball, vector: ["6*sin(t)", 0, 0]}')
    sim.run(until=2.0)
    assert sim.u == pytest.approx([3 * (1 - np.cos(2.0)), 0, 0, 0, 0, 0], abs=1e-12)
    assert sim.energies.work_applied == pytest.approx(sim.energies.kinetic, rel=1e-12)


def test_a_follower_force_off_the_center_gives_a_constant_angular_acceleration():
    sim = ball("f: {type: force, at: ball.rim, vector: [0, 3, 0], axes: part}")
    sim.run(until=0.8)
    assert sim.u[5] == pytest.approx(3 * 0.1 / 0.4 * 0.8, rel=1e-12)
    assert abs(sim.energies.residual) < 1e-13


@pytest.mark.parametrize(("axes", "expected"), [("ground", [0.0, 0.0, 0.5 / 0.4]), ("part", [0.0, 0.0, 0.5 / 0.4])])
def test_a_couple_rotates_the_part_without_translation(axes, expected):
    sim = ball(f"c: {{type: couple, on: ball, vector: [0, 0, 0.5], axes: {axes}}}")
    sim.run(until=1.0)
    assert sim.u == pytest.approx([0, 0, 0, *expected], abs=1e-12)
    assert sim.energies.work_applied == pytest.approx(sim.energies.kinetic, rel=1e-12)


def test_springs_and_dampers_between_two_parts_conserve_the_momentum():
    text = """
mechanism: two
gravity: [0, 0, 0]
parts:
  a: {mass: 1, inertia: [1, 1, 1], points: {p: [0.2, 0, 0]}}
  b: {mass: 3, inertia: [2, 2, 2], points: {p: [0, 0.3, 0]}}
joints:
  fa: {type: free, between: [ground, a], velocity: [0, 0.4, 0.2]}
  fb: {type: free, between: [ground, b], position: [1, 1, 0]}
forces:
  s: {type: spring, between: [a.p, b.p], stiffness: 30, length: 0.5, damping: 2}
"""
    sim = Simulation.from_text(text)
    sim.run(until=3.0)
    assert sim.u[:3] + 3 * sim.u[6:9] == pytest.approx([0, 0.4, 0.2], abs=1e-12)
    assert sim.energies.dissipated > 0.1
    assert abs(sim.energies.residual) < 1e-11


@pytest.mark.parametrize(
    ("force", "line", "words"),
    [
        ("s: {type: spring, between: [ground, ball.rin], stiffness: 1}", 9, "Did you mean 'rim'?"),
        ("s: {type: spring, between: [ball, ball.rim], stiffness: 1}", 9, "connects 'ball' with itself"),
        ("s: {type: spring, between: [ground, ball]}", 9, "neither stiffness nor damping"),
        ("s: {type: spring, between: [ground, ball], stiffness: -1}", 9, "must be at least 0"),
        ("f: {type: force, at: ground, vector: [0, 0, 1]}", 9, "acts on ground"),
        ("f: {type: force, at: ball, vector: [0, 0]}", 9, "has 2 values, not 3"),
        ('f: {type: force, at: ball, vector: [0, 0, "__import__(1)"]}', 9, "unknown function '__import__'"),
        ("f: {type: force, at: ball, vector: [0, 0, 3*x]}", 9, "unknown name 'x'"),
        ("c: {type: couple, on: bal, vector: [0, 0, 1]}", 9, "Did you mean 'ball'?"),
        ("c: {type: coupel, on: ball, vector: [0, 0, 1]}", 9, "unknown type 'coupel'"),
    ],
)
def test_a_wrong_force_element_is_named_with_its_line_and_a_remedy(force, line, words):
    with pytest.raises(MechanismError) as caught:
        parse_mechanism(BALL.replace("FORCE", force))
    (problem,) = caught.value.problems
    assert problem.line == line
    assert words in str(problem)


def test_a_spring_whose_ends_coincide_at_the_start_is_refused():
    with pytest.raises(MechanismError, match="the ends coincide at the start"):
        ball("s: {type: spring, between: [ground, ball], stiffness: 1, length: 1}", start=("[3, 0, 0]", "[0, 0, 0]"))
