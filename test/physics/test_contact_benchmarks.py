"""Published benchmarks of one-sided mechanics, and closed forms of rigid bodies that bounce and spin."""

import math

import numpy as np
import pytest

from mbd_sim import Simulation

G = 9.81


def test_the_woodpecker_toy_on_its_limit_cycle():
    """Glocker 1995; Leine, van Campen & Glocker 2003; digits of an independent event-driven computation."""
    sim = Simulation.from_file("woodpecker")
    sim.run(until=0.3)
    y, sleeve, bird, _ = sim.q
    assert [y, sleeve, sleeve + bird] == pytest.approx([-0.0413274160834, -0.103448275862, -0.342373855108], abs=1e-10)
    y, sleeve, bird, _ = sim.u
    assert [y, sleeve, sleeve + bird] == pytest.approx([-0.259184922605, 0.0, -8.34282414371], abs=1e-10)
    assert abs(sim.energies.residual) < 1e-14


def test_the_woodpecker_approaches_its_limit_cycle_at_the_published_rate():
    sim = Simulation.from_file("woodpecker")
    heights, times = [], []
    while sim.time < 9.0:
        sim.step(1)
        strikes = [event.time for event in sim.contact_events[-6:] if (event.name, event.change) == ("beak", "impact")]
        if strikes and (not times or strikes[-1] > times[-1]):
            times.append(strikes[-1])
            heights.append(sim.q[0])
    periods = np.diff(times)
    errors = periods - 0.145976065144
    assert errors[25:30] / errors[24:29] == pytest.approx([-0.839] * 5, abs=1e-3)
    assert abs(errors[-1]) < 1e-8
    assert np.diff(heights)[-1] == pytest.approx(-0.0194453793, rel=0.02)  # read up to a step later


STICK = """
mechanism: impacting_stick
gravity: [0, 0, -10]
parameters: {e: 1, mu: 0.01}
parts:
  rod:
    shape: {type: rod, mass: 1, from: [-0.5, 0, 0], to: [0.5, 0, 0]}
    points: {low: [-0.5, 0, 0], high: [0.5, 0, 0]}
joints:
  rod:
    type: planar
    between: [ground, rod]
    axis: [0, -1, 0]
    x_axis: [1, 0, 0]
    position: [0.353553390593, 0.363553390593, 45 deg]
    velocity: [-0.5, 0.1, -0.1]
constraints:
  low: {type: on_plane, point: rod.low, bound: at_least, restitution: e, friction: mu}
  high: {type: on_plane, point: rod.high, bound: at_least, restitution: e, friction: mu}
"""


def test_the_impacting_stick_of_siconos():
    sim = Simulation.from_text(STICK)
    before = sim.energies.total
    sim.run(until=1.0)
    times = [event.time for event in sim.contact_events if event.change == "impact"]
    assert times[:2] == pytest.approx([0.0602740890931, 0.163275784400], abs=1e-11)
    assert sim.energies.total <= before
    assert abs(sim.energies.residual) < 1e-13


BALL = {"R": 0.1, "mu": 0.2, "z0": 1.0}


def spinning(e, spin, vx=0.0):
    return Simulation.from_file("spinning_ball", set={**BALL, "eN": e, "w0": spin, "vx": vx, "x0": 0.0})


def test_a_ball_at_rest_bounces_as_a_particle():
    """Capobianco, Harsch, Eugster & Leine 2021, sec. 10.1, case a."""
    sim = spinning(0.5, 0.0)
    sim.run(until=1.5)
    first = math.sqrt(2.0 * 0.9 / G)
    times = [event.time for event in sim.contact_events if event.change == "impact"]
    expected = first * (1.0 + 2.0 * np.cumsum([0.0, *(0.5**k for k in range(1, len(times)))]))
    assert times == pytest.approx(expected, abs=1e-7)
    assert times[:6] == pytest.approx(expected[:6], abs=1e-13)
    assert sim.q[0] == 0.0


@pytest.mark.parametrize(("spin", "sticks"), [(50.0, False), (10.0, True)])
def test_a_spinning_ball_that_does_not_rebound_slides_and_then_rolls(spin, sticks):
    """Cases b and c: friction in the impact is limited by μ times the normal impulse, or stops the slip."""
    sim = spinning(0.0, spin)
    landing = math.sqrt(2.0 * 0.9 / G)
    sim.run(until=landing + 2e-3)
    normal = G * landing  # of 1 kg
    inertia = 0.4 * 0.01
    needed = 0.1 * spin / (1.0 + 0.01 / inertia)
    impulse = needed if sticks else 0.2 * normal
    assert sticks == (needed < 0.2 * normal)
    since = sim.time - landing
    slide = 0.0 if sticks else 0.2 * G * since
    assert sim.u[0] == pytest.approx(impulse + slide, abs=1e-12)
    assert sim.u[2] == pytest.approx(spin - 0.1 * (impulse + slide) / inertia, abs=1e-10)
    sim.run(until=2.5)
    assert sim.u[0] == pytest.approx(0.1 * sim.u[2], abs=1e-14)
    assert sim.u[0] == pytest.approx(needed, abs=1e-12)  # the moment of momentum about the contact is conserved


def test_a_rod_that_slides_upright_with_large_friction_stops_at_once():
    """Painlevé's rod: for μ > 4/3 no finite force keeps it sliding; an impulse without collision stops the slip."""
    text = """
mechanism: painleve
parameters: {mu: 2.5, tilt: 60 deg}
parts:
  rod:
    shape: {type: rod, mass: 1, from: [-1, 0, 0], to: [1, 0, 0]}
    points: {tip: [-1, 0, 0]}
joints:
  rod:
    type: planar
    between: [ground, rod]
    axis: [0, -1, 0]
    x_axis: [1, 0, 0]
    position: [cos(tilt), sin(tilt), tilt]
    velocity: [V, 0, 0]
constraints:
  floor: {type: on_plane, point: rod.tip, bound: at_least, friction: mu}
"""
    painful, harmless = (Simulation.from_text(text.replace("V", speed)) for speed in ("-1.5", "1.5"))
    assert (painful.contacts()["floor"].state, harmless.contacts()["floor"].state) == ("sticks", "slides")
    assert np.max(np.abs(painful.contacts()["floor"].slip)) < 3e-15  # m/s of 1.5, extrapolated from two solutions
    assert harmless.contacts()["floor"].slip[0] == pytest.approx(1.5, abs=1e-15)
    assert painful.losses.impact > 0.1 > harmless.losses.impact == 0.0
    for sim in (painful, harmless):
        start = sim.start_energy
        sim.run(until=2.0)
        assert sim.energies.total < start
        assert abs(sim.energies.residual) < 1e-11


@pytest.mark.parametrize("speed", [-1, 0, 1])
def test_a_rod_that_stops_at_once_on_a_sled_leaves_that_sliding(speed):
    """Where not all slip can stop there is an impulse as well: the sled's friction takes up 0.2 of that on the floor."""
    text = """
mechanism: painleve_on_a_sled
parts:
  sled: {mass: 3, inertia: [1, 1, 1], points: {left: [-2, 0, 0], right: [2, 0, 0]}}
  rod:
    shape: {type: rod, mass: 1, from: [-1, 0, 0], to: [1, 0, 0]}
    points: {tip: [-1, 0, 0]}
joints:
  sled: {type: planar, between: [ground, sled], axis: [0, -1, 0], x_axis: [1, 0, 0], velocity: [SPEED, 0, 0]}
  rod:
    type: planar
    between: [ground, rod]
    axis: [0, -1, 0]
    x_axis: [1, 0, 0]
    position: [0.5, 0.8660254037844386, 60 deg]
    velocity: [-2.5, 0, 0]
constraints:
  left: {type: on_plane, point: sled.left, bound: at_least, friction: 0.2}
  right: {type: on_plane, point: sled.right, bound: at_least, friction: 0.2}
  tip: {type: on_plane, point: rod.tip, plane: sled, bound: at_least, friction: 2.5}
"""
    sim = Simulation.from_text(text.replace("SPEED", str(speed)))
    contacts = sim.contacts()
    assert {name: contact.state for name, contact in contacts.items()} == {
        "left": "slides", "right": "slides", "tip": "sticks",
    }  # fmt: skip
    assert abs(contacts["tip"].slip[0]) < 3e-15
    along, up = 3.0 * (sim.u[0] - speed) + sim.u[3] + 2.5, sim.u[4]
    assert up > 0.1 and along == pytest.approx(-math.copysign(0.2, sim.u[0]) * up, rel=1e-13)
    sim.run(until=1.0)
    assert sim.losses.impact > 0.1 and abs(sim.energies.residual) < 1e-13
