"""Two feet of a body that tilts: friction at rest cannot hold both, however slowly they part."""

import math

import pytest

from mbd_sim import Simulation

LEGS = """
mechanism: two_legs
ground: {points: {high: [0, 0, 0.2]}}
parts:
  slide: {mass: 0.5, inertia: [0.01, 0.01, 0.01]}
  body: {mass: 1, inertia: [0.02, 0.03, 0.01], points: {left: [-0.1, 0, 0], right: [0.1, 0, 0]}}
  left: {shape: {type: particle, mass: 0.2}}
  right: {shape: {type: particle, mass: 0.2}}
joints:
  sway: {type: planar, between: [ground.high, slide], axis: [0, 0, 1]}
  tilt: {type: revolute, between: [slide, body], axis: [0, 1, 0], drive: "MOST*sin(2*t)"}
  left: {type: prismatic, between: [body.left, left], axis: [0, 0, -1], position: 0.2, stiffness: 100, rest: 0.5}
  right: {type: prismatic, between: [body.right, right], axis: [0, 0, -1], position: 0.2, stiffness: 100, rest: 0.4}
contacts:
  floor: {parts: [left, right], plane: ground, friction: 1}
"""
PUSH = 'forces: {push: {type: force, at: slide, vector: ["56*sin(7*t)", 0, 0]}}'


def test_of_two_feet_that_part_the_one_with_less_load_slides():
    """Perpendicular to a body, feet at a distance of l along it are l / cos φ apart: they part at about l φ φ'.

    That is 1e-6 of gravity and less, so that friction at rest could seem to balance it; but the left one stays in place.
    """
    most = 3e-3
    sim = Simulation.from_text(LEGS.replace("MOST", str(most)), step=1e-3, method="tsitouras8")
    sim.step(10)
    place = sim.poses()["left"].position[0]
    for _ in range(4):
        sim.step(500)
        left, right = (sim.poses()[name].position[0] for name in ("left", "right"))
        assert left == pytest.approx(place, abs=1e-13)
        assert right - left == pytest.approx(0.2 / math.cos(most * math.sin(2.0 * sim.time)), abs=1e-16)
    states = {name: contact.state for name, contact in sim.contacts().items()}
    assert states == {"floor.left_on_ground": "sticks", "floor.right_on_ground": "slides"}
    assert abs(sim.energies.residual) < 1e-11


def test_friction_that_yields_lets_the_other_slide_on_however_slow_it_is():
    """A push makes both feet slide now and then, beside slips that count as zero when they stop by themselves."""
    sim = Simulation.from_text(LEGS.replace("MOST", "3e-4") + PUSH, step=1e-3, method="tsitouras8")
    sim.step(760)
    changes = [event.change for event in sim.contact_events]
    assert "bound" not in changes
    assert len(changes) < 30
    assert abs(sim.energies.residual) < 1e-10
