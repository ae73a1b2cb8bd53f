"""Steps with guards: what ends a step, that how they are compiled does not show, and histories between events."""

from __future__ import annotations

import math
import pickle
from dataclasses import replace

import numpy as np
import pytest

from mbd_sim import DivergedError, Ensemble, Simulation
from mbd_sim.compiler import kernel as kernel_module
from mbd_sim.compiler.code import machine_code
from mbd_sim.compiler.steps.adams_history import COUNT
from mbd_sim.integrators.explicit import EXPLICIT, adams
from mbd_sim.integrators.methods import METHODS

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


@pytest.mark.parametrize(("ceiling", "each"), [(0.1, 1), (0.1103, 3)])
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


def test_arrays_in_registers_or_in_memory_give_the_same_bits(monkeypatch, own_builds):
    """With events, optimized or not, with single steps as well as many in a call, of a history and of one step."""
    found = []
    for few, level, each in ((0, 1, 1), (10**9, 0, 50)):
        monkeypatch.setattr(kernel_module, "FEW", few)
        monkeypatch.setattr(machine_code, "LEVEL", level)
        sim = Simulation.from_file("stops", method="adams11")
        for _ in range(600 // each):
            sim.step(each)
        assert {event.name for event in sim.contact_events} == {"slide.lower_limit", "slide.upper_limit"}
        found.append((sim.state.tobytes(), sim.error_estimate, sim.contact_events))
    assert found[0] == found[1]


# With events in free flight, and slip that ends.
WITH_EVENTS = ["elbow_stop", "bowling"]


@pytest.mark.parametrize("name", WITH_EVENTS)
def test_steps_with_a_history_may_be_divided_in_any_way(name):
    """An event begins a new history, wherever in a call it is; snapshots carry it."""
    at_once, singly, divided, copy = (Simulation.from_file(name, method="adams11") for _ in range(4))
    at_once.step(700)
    for _ in range(700):
        singly.step()
    for n in (1, 9, 10, 11, 30, 139, 200, 300):
        divided.step(n)
        if divided.steps == 400:
            copy.restore(pickle.loads(pickle.dumps(divided.snapshot())))
            copy.step(300)
    for sim in (singly, divided, copy):
        assert sim.state.tobytes() == at_once.state.tobytes()
        assert sim.history.tobytes() == at_once.history.tobytes()
    assert singly.contact_events == divided.contact_events == at_once.contact_events


@pytest.mark.parametrize(("name", "start", "steps"), [("elbow_stop", 0, 100), ("bowling", 1600, 400)])
def test_a_history_lasts_while_modes_stay(name, start, steps):
    """With everything open, and with closed contacts that stick; not beyond an event."""
    sim = Simulation.from_file(name, method="adams11")
    sim.step(start)
    known = len(sim.contact_events)
    sim.step(steps)
    assert len(sim.contact_events) == known
    assert sim.history[COUNT] >= steps
    while len(sim.contact_events) == known and name != "bowling":
        sim.step()
    assert not np.any(sim.history) or name == "bowling"


def test_a_call_that_fails_leaves_the_history_as_it_was():
    """Here after an event: the same bits as without the call. The effort law ends, with its last steps in the call."""
    text = """
mechanism: ends
parameters: {t_end: 0.3505}
parts: {rod: {mass: 1, center: [0, 0, -1], inertia: [0.1, 0.1, 0.1]}}
joints:
  pin:
    type: revolute
    between: [ground, rod]
    axis: [0, 1, 0]
    position: 1
    limits: {lower: 0.8, upper: 2, restitution: 0.5}
forces: {law: {type: effort, coordinate: pin, effort: "sqrt(t_end - t)"}}
"""
    run, other = (Simulation.from_text(text, method="adams11") for _ in range(2))
    for sim in (run, other):
        sim.step(100)
    for n in (400, 1000):
        with pytest.raises(DivergedError):
            run.step(n)
    assert run.history.tobytes() == other.history.tobytes()
    run.step(220)
    other.step(220)
    assert run.contact_events != ()
    assert run.state.tobytes() == other.state.tobytes()


def test_the_order_between_events(monkeypatch):
    """Of a method that goes on with any error, with fewer slopes, so that round-off is far away.

    Something slides, in a loop; the run ends before the first event.
    """
    method = replace(adams("free", 5, math.inf, EXPLICIT["tsitouras8"]), name="free")
    monkeypatch.setitem(METHODS, "free", method)
    until, step = 0.06, 0.0004

    def state(method, step):
        sim = Simulation.from_file("slider_crank_friction", method=method, step=step)
        sim.step(round(until / step))
        assert sim.contact_events == ()
        return sim.state

    exact = state("dop853", step / 10.0)
    coarse, fine = (np.max(np.abs(state("free", step / n) - exact)) for n in (1, 2))
    assert fine > 1e-13
    assert coarse / fine > 2.0 ** (method.order - 0.6)


def test_a_member_of_an_ensemble_takes_the_same_steps():
    ensemble, single = (
        Ensemble.from_file("elbow_stop", 2, method="adams11"),
        Simulation.from_file("elbow_stop", method="adams11"),
    )
    q, u = np.tile(single.q, (2, 1)), np.tile(single.u, (2, 1))
    ensemble.reset(q, u)
    ensemble.step(433)
    ensemble.step(367)
    single.step(800)
    assert single.contact_events
    for member in range(2):
        assert single.state.tobytes() == ensemble.state[member].tobytes()
