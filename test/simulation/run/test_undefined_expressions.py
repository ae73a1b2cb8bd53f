"""A step that fails because an expression has no finite value there: the error names the expression."""

from __future__ import annotations

import pytest

from mbd_sim import Ensemble, Simulation
from mbd_sim.base.errors import DivergedError
from mbd_sim.files.load import parse_mechanism

BEAD = """mechanism: bead
gravity: [0, 0, 0]
ground: {points: {o: [0, 0, 0]}}
parts: {bead: {mass: 1, inertia: [1, 1, 1], points: {dot: [0, 0, 0]}}}
joints:
  move:
    type: free
    between: [ground, bead]
    position: [0.5, 0, 1.0471975511965979]
    velocity: [1, 0, -1.1547005383792517]
"""
DRIVEN = """mechanism: crank
parameters: {end: 1}
parts: {disc: {mass: 1, inertia: [1, 1, 1]}, rod: {mass: 1, inertia: [1, 1, 1], center: [1, 0, 0]}}
joints:
  pin: {type: revolute, between: [disc, rod], axis: [0, 0, 1]}
  crank: {type: revolute, between: [ground, disc], axis: [0, 0, 1], drive: DRIVE}
"""
CASES = {
    "surface": (
        "constraints: {wire: {type: on_surface, point: bead.dot, equation: z - acos(x)}}",
        ":11: constraints.wire.equation: the expression has no finite value or derivative near t = 0.776",
    ),
    "curve": (
        "constraints: {wire: {type: on_curve, point: bead.dot, equations: [y, z - acos(x)]}}",
        ":11: constraints.wire.equations[1]: the expression has no finite value or derivative near t = 0.776",
    ),
    "spring": (
        "forces: {band: {type: spring, between: [ground.o, bead.dot], force: sqrt(1.3 - x)}}",
        ":11: forces.band.force: the expression has no finite value near x = 1.3",
    ),
    "force": (
        "forces: {push: {type: force, at: bead.dot, vector: [log(1 - t), 0, 0]}}",
        ":11: forces.push.vector[0]: the expression has no finite value near t = 1",
    ),
}


def failure(simulation: Simulation, n: int) -> str:
    with pytest.raises(DivergedError) as caught:
        simulation.step(n)
    return str(caught.value)


@pytest.mark.parametrize(("element", "words"), CASES.values(), ids=CASES)
def test_the_end_of_an_expression_is_named(element, words):
    simulation = Simulation.from_text(BEAD + element)
    text = failure(simulation, 5000)
    assert words in text
    assert "step of" not in text
    assert "smaller step" not in text


@pytest.mark.parametrize("drive", ["acos(t)"])
def test_the_end_of_a_drive_is_named(drive):
    text = failure(Simulation.from_text(DRIVEN.replace("DRIVE", drive)), 2000)
    assert ":6: joints.crank.drive: the expression has no finite value or derivative near t = 1" in text


def test_live_values_are_those_of_the_run():
    simulation = Simulation.from_text(DRIVEN.replace("DRIVE", "sqrt(end - t)"), live=["parameters.end"])
    simulation.set_live({"parameters.end": 0.5})
    text = failure(simulation, 2000)
    assert "joints.crank.drive: the expression has no finite value or derivative near t = 0.5" in text


def test_a_long_call_and_single_steps_name_the_same():
    simulation = Simulation.from_text(BEAD + CASES["surface"][0])
    before = simulation.state
    text = failure(simulation, 5000)
    assert simulation.state.tobytes() == before.tobytes()
    with pytest.raises(DivergedError) as caught:
        simulation.advance(5000)
    assert str(caught.value).split(" s. ", 1)[1] == text.split(" s. ", 1)[1]


def test_steps_that_are_too_large_are_still_answered_with_a_step():
    stiff = BEAD + "forces: {band: {type: spring, between: [ground.o, bead.dot], force: 1e9*x}}"
    assert "has no finite" not in (text := failure(Simulation.from_text(stiff, method="rk4"), 5000))
    assert "Try" in text


def member_failure(ensemble: Ensemble) -> str:
    with pytest.raises(DivergedError) as caught:
        ensemble.require_alive()
    return str(caught.value)


@pytest.mark.parametrize("method", ["gauss4"])
def test_an_ensemble_names_what_a_simulation_of_its_member_names(method):
    text = BEAD + CASES["surface"][0]
    ensemble = Ensemble(parse_mechanism(text), [{}, {"parts.bead.mass": 2}, {}], method=method)
    ensemble.step(100)
    ensemble.require_alive()
    ensemble.step(2000)
    single = Simulation.from_text(text, method=method)
    single.step(100)
    expected = failure(single, 2000)
    assert ":11: constraints.wire.equation: the expression has no finite value" in expected
    head = "3 of 3 members reached an infinite state, the first is member 0. "
    assert member_failure(ensemble) == head + expected


def test_the_values_and_inputs_of_the_failed_call_count():
    mechanism = parse_mechanism(DRIVEN.replace("DRIVE", "sqrt(end - t)"))
    ensemble = Ensemble(mechanism, [{"parameters.end": 2}, {"parameters.end": 0.5}])
    ensemble.step(300)
    ensemble.step(300)
    snapshot = ensemble.snapshot()
    ensemble.set_efforts([1.0])
    ensemble.step(50)
    text = member_failure(ensemble)
    assert "1 of 2 members reached an infinite state, the first is member 1. " in text
    assert "between t = 0.3 s and 0.6 s. " in text
    assert ":6: joints.crank.drive: the expression has no finite value or derivative near t = 0.5" in text
    ensemble.reset()
    ensemble.require_alive()
    ensemble.restore(snapshot)
    assert member_failure(ensemble) == text


def test_a_member_that_takes_too_large_steps_is_given_advice():
    ensemble = Ensemble.from_file("double_rod", [{}, {"joints.elbow.damping": 1e9}], method="rk4")
    ensemble.step(10)
    text = member_failure(ensemble)
    assert "the first is member 1" in text and "which has rates of" in text and "method rosenbrock" in text
