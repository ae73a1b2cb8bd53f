"""Pairs of shapes that meet within a step, that pass each other, and that cannot be computed."""

import json

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.base.errors import MechanismError

FLIGHT = """
mechanism: flight
gravity: [0, 0, 0]
parts: {{a: {{shape: {first}}}, b: {{shape: {second}}}}}
joints:
  a: {{type: free, between: [ground, a], position: {place}, velocity: {velocity}}}
  b: {{type: {joint}, between: [ground, b]}}
contacts: {{hit: {{between: [a, b], restitution: 1}}}}
"""
LINE = "{{type: prismatic, between: [ground, a], axis: [0, 0, 1], position: 1, velocity: -600}}"
BALL = "{type: sphere, mass: 1, radius: 5 mm}"
DISC = "{type: disc, mass: 5, radius: 0.2}"
POST = "{type: cylinder, mass: 5, radius: 0.2, length: 1}"
BAR = "{type: cylinder, mass: 1, radius: 0.1, length: 1, axis: [1, 0, 0]}"


def flight(first, second, place, velocity, joint="fixed"):
    text = FLIGHT.format(first=first, second=second, place=place, velocity=velocity, joint=joint)
    return Simulation.from_text(text, method="tsitouras8")


def test_small_balls_that_pass_each_other_within_a_step_hand_over_their_speed():
    """They fly 6 cm in a step, and are 2 cm long together."""
    simulation = flight(BALL, BALL, [-1.53, 0, 0], [60, 0, 0], "free")
    q, u = simulation.q.copy(), simulation.u.copy()
    for start in (-1.53, -1.5, -1.517, -1.5601):
        simulation.reset(q=[start, *q[1:]], u=u)
        simulation.run(until=0.1)
        assert simulation.u[0] == pytest.approx(0.0, abs=1e-9) and simulation.u[6] == pytest.approx(60.0, rel=1e-12)


def test_a_ball_far_beside_a_disc_passes_and_one_that_falls_on_it_rebounds():
    ball = "{type: sphere, mass: 1, radius: 0.1}"
    passing = flight(ball, DISC, [-1, 0, 5], [1, 0, 0])
    passing.run(until=2.0)
    assert passing.q[0] == pytest.approx(1.0, abs=1e-12) and not passing.contact_events
    falling = passing
    falling.reset(q=[0.05, 0, 1.1, 1, 0, 0, 0], u=[0, 0, -1, 0, 0, 0])
    falling.run(until=1.5)
    assert falling.u[2] == pytest.approx(1.0, rel=1e-12)
    assert falling.contact_events[0].time == pytest.approx(1.0, abs=1e-12)


def test_a_bar_that_flies_across_a_post_is_struck_by_an_impulse_at_its_nearest_point():
    """By hand: the impulse 2 v / (1/m + x²/I) at x from the center of the bar, with I = m (3 r² + l²) / 12."""
    simulation = flight(BAR, POST, [0.4, 1, 0], [0, -1, 0])
    simulation.run(until=1.0)
    (event,) = simulation.contact_events
    assert event.time == pytest.approx(0.7, abs=1e-12)
    impulse, inertia = 2.0 / (1.0 + 0.16 / (1.03 / 12.0)), 1.03 / 12.0
    assert event.impulse == pytest.approx(impulse, rel=1e-12)
    assert simulation.u == pytest.approx([0, impulse - 1, 0, 0, 0, -0.4 * impulse / inertia], abs=1e-12)


def test_cylinders_that_never_touch_along_their_axis_are_refused():
    text = """
mechanism: planes
parts: {a: {shape: {type: disc, mass: 1, radius: 0.1}}, b: {shape: {type: disc, mass: 1, radius: 0.1}}}
joints:
  a: {type: planar, between: [ground, a], axis: [0, 0, 1]}
  b: {type: planar, between: [ground.high, b], axis: [0, 0, 1], position: [1, 0, 0]}
ground: {points: {high: [0, 0, HEIGHT]}}
contacts: {hit: {between: [a, b]}}
"""
    assert Simulation.from_text(text.replace("HEIGHT", "0"), method="tsitouras8").contacts()[
        "hit"
    ].gap == pytest.approx(0.8)
    with pytest.raises(MechanismError, match=r"never touch: they are 0.3 m apart"):
        Simulation.from_text(text.replace("HEIGHT", "0.3"), method="tsitouras8")


def test_two_discs_in_space_are_refused():
    """As two plates are: one coin would pass through another one within a step."""
    text = FLIGHT.replace("{{type: free, between: [ground, a], position: {place}, velocity: {velocity}}}", LINE)
    ring = "{type: ring, mass: 1, radius: 0.1}"
    with pytest.raises(MechanismError, match=r"contacts\.hit: 'a' and 'b' have no thickness.*Give a cylinder"):
        Simulation.from_text(text.format(first=ring, second=DISC, joint="fixed"), method="tsitouras8")


def discs(axes):
    """A disc flies past a ring at rest, 0.02 m off its center, in a plane across the last of the axes (3, 3)."""
    x, _, z = axes.tolist()
    shapes = {"a": {"type": "disc", "radius": 0.1}, "b": {"type": "ring", "radius": 0.07}}
    joint = {"type": "planar", "axis": z, "x_axis": x}
    return {
        "mechanism": "discs",
        "gravity": [0, 0, 0],
        "parts": {name: {"shape": {**shape, "axis": z, "mass": 1}} for name, shape in shapes.items()},
        "joints": {
            "a": {**joint, "between": ["ground", "a"]},
            "b": {**joint, "between": ["ground", "b"], "position": [0.5, 0.02, 0], "velocity": [-1, 0, 0]},
        },
        "contacts": {"c": {"between": ["a", "b"]}},
    }


@pytest.mark.parametrize(("digits", "tolerance"), [(16, 1e-12), (6, 1e-5)])
def test_discs_without_thickness_strike_each_other_in_any_plane(digits, tolerance):
    """In a plane of no two axes of ground they flew through each other."""
    turned = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]
    sim = Simulation.from_text(json.dumps(discs(np.round(turned, digits))))
    sim.run(until=0.6)
    along = np.array([np.sqrt(0.17**2 - 0.02**2), 0.02]) / 0.17
    lost = 0.5 * along[0] * along  # half of the approach speed goes over, in a plastic impact of equal masses
    assert sim.u[:2] == pytest.approx(-lost, abs=tolerance)
    assert sim.u[3:5] == pytest.approx(np.array([-1, 0]) + lost, abs=tolerance)
