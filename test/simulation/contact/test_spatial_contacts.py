"""Friction along two directions and many contacts at once: energy, stops, event bounds, and random mechanisms."""

import math

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.base.roots import first_zero
from mbd_sim.simulation.contact.compiled import step as compiled_step
from mbd_sim.simulation.contact.records import ContactChange
from test.generators.contact_mechanisms import contact_mechanism

PUCK = """
mechanism: puck
parameters: {mu: 0.3}
parts:
  puck:
    shape: {type: block, mass: 1, size: [0.2, 0.12, 0.08]}
    points: {a: [0.1, 0.06, -0.04], b: [-0.1, 0.06, -0.04], c: [-0.1, -0.06, -0.04], d: [0.1, -0.06, -0.04]}
joints:
  flight: {type: free, between: [ground, puck], position: [0, 0, 0.04], velocity: [0.8, 0.3, 0], angular_velocity: [0, 0, 6]}
constraints:
  a: {type: on_plane, point: puck.a, bound: at_least, friction: mu}
  b: {type: on_plane, point: puck.b, bound: at_least, friction: mu}
  c: {type: on_plane, point: puck.c, bound: at_least, friction: mu}
  d: {type: on_plane, point: puck.d, bound: at_least, friction: mu}
"""

BALL = """
mechanism: ball
parts:
  ball:
    shape: {type: sphere, mass: 6, radius: 0.11}
joints:
  ball: {type: free, between: [ground, ball], position: [0, 0, 0.11], velocity: [3.6, 4.8, 0]}
constraints:
  lane: {type: rolling, wheel: ball, radius: 0.11, friction: 0.12}
"""


def _residual(simulation):
    return abs(simulation.energies.residual)


def test_a_ball_rolls_in_any_direction_as_in_the_plane():
    """Slip of constant direction: rolling begins at 2 v₀ / (7 μ g), with 5/7 of the speed."""
    simulation = Simulation.from_text(BALL)
    simulation.run(until=2.0)
    rolls = [event.time for event in simulation._memory.stepper.events if event.change is ContactChange.STICKS]
    assert rolls == pytest.approx([2 * 6 / (7 * 0.12 * 9.81)], abs=1e-10)
    assert simulation.u[:2] == pytest.approx([3.6 * 5 / 7, 4.8 * 5 / 7], abs=1e-11)
    assert _residual(simulation) < 1e-11


@pytest.mark.parametrize("axis", ([0, 1, 0], [0.3, 1, -0.2]))
def test_a_ball_that_a_joint_holds_in_a_plane_rolls_on_a_face_that_is_tilted_against_it(axis):
    """Friction across the plane bears no load: with the in-plane size k of the normal, 2/5 becomes 2/(5 k²)."""
    across, normal, r, m = np.array(axis) / np.linalg.norm(axis), np.array([0.2, 0.5, 1.0]), 0.1, 2.0
    normal /= np.linalg.norm(normal)
    level = normal - across * (across @ normal)
    k = np.linalg.norm(level)
    along, gravity = np.cross(across, normal) / k, np.array([0.0, 0.0, -9.81])
    place = [0.0, float(np.cross(across, along) @ level * r / k**2), 0.0]
    simulation = Simulation.from_text(f"""
mechanism: held_ball
parts: {{ball: {{shape: {{type: sphere, mass: {m}, radius: {r}}}}}}}
joints: {{f: {{type: planar, between: [ground, ball], axis: {axis}, x_axis: {along.tolist()}, position: {place}}}}}
contacts: {{floor: {{parts: [ball], plane: ground, normal: {normal.tolist()}, restitution: 0, friction: 0.9}}}}
""")
    simulation.step(100)
    (contact,) = simulation.contacts().values()
    acceleration = gravity @ along / (1.0 + 0.4 / k**2)
    assert contact.state == "sticks"
    assert simulation.u[0] == pytest.approx(acceleration * simulation.time, rel=1e-12)
    assert contact.normal == pytest.approx(-m * (gravity @ level) / k**2, rel=1e-12)
    assert np.abs(contact.friction).tolist() == pytest.approx([m * abs(gravity @ along - acceleration)], rel=1e-11)


def test_a_puck_that_slides_and_spins_stops_at_once_and_for_ever():
    """On four indeterminate contacts; sliding and spinning end together, without residual."""
    simulation = Simulation.from_text(PUCK)
    simulation.run(until=1.5)
    rest = simulation.q.copy()
    assert np.max(np.abs(simulation.u)) < 1e-14
    assert _residual(simulation) < 1e-12
    simulation.run(until=2.5)
    assert np.array_equal(simulation.q[:3], rest[:3])


def test_an_impact_engages_a_one_way_clutch():
    """The play strikes, and the clutch must not let the second shaft fall behind the third without an impulse."""
    simulation = Simulation.from_text(contact_mechanism(22, "rotors"))
    simulation.run(until=1.0)
    assert _residual(simulation) < 1e-11


@pytest.mark.parametrize(("constant", "bound", "error"), [("MOST_EVENTS", 1, 1e-12), ("MOST_STAGES", 6, 1e-5)])
def test_beyond_the_bound_of_events_the_step_goes_on(request, monkeypatch, constant, bound, error):
    """The rest of that step may end inside an obstacle or with a wrong direction of friction; the next one corrects it."""
    text = contact_mechanism(1, "block", 0.8, 0.3)
    plain = Simulation.from_text(text)
    plain.run(until=1.7)
    assert all(event.change is not ContactChange.BOUND for event in plain.contact_events)
    monkeypatch.setattr(compiled_step, constant, bound)
    request.getfixturevalue("compiled_anew")
    simulation = Simulation.from_text(text)
    simulation.run(until=1.7)
    told = [event.text for event in simulation.contact_events if event.change is ContactChange.BOUND]
    assert told and "too many events" in told[0]
    assert _residual(simulation) < error
    assert min(state.gap for state in simulation.contacts().values()) > -1e-12
    assert simulation.energies.dissipated == pytest.approx(plain.energies.dissipated, rel=1e-3)


def test_friction_along_two_directions_keeps_the_order_of_the_method():
    """A ball that slides, and then rolls: errors against the closed form, for two step sizes."""
    errors = []
    for step in (1e-3, 5e-4):
        simulation = Simulation.from_text(BALL, method="rk4", step=step)
        simulation.run(until=2.0)
        assert [event.change for event in simulation.contact_events] == [ContactChange.STICKS]
        errors.append(float(np.max(np.abs(simulation.u[:2] - np.array([3.6, 4.8]) * 5 / 7))))
        assert _residual(simulation) < 36.0 * errors[-1] + 2e-11  # m v times that
    assert errors[1] < max(errors[0] * 1.2 / 2.0**4, 1e-11)


def test_a_jump_through_zero_is_located_after_it():
    assert first_zero(lambda s: 1.0 if s < 0.3 else -1.0, 1.0, 1.0, -1.0, 1e-13) == pytest.approx(0.3, abs=1e-15)
    assert first_zero(lambda s: 1.0 if s < 0.3 else -1.0, 1.0, 1.0, -1.0, 1e-13) >= 0.3


FAST = (0, 13, 21)  # rotors, sliders and a ball


@pytest.mark.parametrize("seed", FAST)
def test_random_mechanisms_never_gain_energy(seed):
    """All kinds of one-sided rows; energies before and after each impact are computed apart from its loss."""
    simulation = Simulation.from_text(contact_mechanism(seed))
    stepper, gains = simulation._memory.stepper, [0.0]
    impact = stepper._impact

    def measured(time, y, inputs, *rest):
        before = stepper._energy(time, y, inputs)
        impact(time, y, inputs, *rest)
        gains.append(stepper._energy(time, y, inputs) - before)

    stepper._impact = measured
    simulation.run(until=1.5)
    scale = 1.0 + abs(simulation.start_energy) + abs(simulation.energies.dissipated)
    assert math.isfinite(simulation.energies.total)
    assert max(gains) < 1e-12 * scale
    assert _residual(simulation) < 1e-11 * scale


@pytest.mark.parametrize("kind", ["four_bar"])
def test_elastic_impacts_without_friction_keep_the_energy(kind):
    simulation = Simulation.from_text(contact_mechanism(6, kind, 1.0, 0.0))
    simulation.run(until=2.0)
    assert simulation._memory.stepper.events
    assert abs(simulation.energies.total - simulation.start_energy) < 1e-10


def test_a_mechanism_that_friction_wedges_does_not_rebound():
    """One degree of freedom: its point would have to leave against friction that exceeds what presses it away."""
    simulation = Simulation.from_text(contact_mechanism(178, "spatial_four_bar"))
    simulation.run(until=0.2)
    (impact, *others) = simulation.contact_events
    assert impact.factor == 0.0 and "without restitution" in impact.text
    assert [event.change for event in others] == [ContactChange.CLOSED, ContactChange.STICKS]
    energies = simulation.energies
    assert impact.loss == energies.dissipated > 0.9 and energies.kinetic < 1e-25
    assert abs(energies.residual) < 1e-13
