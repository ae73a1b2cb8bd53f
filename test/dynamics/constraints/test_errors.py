"""Mechanisms that cannot be assembled are refused: the messages and their locations."""

from __future__ import annotations

import pytest

from mbd_sim.base.errors import MechanismError
from test.generators.mechanisms import derived

FOUR_BAR = """
mechanism: four_bar
parameters: {crank: 0.5, coupler: 1.4, rocker: 1.2}
ground: {points: {pivot: [1.5, 0, 0]}}
parts:
  crank: {mass: 1, shape: {type: rod, to: [crank, 0, 0]}, points: {tip: [crank, 0, 0]}}
  coupler: {mass: 1, shape: {type: rod, to: [coupler, 0, 0]}, points: {tip: [coupler, 0, 0]}}
  rocker: {mass: 1, shape: {type: rod, to: [rocker, 0, 0]}, points: {tip: [rocker, 0, 0]}}
joints:
  a: {type: revolute, between: [ground, crank], axis: [0, -1, 0], START}
  b: {type: revolute, between: [crank.tip, coupler], axis: [0, -1, 0], position: C_GUESS, guess: true}
  c: {type: revolute, between: [ground.pivot, rocker], axis: [0, -1, 0], position: R_GUESS, guess: true}
  d: {type: revolute, between: [coupler.tip, rocker.tip], axis: [0, -1, 0]}
"""


def four_bar(crank, coupler, rocker, more=""):
    """The text of a four-bar with a given crank angle and guesses of the other angles."""
    text = FOUR_BAR.replace("START", f"position: {crank}" + (f", {more}" if more else ""))
    return text.replace("C_GUESS", str(coupler)).replace("R_GUESS", str(rocker))


def refused(text):
    """The problems with which a mechanism is refused."""
    with pytest.raises(MechanismError) as caught:
        derived(text)
    for problem in caught.value.problems:
        assert problem.message and problem.remedy and problem.line > 0
    return [str(problem) for problem in caught.value.problems]


USUAL = four_bar(1.0, -1.0, 1.8)


def test_a_loop_that_cannot_close_is_named_with_its_joints_and_its_gap():
    """Links of 0.1, 0.2 and 0.3 over a base of 1.5 leave 0.9 open, stretched out."""
    short = USUAL.replace("crank: 0.5, coupler: 1.4, rocker: 1.2", "crank: 0.1, coupler: 0.2, rocker: 0.3")
    (problem,) = refused(short.replace("position: 1.0", "position: 1.0, guess: true"))
    assert "joints.d: the loop of a, b, d, c remains open here by at least 0.9 m" in problem
    assert "Check the lengths" in problem


def test_given_positions_that_keep_a_loop_open_are_named():
    (problem,) = refused(USUAL.replace("position: -1.0, guess: true", "position: 2.5"))
    assert "joints.d: the loop of a, b, d, c remains open here by " in problem
    assert "with the given positions" in problem
    assert "without the given positions of a, b" in problem
    assert "guess: true" in problem


def test_velocities_that_contradict_each_other_are_named():
    text = USUAL.replace("position: 1.0", "position: 1.0, velocity: 2").replace(
        "guess: true}", "guess: true, velocity: 3}", 1
    )
    (problem,) = refused(text)
    assert "joints.d: the given velocities violate the loop of a, b, d, c" in problem
    assert "Give fewer of a, b" in problem


def test_two_drives_of_one_freedom_contradict_each_other():
    text = USUAL.replace("position: 1.0", "drive: 1 + t").replace("position: -1.0, guess: true", "drive: -0.9 + t^2")
    problems = refused(text.replace("drive: -0.9", "drive: -1.0"))
    assert any("joints.d: the loop of a, b, d, c" in problem for problem in problems)


def test_a_drive_of_a_constrained_joint_is_refused():
    """The strut fixes the pendulum, which the drive would rotate."""
    (problem,) = refused(
        """
mechanism: constrained
ground: {points: {o: [1, 0, 0]}}
parts: {rod: {mass: 1, shape: {type: rod, to: [0, 0, -1]}, points: {tip: [0, 0, -1]}}}
joints: {pin: {type: revolute, between: [ground, rod], axis: [0, -1, 0], drive: 0.1*sin(t)}}
constraints: {strut: {type: distance, between: [ground.o, rod.tip], length: sqrt(2)}}
"""
    )
    assert "constraints.strut: this constraint leaves no freedom for the drive of pin" in problem
    assert "Remove a drive or a constraint." in problem


def test_a_rigid_assembly_is_refused():
    text = USUAL.replace(
        "joints:", "constraints: {strut: {type: distance, between: [ground, coupler.tip], length: 1.8}}\njoints:"
    )
    (problem,) = refused(text.replace("position: 1.0", "position: 1.0, guess: true"))
    assert "nothing can move: the 6 equations of d, strut leave none of the 3 degrees of freedom" in problem
    assert "Remove a joint or a constraint." in problem


def test_a_loop_of_welds_only_is_rigid():
    (problem,) = refused(
        """
mechanism: welded
parts: {a: {mass: 1}}
joints:
  one: {type: fixed, between: [ground, a]}
  two: {type: fixed, between: [a, ground]}
"""
    )
    assert "nothing can move" in problem


DOT = """
mechanism: dot
ground: {points: {top: [0, 0, 1.5], far: [4, 0, 1.5]}}
parts: {dot: {mass: 1, inertia: [1, 1, 1], points: {p: [0, 0, 0.5]}}}
joints: {place: {type: free, between: [ground, dot], position: [0, 0, 1], orientation: {rpy: [0, 0, 0]}}}
constraints: {k: CONSTRAINT}
"""


def one_constraint(text):
    return refused(DOT.replace("CONSTRAINT", text))


def test_a_constraint_that_cannot_be_satisfied_is_reported_with_its_gap():
    (problem,) = one_constraint("{type: on_surface, point: dot, equation: x^2 + y^2 + 4}")
    assert "constraints.k: this constraint " in problem
    assert " by at least 4" in problem


def test_a_given_position_that_a_constraint_forbids_is_named():
    (problem,) = one_constraint("{type: on_plane, point: dot.p}")
    assert "constraints.k: this constraint " in problem
    assert " by 1.5 m with the given positions" in problem
    assert "without the given positions of place" in problem


@pytest.mark.parametrize(
    "text",
    [
        "{type: cable, through: [ground.top, dot.p, ground.far], length: 4}",
        "{type: on_surface, point: dot, equation: sqrt(z - 1)}",
        "{type: on_surface, point: dot, equation: z - 1 + sqrt(t)}",
        "{type: on_surface, point: dot, equation: log(-1 - x^2)}",
        "{type: rolling, wheel: dot, axis: [0, 0, 1], radius: 1}",
        "{type: knife_edge, at: dot, direction: [0, 0, 1]}",
    ],
)
def test_a_constraint_without_a_finite_value_or_derivative_is_named(text):
    (problem,) = one_constraint(text)
    assert "constraints.k: has no finite value, or no finite derivative, at the start" in problem


def test_constraints_that_depend_on_time_must_be_satisfiable_later():
    """The rods have the right length at the start, but the block cannot follow their growth."""
    problems = refused(
        """
mechanism: growing
ground: {points: {o: [1, 0, 0]}}
parts: {block: {mass: 1, points: {p: [0, 0, 1]}}}
joints: {slide: {type: prismatic, between: [ground, block], axis: [0, 1, 0]}}
constraints:
  one: {type: distance, between: [ground, block], length: 1 + t}
  two: {type: distance, between: [ground, block], length: 1 - t}
"""
    )
    assert all("leaves no freedom for an expression of time" in problem for problem in problems)
