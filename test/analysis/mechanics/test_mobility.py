"""Degrees of freedom by the textbooks' count and by rank."""

import pytest

from mbd_sim.analysis.mechanics.mobility import mobility
from mbd_sim.dynamics.equations import derive
from mbd_sim.files.load import load_mechanism, parse_mechanism
from test.pictures.start import AtStart


def counted(mechanism):
    mechanism = load_mechanism(mechanism) if isinstance(mechanism, str) else mechanism
    equations = derive(mechanism)
    return mobility(mechanism, equations.rows, equations.start, AtStart(mechanism).poses())


@pytest.mark.parametrize(
    ("name", "kutzbach", "planar", "freedoms", "redundant"),
    [
        ("double_rod", 2, 2, 2, 0),
        ("four_bar", -2, 1, 1, 3),
        ("slider_crank", -2, 1, 1, 3),
        ("constrained_pendulum", None, 1, 1, 0),
        ("a02_four_bars", -5, 1, 1, 6),
        ("a04_bricard", 0, None, 1, 1),
        ("rolling_disc", 3, None, 3, 0),
        ("upright_wheel", 0, 1, 1, 1),
        ("knife_edge", 2, 2, 2, 0),
        ("box_bryan", 3, None, 3, 0),
    ],
)
def test_textbook_counts(name, kutzbach, planar, freedoms, redundant):
    found = counted(name)
    if kutzbach is not None:
        assert found.kutzbach == kutzbach
    assert found.planar_kutzbach == planar
    assert found.degrees_of_freedom == freedoms
    assert len(found.redundant) == found.static_indeterminacy == redundant


def test_the_count_and_the_rank_agree_once_redundant_equations_are_left_out():
    for name in ("four_bar", "driveline"):
        found = counted(name)
        assert found.kutzbach + len(found.redundant) == found.degrees_of_freedom


def test_redundant_equations_are_named_by_joint_and_direction():
    assert counted("four_bar").redundant == (
        "rocker_pin: displacement along y",
        "rocker_pin: tilt of the axis, 1",
        "rocker_pin: tilt of the axis, 2",
    )


def test_a_driven_joint_takes_its_freedom():
    found = counted("moving_support_pendulum")
    assert (found.gross, found.joint_equations, found.kutzbach, found.degrees_of_freedom) == (12, 11, 1, 1)


PARALLELOGRAM = """
mechanism: parallelogram
ground: {points: {far: [1, 0, 0]}}
parts:
  left: {mass: 1, shape: {type: rod, to: [1, 0, 0]}, points: {tip: [1, 0, 0]}}
  top: {mass: 1, shape: {type: rod, to: [1, 0, 0]}, points: {tip: [1, 0, 0]}}
  right: {mass: 1, shape: {type: rod, to: [1, 0, 0]}, points: {tip: [1, 0, 0]}}
joints:
  a: {type: revolute, between: [ground, left], axis: [0, -1, 0], position: ANGLE}
  b: {type: revolute, between: [left.tip, top], axis: [0, -1, 0], position: -ANGLE}
  c: {type: revolute, between: [ground.far, right], axis: [0, -1, 0], position: ANGLE}
  d: {type: revolute, between: [top.tip, right.tip], axis: [0, -1, 0]}
"""


def test_the_rank_at_a_singular_start_is_distinguished():
    """A parallelogram that lies flat has one freedom more there, but not along its motion."""
    flat = counted(parse_mechanism(PARALLELOGRAM.replace("ANGLE", "0")))
    assert (flat.rank_at_start, flat.rank, flat.degrees_of_freedom) == (1, 2, 1)
    upright = counted(parse_mechanism(PARALLELOGRAM.replace("ANGLE", "1.2")))
    assert (upright.rank_at_start, upright.rank, upright.redundant) == (2, 2, flat.redundant)
