"""Assembly: which values are kept, which branch is found, and the speeds at the start."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given

from mbd_sim.base.errors import MechanismError
from mbd_sim.dynamics.constraints.assembly import close_loops, nearest_speeds
from mbd_sim.dynamics.equations import derive
from mbd_sim.dynamics.math.rank import null_space, rank_of, unit_rows
from mbd_sim.files.load import load_mechanism, parse_mechanism
from test.dynamics.constraints.test_errors import FOUR_BAR, four_bar
from test.generators.loops import random_mechanisms, with_same_mechanisms
from test.generators.mechanisms import derived
from test.oracles import kane


def closed_form(crank, open_branch):
    """Angles of coupler (from the crank) and rocker of the four-bar, by the law of cosines."""
    tip = 0.5 * np.array([np.cos(crank), np.sin(crank)])
    line = np.array([1.5, 0.0]) - tip
    distance = np.linalg.norm(line)
    inside = np.arccos((1.4**2 + distance**2 - 1.2**2) / (2.0 * 1.4 * distance))
    coupler = np.arctan2(line[1], line[0]) + (inside if open_branch else -inside)
    pin = tip + 1.4 * np.array([np.cos(coupler), np.sin(coupler)])
    return coupler - crank, np.arctan2(pin[1], pin[0] - 1.5)


@pytest.mark.parametrize(("crank", "open_branch"), [(0.3, True), (1.5707963, False), (2.5, False), (-1.0, True)])
def test_the_branch_is_chosen_by_rough_guesses(crank, open_branch):
    coupler, rocker = closed_form(crank, open_branch)
    away = 0.25
    start = derived(four_bar(crank, coupler + away, rocker - away)).start
    assert start.q == pytest.approx([crank, coupler, rocker], abs=1e-12)


def test_given_positions_are_kept_to_the_last_bit():
    start = derived(four_bar(0.1 + 0.2, -1.0, 1.8)).start
    assert start.q[0] == 0.1 + 0.2


def test_other_guesses_are_tried_around_one_that_is_far_off():
    start = derived(four_bar(1.2, 3.0, -3.0))
    assert np.abs(np.array(start.violation(0.0, start.start_state))).max() < 1e-11


def test_an_assembled_mechanism_is_not_changed():
    """Up to round-off."""
    coupler, rocker = closed_form(1.0, True)
    start = derived(four_bar(1.0, coupler, rocker)).start
    assert start.q == pytest.approx([1.0, coupler, rocker], abs=1e-15)


def test_given_velocities_are_kept_and_the_others_follow():
    """With one degree of freedom one velocity is enough."""
    equations = derived(four_bar(1.0, -1.0, 1.8, "velocity: 2"))
    assert equations.start.u[0] == 2.0
    slope = 1e-5
    (c1, r1), (c2, r2) = (closed_form(1.0 + sign * slope, True) for sign in (-1.0, 1.0))
    rates = [2.0, (c2 - c1) / slope, (r2 - r1) / slope]
    assert equations.start.u == pytest.approx(rates, abs=1e-8)


def test_without_velocities_the_start_is_at_rest():
    assert not derived(four_bar(1.0, -1.0, 1.8)).start.u.any()


PLANAR = """
mechanism: sliding_rod
parts: {rod: {mass: 2, shape: {type: rod, to: [0, 0, -1]}, points: {tip: [0, 0, -1]}}}
joints:
  place: {type: planar, axis: [0, -1, 0], x_axis: [1, 0, 0], between: [ground, rod], POSITION}
constraints:
  floor: {type: on_plane, point: rod.tip, normal: [0, 0, 1]}
  drive: {type: coupling, terms: {place.x: 1, place.angle: 0.3}, value: 0.5*t}
"""


def test_unspecified_speeds_have_the_least_kinetic_energy():
    equations = derived(PLANAR.replace("POSITION", "position: [0, 1, 0.4], guess: true"))
    q, u = equations.start.q, equations.start.u
    gradient, drift = equations.constraints.gradient(0.0, q), equations.constraints.drift(0.0, q)
    assert gradient @ u + drift == pytest.approx(np.zeros(2), abs=1e-14)
    momentum = equations.constraints.mass_matrix(0.0, q) @ u
    assert momentum @ null_space(gradient) == pytest.approx(np.zeros(1), abs=1e-14)
    assert u.any()


def test_guessed_positions_move_as_little_as_needed():
    """The displacement is perpendicular to the free directions, to first order in a small gap."""
    gap = 1e-4
    equations = derived(PLANAR.replace("POSITION", f"position: [0, {np.cos(0.4) + gap}, 0.4], guess: true"))
    before = np.array([0.0, np.cos(0.4) + gap, 0.4])
    gradient = equations.constraints.gradient(0.0, equations.start.q)
    off = np.array([gap, 0.3 * 0.4])  # of the floor and of the coupling
    assert np.abs(equations.constraints.position(0.0, before)) == pytest.approx(np.abs(off), rel=1e-3)
    assert (equations.start.q - before) @ null_space(gradient) == pytest.approx(np.zeros(1), abs=0.02)


def test_given_quaternions_are_kept_and_others_stay_unit():
    text = """
mechanism: ball_and_rod
parts:
  a: {mass: 1, inertia: [1, 2, 2.5], points: {p: [0.5, 0, 0]}}
  b: {mass: 1, inertia: [1, 2, 2.5], points: {p: [0.5, 0, 0]}}
ground: {points: {o: [1, 0, 0]}}
joints:
  one: {type: spherical, between: [ground, a], orientation: {axis: [0, 1, 0], angle: -0.4}, GUESS}
  two: {type: spherical, between: [ground.o, b], orientation: {axis: [0, 0, 1], angle: 2.5}, guess: true}
  pin: {type: spherical, between: [a.p, b.p], cut: true}
"""
    equations = derived(text.replace("GUESS", "guess: true"))
    q = equations.start.q
    assert [np.linalg.norm(q[:4]), np.linalg.norm(q[4:])] == pytest.approx([1.0, 1.0], abs=1e-15)
    assert np.abs(equations.constraints.position(0.0, q)).max() < 1e-10


def test_nearest_speeds_change_by_the_least_kinetic_energy():
    mechanism = load_mechanism("four_bar")
    equations, rng = derive(mechanism), np.random.default_rng(1)
    q, u = equations.start.q, rng.normal(size=3)
    found = nearest_speeds(equations.constraints, 0.0, q, u)
    mass = kane.equations(mechanism, q, u, np.zeros(3)).mass
    gradient = equations.constraints.gradient(0.0, q)
    assert gradient @ found == pytest.approx(np.zeros(len(gradient)), abs=1e-13)
    assert (mass @ (found - u)) @ null_space(gradient) == pytest.approx(np.zeros(1), abs=1e-13)


@with_same_mechanisms
@given(random_mechanisms())
def test_speeds_at_the_start_have_the_least_kinetic_energy_beside_drives(drawn):
    """By Kane's kinetic energy, which drives move as well: no change that the constraints allow would lessen it."""
    text, _ = drawn
    mechanism = parse_mechanism(text)
    try:
        equations = derive(mechanism)
    except MechanismError:  # nothing can move
        return
    start, constraints = equations.start, equations.constraints
    gradient = constraints.gradient(0.0, start.q)
    if not len(gradient) or rank_of(unit_rows(gradient)) < start.rank:
        return
    fixed = np.array([flag for joint in mechanism.joints.values() for flag in joint.fixed_speeds], dtype=bool)
    free = null_space(np.vstack([unit_rows(gradient), np.eye(len(start.u))[fixed]]))
    zeros = np.zeros(len(start.u))

    def kinetic(u):
        return kane.equations(mechanism, start.q, u, zeros).kinetic

    size = 1.0 + kinetic(start.u)
    for direction in free.T[:3]:
        assert abs(kinetic(start.u + direction) - kinetic(start.u - direction)) <= 1e-8 * size


def test_closing_does_not_change_fixed_coordinates():
    equations = derived(FOUR_BAR.replace("START", "position: 1").replace("C_GUESS", "-1").replace("R_GUESS", "1.8"))
    constraints, q = equations.constraints, equations.start.q + np.array([0.0, 0.1, 0.05])
    for free in ([True, True, False], [False, True, True]):
        closing = close_loops(constraints, 0.0, q, np.array(free))
        assert closing.closed
        assert closing.q[~np.array(free)].tolist() == q[~np.array(free)].tolist()
    stuck = close_loops(constraints, 0.0, q, np.zeros(3, dtype=bool))
    assert not stuck.closed
    assert stuck.q.tolist() == q.tolist()


def test_a_flat_parallelogram_starts_and_names_its_redundant_rows():
    """Its rank at the start is one less than elsewhere."""
    text = FOUR_BAR.replace("[1.5, 0, 0]", "[1.4, 0, 0]").replace("rocker: 1.2", "rocker: 0.5")
    equations = derive(
        parse_mechanism(text.replace("START", "position: 0").replace("C_GUESS", "0").replace("R_GUESS", "0"))
    )
    assert equations.start.ranks[0] == equations.start.rank - 1
    assert len(equations.start.independent) == equations.start.rank == 2


LARGE_SLIDER_CRANK = """
mechanism: large
parts:
  crank: {mass: 1, shape: {type: rod, to: [100, 0, 0]}, points: {tip: [100, 0, 0]}}
  rod: {mass: 1, shape: {type: rod, to: [300, 0, 0]}, points: {tip: [300, 0, 0]}}
  slide: {mass: 1}
joints:
  main: {type: revolute, between: [ground, crank], axis: [0, -1, 0], position: 1}
  pin: {type: revolute, between: [crank.tip, rod], axis: [0, -1, 0], position: -1.4, guess: true}
  rail: {type: prismatic, between: [ground, slide], axis: [1, 0, 0]}
  eye: {type: revolute, between: [rod.tip, slide], axis: [0, -1, 0]}
"""


def test_a_loop_of_hundreds_of_meters_is_closed():
    start = derived(LARGE_SLIDER_CRANK).start.q
    rod = -np.arcsin(100.0 * np.sin(1.0) / 300.0)
    exact = [1.0, rod - 1.0, 100.0 * np.cos(1.0) + 300.0 * np.cos(rod)]
    assert start == pytest.approx(exact, rel=1e-14)


def test_a_flat_loop_of_hundreds_of_meters_is_closed():
    """Newton's method converges slowly there, because the gaps change with the squares of the angles."""
    guessed = LARGE_SLIDER_CRANK.replace("position: 1}", "position: 0.4, guess: true}").replace("-1.4", "0.3")
    start = derived(guessed.replace("axis: [1, 0, 0]}", "axis: [1, 0, 0], position: 400}")).start.q
    assert start == pytest.approx([0.0, 0.0, 400.0], abs=1e-6)


VANISHING = """
mechanism: vanishing
parts: {slide: {mass: 0}, point: {mass: 1}}
joints:
  x: {type: prismatic, between: [ground, slide], axis: [1, 0, 0], position: 1, guess: true}
  z: {type: prismatic, between: [slide, point], axis: [0, 0, 1], position: 1}
constraints: {curve: {type: on_surface, point: point, equation: "1/x"}}
"""


def test_a_gap_that_vanishes_at_infinity_stays_open():
    with pytest.raises(MechanismError, match="curve: this constraint is violated"):
        derived(VANISHING)
