"""What happens within single steps, where no estimate sees it, is remarked."""

import pytest

from mbd_sim import Simulation

PUSHED = """
mechanism: pushed
gravity: [0, 0, 0]
parts: {m: {mass: 1}}
joints: {x: {type: prismatic, between: [ground, m], axis: [1, 0, 0]}}
forces: {push: {type: effort, coordinate: x, effort: "EFFORT"}}
"""
BUSHING = """
mechanism: turner
gravity: [0, 0, 0]
parts: {m: {mass: 1, inertia: [0.1, 0.1, 0.1]}}
joints: {x: {type: revolute, between: [ground, m], axis: [0, 0, 1], velocity: SPEED}}
forces: {f: {type: bushing, between: [ground, m], rotational_stiffness: 1}}
"""


@pytest.mark.parametrize(
    "effort", ["where(t > 0.01045, where(t < 0.01055, 9, 0), 0)", "where(t > 5.00045, where(t < 5.00055, 9, 0), 0)",
               "9*exp(-((t - 0.5005)/1e-4)**2)"]
)  # fmt: skip
def test_a_force_shorter_than_a_step_is_remarked(effort):
    (remark,) = Simulation.from_text(PUSHED.replace("EFFORT", effort)).remarks
    assert "forces.push.effort changes within the step" in remark


@pytest.mark.parametrize("effort", ["sin(6*t)", "5*t", "where(t > 0.01, 1, 0)", "where(t > 0.01, exp(-t), 0)"])
def test_forces_that_steps_resolve_are_not_remarked(effort):
    assert Simulation.from_text(PUSHED.replace("EFFORT", effort)).remarks == ()


def test_a_bushing_that_turns_past_half_a_turn_is_named_in_the_advice():
    simulation = Simulation.from_text(BUSHING.replace("SPEED", "12"))
    simulation.run(until=3.0)
    assert "'f' reverses where a bushing turns past half a turn" in simulation.step_advice
    simulation = Simulation.from_text(BUSHING.replace("SPEED", "5"))
    simulation.run(until=3.0)
    assert simulation.step_advice is None


def test_a_linearization_says_whether_it_changes_along_the_motion():
    falling = Simulation.from_file("double_rod")
    falling.run(until=0.5)
    assert "A changes along the motion at 0.5 s" in falling.linearize().remark
    assert Simulation.from_text(BUSHING.replace("SPEED", "0")).linearize().remark == ""
