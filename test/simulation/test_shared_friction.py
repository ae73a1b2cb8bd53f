"""Contacts that share a load: they slip when it exceeds the sum of what they can hold, and not earlier."""

from __future__ import annotations

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.simulation.contact_records import ContactChange

G, MASS, RATE = 9.81, 2.0, 60.0  # a push of 60 N/s
UNTIL = 0.12  # s; it slips at 0.1 s


def pads(friction, static, count, height):
    """A block on pads in a line, which is pushed at a height above their plane with a force that grows."""
    places = np.linspace(-0.2, 0.2, count)
    points = ", ".join(f"p{number}: [{x}, 0, -0.1]" for number, x in enumerate(places))
    law = f"bound: at_least, friction: {friction}, static_friction: {static}"
    return Simulation.from_text(
        f"""
mechanism: pads
parts: {{block: {{mass: {MASS}, inertia: [0.1, 0.1, 0.1], points: {{{points}, push: [0, 0, {height - 0.1}]}}}}}}
joints: {{f: {{type: planar, axis: [0, 1, 0], x_axis: [1, 0, 0], between: [ground, block], position: [0, -0.1, 0]}}}}
constraints: {{{", ".join(f"c{i}: {{type: on_plane, point: block.p{i}, {law}}}" for i in range(count))}}}
forces: {{push: {{type: force, at: block.push, vector: ["{RATE}*t", 0, 0]}}}}
"""
    )


def box(friction, static, angle, height):
    """A block on its corners in space, which is pushed in a direction along the floor."""
    push = [f"{RATE * np.cos(angle)}*t", f"{RATE * np.sin(angle)}*t", 0]
    return Simulation.from_text(
        f"""
mechanism: box
parts: {{block: {{shape: {{type: block, mass: {MASS}, size: [0.4, 0.3, 0.1]}}, points: {{push: [0, 0, {height - 0.05}]}}}}}}
joints: {{f: {{type: free, between: [ground, block], position: [0, 0, 0.05]}}}}
contacts: {{floor: {{parts: [block], plane: ground, friction: {friction}, static_friction: {static}}}}}
forces: {{push: {{type: force, at: block.push, vector: {push}}}}}
"""
    )


def slipping(friction, static, time):
    """The time at which the blocks begin to slip, and their speed later."""
    start = static * MASS * G / RATE
    return start, (0.5 * RATE * (time**2 - start**2) - friction * MASS * G * (time - start)) / MASS


@pytest.mark.parametrize("height", [0.0, 0.1, 0.15])
@pytest.mark.parametrize(
    ("friction", "static", "count"), [(0.3, 0.3, 2), (0.2, 0.3, 2), (0.0, 0.3, 2), (0.3, 0.3, 3), (0.2, 0.3, 3)]
)
def test_pads_in_a_line_slip_at_the_sum_of_their_limits(friction, static, count, height):
    simulation = pads(friction, static, count, height)
    simulation.run(until=UNTIL)
    start, speed = slipping(friction, static, UNTIL)
    slips = [event.time for event in simulation.contact_events if event.change is ContactChange.SLIDES]
    assert slips == pytest.approx([start] * len(slips), abs=1e-10) and len(slips) >= 2
    assert simulation.u[0] == pytest.approx(speed, abs=1e-10)
    assert abs(simulation.energies.residual) < 1e-13


@pytest.mark.parametrize(
    ("friction", "static", "angle", "height"), [(0.2, 0.3, 0.0, 0.07), (0.2, 0.3, 1.2, 0.0), (0.3, 0.3, 0.5, 0.0)]
)
def test_a_box_slips_at_the_sum_of_the_limits_of_its_corners(friction, static, angle, height):
    """In space a part of the load is shared anew at each of a few events, up to 1e-7 of the sum."""
    simulation = box(friction, static, angle, height)
    simulation.run(until=UNTIL)
    start, speed = slipping(friction, static, UNTIL)
    events = [event for event in simulation.contact_events if event.change is not ContactChange.OPENED]
    assert all(event.change is not ContactChange.BOUND for event in events)
    assert np.hypot(*simulation.u[:2]) == pytest.approx(speed, abs=1e-7)
    slips = [event.time for event in events if event.change is ContactChange.SLIDES]
    assert slips[0] == pytest.approx(start, abs=1e-7)
    assert abs(simulation.energies.residual) < 1e-13


def test_shared_friction_at_rest_stays_within_each_limit():
    simulation = pads(0.2, 0.3, 2, 0.1)
    while simulation.time < 0.095:
        simulation.step(5)
        states = simulation.contacts()
        assert sum(state.friction[0] for state in states.values()) == pytest.approx(-RATE * simulation.time, abs=1e-12)
        assert all(abs(state.friction[0]) <= 0.3 * state.normal * (1.0 + 1e-9) for state in states.values())
        assert abs(simulation.q[0]) < 1e-18


def test_friction_by_a_force_that_redundant_joints_share_is_remarked():
    """A door on two hinges; with one alone its force is determined."""
    text = """
mechanism: door
ground: {points: {top: [0, 0, 2]}}
parts: {door: {mass: 20, center: [0.4, 0, 1], inertia: [2, 2.5, 0.5], points: {top: [0, 0, 2]}}}
joints:
  low: {type: revolute, between: [ground, door], axis: [0, 0, 1], velocity: 1, friction: {coefficient: 0.2, radius: 0.01}}
"""
    hinge = "  high: {type: revolute, between: [ground.top, door.top], axis: [0, 0, 1]}\n"
    (remark,) = Simulation.from_text(text + hinge).remarks
    assert remark.startswith("friction of 'low' depends on forces that redundant joints share")
    determined = Simulation.from_text(text)
    assert determined.remarks == ()
    moment = 0.2 * 0.01 * np.linalg.norm(determined.reactions()["low"].force)
    assert determined.contacts()["low.friction"].friction == pytest.approx([-moment], rel=1e-12)
