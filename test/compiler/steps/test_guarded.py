"""Steps with guards: what ends a step, and that how they are compiled does not show."""

from __future__ import annotations

import math

import pytest

from mbd_sim import Simulation
from mbd_sim.compiler import kernel as kernel_module

SPEED, GRAVITY, STEP = 1.4715, 9.81, 0.1  # the highest point, 0.11036 m, is reached in the middle of the second step
UPWARD = """
mechanism: upward
integrator: {step: 0.1}
parts:
  ball: {shape: {type: particle, mass: 1, radius: 0.04}}
joints:
  height:
    type: prismatic
    between: [ground, ball]
    axis: [0, 0, 1]
    velocity: 1.4715
    limits: {lower: -100, upper: CEILING, restitution: 1}
"""


@pytest.mark.parametrize("each", [1, 3])
@pytest.mark.parametrize("ceiling", [0.1, 0.11, 0.1103])
def test_a_gap_that_is_negative_only_within_a_step_closes(ceiling, each):
    sim = Simulation.from_text(UPWARD.replace("CEILING", str(ceiling)))
    for _ in range(3 // each):
        sim.step(each)
    (event,) = sim.contact_events
    approach = math.sqrt(SPEED**2 - 2.0 * GRAVITY * ceiling)
    assert event.time == pytest.approx((SPEED - approach) / GRAVITY, abs=1e-13)
    after = 3 * STEP - event.time
    assert sim.u[0] == pytest.approx(-approach - GRAVITY * after, abs=1e-13)
    assert sim.q[0] == pytest.approx(ceiling - approach * after - 0.5 * GRAVITY * after**2, abs=1e-13)


def test_a_gap_that_stays_positive_within_a_step_does_not_close():
    sim = Simulation.from_text(UPWARD.replace("CEILING", "0.1104"))
    sim.step(3)
    assert sim.contact_events == ()
    assert sim.u[0] == pytest.approx(SPEED - GRAVITY * 3 * STEP, abs=1e-14)


@pytest.mark.parametrize("method", ["rk4", "tsitouras8"])
def test_arrays_in_registers_or_in_memory_give_the_same_bits(monkeypatch, method):
    """With events, and with single steps as well as many in a call."""
    found = []
    for few, each in ((0, 1), (10**9, 1), (10**9, 50)):
        monkeypatch.setattr(kernel_module, "FEW", few)
        sim = Simulation.from_file("stops", method=method)
        for _ in range(600 // each):
            sim.step(each)
        assert {event.name for event in sim.contact_events} == {"slide.lower_limit", "slide.upper_limit"}
        found.append((sim.state.tobytes(), sim.error_estimate, sim.contact_events))
    assert found[0] == found[1] == found[2]
