"""Rolling and blades: which velocity constraints are integrable."""

import pytest

from mbd_sim import Simulation
from mbd_sim.analysis.mechanics.mobility import integrable_rows


def verdicts(simulation):
    rows = simulation.model.equations.rows
    return {rows[index].name: verdict for index, verdict in integrable_rows(simulation.model.equations).items()}


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("four_bar", {}),
        ("rolling_disc", {"rolling: slip 1": False, "rolling: slip 2": False}),
        ("upright_wheel", {"rolling: slip 1": True, "rolling: slip 2": True}),
        ("knife_edge", {"blade: sideways motion": False}),
    ],
)
def test_textbook_verdicts(name, expected):
    found = verdicts(Simulation.from_file(name))
    assert list(found.values()) == list(expected.values())


BLADE = """
mechanism: blade
gravity: [0, 0, 0]
parts: {blade: {mass: 2, inertia: [0.1, 0.1, 0.1]}}
joints: {JOINT}
constraints:
  edge: {type: knife_edge, at: blade, direction: [1, 0, 0]}
"""


def test_a_blade_that_cannot_turn_is_holonomic():
    sliding = """
  x: {type: prismatic, between: [ground, carriage], axis: [1, 0, 0]}
  y: {type: prismatic, between: [carriage, blade], axis: [0, 1, 0]}"""
    text = BLADE.replace("{JOINT}", sliding).replace("parts: {", "parts: {carriage: {mass: 1}, ")
    assert verdicts(Simulation.from_text(text)) == {"edge: sideways motion": True}


def test_a_blade_that_turns_is_not():
    plane = "\n  p: {type: planar, between: [ground, blade], axis: [0, 0, 1]}"
    assert verdicts(Simulation.from_text(BLADE.replace("{JOINT}", plane))) == {"edge: sideways motion": False}


def test_a_blade_turned_by_a_drive_depends_on_time():
    """With the heading driven at Ω, -x' sin Ωt + y' cos Ωt = 0 is not a function of x, y and t."""
    turning = """
  x: {type: prismatic, between: [ground, carriage], axis: [1, 0, 0]}
  y: {type: prismatic, between: [carriage, slide], axis: [0, 1, 0]}
  turn: {type: revolute, between: [slide, blade], axis: [0, 0, 1], drive: 2*t}"""
    text = BLADE.replace("{JOINT}", turning).replace("parts: {", "parts: {carriage: {mass: 1}, slide: {mass: 1}, ")
    assert verdicts(Simulation.from_text(text)) == {"edge: sideways motion": False}
