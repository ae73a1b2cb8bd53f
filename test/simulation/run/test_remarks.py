"""Contacts that a step may miss are named with a step that finds them, and others are not."""

import math

import pytest

from mbd_sim import Simulation
from mbd_sim.simulation.contact.records import ContactChange

BALLS = """
mechanism: balls
gravity: [0, 0, 0]
parts: {a: {shape: {type: sphere, mass: 1, radius: 5 mm}}, b: {shape: {type: sphere, mass: 1, radius: 5 mm}}}
joints:
  a: {type: free, between: [ground, a], position: [-1.53, 0, 0], velocity: [60, 0, 0]}
  b: {type: free, between: [ground, b]}
contacts: {hit: {between: [a, b], stiffness: 1e8, exponent: 1}}
"""
ROD = """
mechanism: rod
gravity: [0, 0, 0]
parts: {rod: {shape: {type: rod, mass: 1, to: [1, 0, 0]}}}
joints:
  f: {type: JOINT, axis: [0, -1, 0], x_axis: [1, 0, 0], between: [ground, rod.middle], position: [0, 0.6, 0], velocity: [0, -1, SPEED]}
contacts: {floor: {parts: [rod], plane: ground, restitution: 1}}
"""
RING = ROD.replace("type: rod, mass: 1, to: [1, 0, 0]", "type: disc, mass: 1, radius: 0.1, axis: [0, 1, 0]").replace(
    ".middle", ""
)


def test_small_compliant_balls_that_pass_each_other_within_a_step_are_named_and_the_proposed_step_finds_them():
    """They are 2 cm long together and fly 6 cm in a step; of equal masses and without losses the second flies on."""
    coarse = Simulation.from_text(BALLS, step=0.001)
    (remark,) = coarse.remarks
    assert "bodies at 'hit' move by up to 0.06 m in a step of 0.001 s" in remark and "Try step 1e-05" in remark
    coarse.run(until=0.1)
    assert coarse.u[0] == 60.0 and coarse.step_advice == remark
    fine = Simulation.from_text(BALLS, step=1e-5)
    assert fine.remarks == ()
    fine.run(until=0.03)
    assert fine.step_advice is None and fine.u[6] == pytest.approx(60.0, rel=1e-2)


def rod(speed, step):
    text = ROD.replace("JOINT", "planar").replace("SPEED", str(speed)).replace("parts: {rod: {", PARTS, 1)
    return Simulation.from_text(text, step=step)


PARTS = "parts: {rod: {points: {middle: [0.5, 0, 0]}, "


def test_a_rod_that_turns_too_far_in_a_step_is_named_and_the_proposed_step_finds_its_contact():
    """A rod turns by whole turns in a step, so that its ends are always level; h = sin(w t) / 2 decides the contact."""
    speed = 2.0 * math.pi / 0.001
    coarse = rod(speed, 0.001)
    (remark,) = coarse.remarks
    assert "parts at 'floor' turn by 6.28 rad in a step of 0.001 s" in remark and "Try step 5e-05" in remark
    fine = rod(speed, 5e-5)
    assert fine.remarks == () and fine.step_advice is None
    fine.run(until=0.12)
    first = next(event for event in fine.contact_events if event.change is ContactChange.IMPACT)
    height = 0.6 - first.time
    assert height == pytest.approx(0.5 * abs(math.sin(speed * first.time)), abs=1e-9)
    assert first.time == pytest.approx(0.1, abs=2.5e-4)  # the first quarter turn below 0.5 m


def test_a_wheel_and_a_ball_that_spin_are_not_named_as_their_gaps_do_not_change():
    wheel = Simulation.from_text(RING.replace("JOINT", "planar").replace("SPEED", "5000"))
    assert wheel.remarks == () and wheel.step_advice is None


def test_a_cam_along_whose_axis_a_ball_moves_is_named():
    text = """
mechanism: cam
parts: {ball: {shape: {type: sphere, mass: 1, radius: 0.05}}}
joints: {f: {type: FOLLOWER}}
contacts: {rides: {parts: [ball], cam: ground, profile: "0.3 + 0.05*cos(angle)"}}
"""
    free = "free, between: [ground, ball], position: [0.5, 0, 0]"
    (remark,) = Simulation.from_text(text.replace("FOLLOWER", free)).remarks
    assert remark.startswith("the cam of 'rides' is endless along its axis, along which 'ball' moves")
    slide = "prismatic, axis: [1, 0, 0], between: [ground, ball], position: 0.5"
    assert Simulation.from_text(text.replace("FOLLOWER", slide)).remarks == ()
