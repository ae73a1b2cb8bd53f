"""Slip along two directions that counts as zero, where friction begins to slide in another direction."""

import functools
import math

import pytest

from mbd_sim import Simulation

SLOW = 1e-9  # m/s
LIMIT = 0.5 * 9.81  # N
HEIGHT = 0.05  # m, from which it falls for 0.101 s
SLED = """
mechanism: sled
parts: {sled: {mass: 1, inertia: [1, 1, 1], points: {o: [0, 0, 0]}}}
joints: {sled: {type: free, between: [ground, sled], position: [0, 0, HEIGHT], velocity: [BACK, SPEED, 0]}}
constraints: {floor: {type: on_plane, point: sled.o, bound: at_least, friction: 0.5}}
forces: {pull: {type: force, at: sled, vector: [FORCE, 0, 0]}}
"""


def sled(speed, force, height=0.0, back=0.0):
    values = {"SPEED": speed, "FORCE": force, "HEIGHT": height, "BACK": back}
    return Simulation.from_text(functools.reduce(lambda text, key: text.replace(key, repr(values[key])), values, SLED))


def test_friction_that_begins_to_slide_is_against_the_force_and_not_across_it():
    """The kernel has the direction of slip, however slow that is: it would turn friction by a right angle."""
    sim = sled(SLOW, 6.0)
    assert sim.contacts()["floor"].friction == pytest.approx([-LIMIT, 0.0], abs=1e-9)
    assert sim.contacts()["floor"].slip == pytest.approx([0.0, 0.0], abs=1e-12 * SLOW)
    assert sim.losses.impact == pytest.approx(0.5 * SLOW**2, rel=1e-9)
    sim.run(until=0.5)
    assert sim.u[:2] == pytest.approx([(6.0 - LIMIT) * 0.5, 0.0], abs=1e-12)


def test_what_an_impact_leaves_of_a_slip_ends_before_it_slides_along_a_force():
    """The compiled search of modes leaves that to Python, or friction would turn for a nanosecond."""
    landing = math.sqrt(2.0 * HEIGHT / 9.81)
    sim = sled(0.5 * 9.81 * landing + SLOW, 6.0, HEIGHT, -6.0 * landing)
    sim.run(until=0.2)
    assert sim.u[0] == pytest.approx((6.0 - LIMIT) * (0.2 - landing), abs=1e-13)


def test_a_slip_that_does_not_count_as_zero_turns():
    """One of 1e-6 m/s goes on, and friction turns it within microseconds."""
    sim = sled(1e-6, 6.0)
    assert sim.contacts()["floor"].friction == pytest.approx([0.0, -LIMIT], abs=1e-9)
    assert sim.losses.impact == 0.0
