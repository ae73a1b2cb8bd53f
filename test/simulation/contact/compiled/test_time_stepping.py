"""Compiled steps of time stepping beside those of the code for all contacts, from the same states."""

import numpy as np
import pytest

from mbd_sim import DivergedError, Ensemble, Simulation
from mbd_sim.files.load import parse_mechanism
from mbd_sim.simulation.contact.time_stepping.stepper import TimeStepper
from test.generators.body_scenes import SCENES, scene
from test.generators.contact_mechanisms import contact_mechanism
from test.simulation.contact.compiled.both_ways import Both

# Two boxes that fall onto each other and a floor that rises: features, quaternions, a drive, and dependent rows.
BOXES = """
mechanism: boxes
integrator: {method: moreau, step: 2 ms}
parts:
  box_{i}: {for: {i: 1..2}, shape: {type: block, mass: 1, size: [0.2, 0.16, 0.1]}}
  table: {shape: {type: block, mass: 1, size: [1, 1, 0.1]}}
joints:
  table: {type: prismatic, between: [ground, table], axis: [0, 0, 1], drive: "-0.05 + 0.02*sin(9*t)"}
  box_{i}: {for: {i: 1..2}, type: free, between: [ground, "box_{i}"], position: [0.02, 0, "0.13*i - 0.055"],
            orientation: {quaternion: [1, "0.1*i", 0.03, "0.02*i"]}}
contacts:
  on_table: {between: [table, box_1], friction: 0.4, restitution: 0.2}
  boxes: {between: [box_1, box_2], friction: 0.4, restitution: 0.2}
"""


KINDS = {"four_bar": 3, "slider_crank": 4, "rotors": 2, "sliders": 2, "ball": 3, "plane_loop": 4, "space_floor": 3}


@pytest.mark.parametrize("kind", KINDS)
def test_steps_are_those_of_the_code_for_all_contacts(kind):
    """Random loops, joints with friction, clutches, corners and pairs of bodies with features."""
    make = scene if kind in SCENES else contact_mechanism
    both = Both(Simulation.from_text(make(KINDS[kind], kind), method="moreau"))
    both.compare(200 if kind in SCENES else 100)  # bodies fall at first
    assert both.acting > 5 and both.left <= 2


def test_friction_at_rest_holds_more_than_sliding_friction():
    both = Both(Simulation.from_file("belt", method="moreau"))
    both.compare(120)
    assert both.acting > 80 and both.left == 0


def test_boxes_that_share_forces_on_a_driven_table_too():
    """Faces that touch at four corners, of bodies with quaternions; the drive does work in each step."""
    simulation = Simulation.from_text(BOXES)
    both = Both(simulation)
    both.compare(50)
    assert both.acting >= 30 and both.left <= 2
    assert np.max(np.abs(simulation._memory.y[-2])) > 0.01


@pytest.fixture
def taken(monkeypatch):
    """The steps that are taken by the code for all contacts."""
    steps, take = [], TimeStepper._take

    def counted(self, y, inputs, step, *others):
        steps.append(step)
        return take(self, y, inputs, step, *others)

    monkeypatch.setattr(TimeStepper, "_take", counted)
    return steps


def test_a_step_whose_restitution_is_reduced_is_left_alone_and_the_others_go_on(taken):
    """A corner strikes with friction, so that Newton's law would add energy."""
    simulation = Simulation.from_text(contact_mechanism(0, "block"), method="moreau")
    simulation.step(300)
    reduced = [event for event in simulation.contact_events if event.factor < 1.0]
    assert [round(event.time / simulation.step_size) - 1 for event in reduced] == taken == [241]
    assert simulation.time == pytest.approx(0.3)


def test_what_is_observed_or_was_remembered_changes_no_bit():
    """Distances that are remembered, and energies that observers need, must not decide how a step is taken."""

    class Observer:
        def event(self, _):
            """Nothing."""

        def impact(self, *_):
            """Nothing."""

    plain, observed = (Simulation.from_text(BOXES) for _ in range(2))
    observed._memory.stepper.observer = Observer()
    plain.run(until=0.2)
    snapshot = plain.snapshot()
    plain.run(until=0.3)
    observed.run(until=0.3)
    assert plain.contact_event_count > 0
    assert np.array_equal(plain.y, observed.y)
    fresh = Simulation.from_text(BOXES)
    fresh.restore(snapshot)
    for _ in range(50):
        fresh.step()
    assert np.array_equal(plain.y, fresh.y)


def test_members_are_stepped_in_compiled_code_up_to_a_step_that_is_left(taken):
    mechanism = parse_mechanism(contact_mechanism(0, "block"))
    choices = [{"constraints.cp5.restitution": 1.0}, {"constraints.cp0.restitution": 0.5}]
    ensemble = Ensemble(mechanism, choices, method="moreau")
    ensemble.step(300)
    assert 241 in taken and len(taken) < 5
    for choice, q, u in zip(choices, ensemble.q, ensemble.u, strict=True):
        single = Simulation(mechanism, set=choice, method="moreau")
        single.step(300)
        assert np.array_equal([q, u], [single.q, single.u])


def test_a_state_that_does_not_stay_finite_ends_the_run_with_the_last_one():
    simulation = Simulation.from_text(contact_mechanism(0, "block"), method="moreau")
    simulation.step(3)
    before = simulation.y.copy()
    simulation.set_efforts(np.full(len(simulation.u), 1e308))
    with pytest.raises(DivergedError):
        simulation.step(50)
    assert np.array_equal(simulation.y, before)
