"""Friction whose limit is zero at the start: clutches and brakes that are released, and loads that grow from nothing."""

import math

import pytest

from mbd_sim import Simulation
from mbd_sim.simulation.contact.candidates import Forced

MASS = """
mechanism: mass
gravity: [0, 0, 0]
parts: {s: {mass: 1, inertia: [1, 1, 1]}}
"""
SLIDER = MASS + "joints: {s: {type: prismatic, between: [ground, s], axis: [1, 0, 0]}}\n"
LOADED = SLIDER.replace("axis: [1, 0, 0]", "axis: [1, 0, 0], friction: {coefficient: 0.3}")
PLANAR = MASS + "joints: {s: {type: planar, between: [ground, s], axis: [0, -1, 0], x_axis: [1, 0, 0]}}\n"
BRAKE = 'constraints: {{c: {{type: clutch, terms: {{s: 1}}, capacity: "{}"}}}}\n'
EFFORT = 'forces: {{p: {{type: effort, coordinate: s, effort: "{}"}}}}\n'
SLANTED = 'forces: {p: {type: force, at: s, vector: ["5*t", 0, "-10*t"]}}\n'
FLOOR = "constraints: {c: {type: on_plane, point: s, bound: at_least, friction: 0.3}}\n"


def test_a_brake_that_is_released_at_the_start_acts_later():
    """The effort grows from 0.02 s on and the capacity, ten times as fast, from 0.1 s on; no stage is beyond a kink."""
    text = SLIDER + BRAKE.format("max(0, 10*(t - 0.1))") + EFFORT.format("max(0, t - 0.02)")
    sim = Simulation.from_text(text, method="dop853")
    sim.run(until=0.1)
    assert (sim.q[0], sim.u[0]) == (pytest.approx(0.08**3 / 6, abs=1e-15), pytest.approx(0.08**2 / 2, abs=1e-15))
    sim.run(until=0.3)
    last = (0.08 + math.sqrt(0.08**2 + 18 * 0.08**2 / 2)) / 9
    way = 0.08**3 / 6 + 0.08**2 / 2 * last + 0.04 * last**2 - 1.5 * last**3
    event = sim.contact_events[-1]
    assert (event.change, event.time) == ("sticks", pytest.approx(0.1 + last, abs=1e-13))
    assert (sim.q[0], sim.u[0]) == (pytest.approx(way, abs=1e-15), 0.0)


def test_a_brake_that_is_released_while_a_mass_turns_acts_later():
    """A mass on a spring turns at π s, before the brake acts; as with a brake that is never quite released."""
    spring = SLIDER.replace("axis: [1, 0, 0]", "axis: [1, 0, 0], stiffness: 1, position: 1")
    released, dragging = (
        Simulation.from_text(spring + BRAKE.format(f"max({least}, 0.2*(t - 4))"), step=0.01, method="tsitouras8")
        for least in (0, 1e-14)
    )
    for sim in (released, dragging):
        sim.run(until=10.0)
    assert released.q[0] == pytest.approx(dragging.q[0], abs=1e-12) and abs(released.q[0]) > 0.1
    assert (released.u[0], released.contacts()["c"].state) == (0.0, "sticks")
    assert released.contact_events[-1].time == pytest.approx(dragging.contact_events[-1].time, abs=1e-12)


@pytest.mark.parametrize("text", [SLIDER + BRAKE.format("3*t") + EFFORT.format("5*t"), PLANAR + FLOOR, LOADED])
def test_friction_whose_limit_grows_from_zero_slips_at_once(text):
    """5 N/s drive the mass and 3 N/s of friction brake it."""
    sim = Simulation.from_text(text if "forces" in text else text + SLANTED, method="tsitouras8")
    sim.run(until=0.1)
    assert sim.q[0] == pytest.approx(2.0 * 0.1**3 / 6.0, abs=1e-15)
    assert sim.u[0] == pytest.approx(2.0 * 0.1**2 / 2.0, abs=1e-15)
    assert sim.contact_events[-1].time < 2e-9


def test_friction_that_bears_nothing_is_not_at_its_limit():
    """An event has decided that it is overloaded, and other contacts bear its load now; it has no direction to slide in."""
    memory = Simulation.from_text(PLANAR + FLOOR, method="tsitouras8")._memory
    find = memory.stepper._finder.find
    assert list(find(*memory.now, Forced(overloaded=frozenset({0})))) == list(find(*memory.now))
