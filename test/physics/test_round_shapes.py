"""Round bodies in contact with finite ones: closed forms, and the same motion as on a plane."""

from __future__ import annotations

import numpy as np
import pytest

from mbd_sim import Simulation

G = 9.81
SCENE = """
mechanism: scene
parts:
  a: {shape: SHAPE}
  b: {shape: {type: block, size: [2, 1, 0.2], mass: 1}, points: {top: [0, 0, 0.1]}}
joints:
  a: {type: free, between: [ground, a], START}
  b: {type: fixed, between: [ground, b]}
contacts: {k: {CONTACT}}
"""


def scene(shape, start, contact="between: [a, b]", friction=0.3):
    text = SCENE.replace("SHAPE", shape).replace("START", start)
    return Simulation.from_text(text.replace("CONTACT", f"{contact}, friction: {friction}"), method="tsitouras8")


CAN = "{type: cylinder, radius: 0.1, length: 0.1, mass: 2}"
UPRIGHT = (1.0, 0.0, 0.0, 0.0)


@pytest.fixture(scope="module")
def can():
    return scene(CAN, "position: [0, 0, 0.15]", friction=0.05)


def test_a_cylinder_rolls_on_a_block_and_leaves_its_edge(can):
    """At a constant speed; at the edge it is too fast to follow it, and flies."""
    speed, lying = 2.0, (np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0)  # the axis along -y
    can.reset(q=[0.5, 0.1, 0.2, *lying], u=[speed, 0.0, 0.0, 0.0, 0.0, -speed / 0.1])
    can.run(until=0.4)
    (time, *_) = {event.time for event in can.contact_events}
    assert time == pytest.approx(0.25, abs=1e-9)
    flown = 0.4 - 0.25
    assert can.q[:3] == pytest.approx([0.5 + speed * 0.4, 0.1, 0.2 - 0.5 * G * flown**2], abs=1e-9)
    assert can.u == pytest.approx([speed, 0.0, -G * flown, 0.0, 0.0, -speed / 0.1], abs=1e-9)
    assert abs(can.energies.residual) < 1e-12


def test_a_can_slides_on_a_block_as_on_a_plane(can):
    """Flat, spinning, on six points of its rim."""
    plane = scene(CAN, "position: [0, 0, 0.15]", "parts: [a], plane: b.top", friction=0.05)
    for simulation in (can, plane):
        simulation.reset(q=[0.3, 0.0, 0.15, *UPRIGHT], u=[0.4, 0.2, 0.0, 0.0, 0.0, 3.0])
        simulation.run(until=0.1)
    assert can.q == pytest.approx(plane.q, abs=1e-11)
    assert can.u == pytest.approx(plane.u, abs=1e-10)
    assert can.energies.dissipated == pytest.approx(plane.energies.dissipated, rel=1e-10)


def test_a_can_that_slides_over_an_edge_tips_where_its_pressure_reaches_the_edge(can):
    """The pressure is μ h ahead of the mass center at the height h, by the balance of moments."""
    can.reset(q=[0.93, 0.0, 0.15, *UPRIGHT], u=[0.6, 0.0, 0.0, 0.0, 0.0, 0.0])
    can.run(until=0.13)
    slowing, way = 0.05 * G, 1.0 - 0.05 * 0.05 - 0.93
    time = (0.6 - np.sqrt(0.36 - 2.0 * slowing * way)) / slowing
    events = [event.time for event in can.contact_events]  # first points of the rim pass over the edge
    assert min(abs(np.array(events) - time)) < 1e-9
    assert can.u[4] > 0.0
    assert abs(can.energies.residual) < 1e-12


def test_an_ellipsoid_rocks_on_a_block_with_the_period_of_its_curvature():
    """Small oscillations of rolling: ω² = g (ρ - c) / (c² + (a² + c²)/5) with the radius of curvature ρ = a²/c."""
    a, c, tilt = 0.3, 0.15, 1e-4
    shape = f"{{type: ellipsoid, radii: [{a}, 0.2, {c}], mass: 2}}"
    height = 0.1 + np.hypot(a * np.sin(tilt), c * np.cos(tilt)) + 1e-15
    simulation = scene(shape, f"position: [0, 0, {height}], orientation: {{rpy: [0, {tilt}, 0]}}", friction=2.0)
    quarter = 0.5 * np.pi / np.sqrt(G * (a * a / c - c) / (c * c + (a * a + c * c) / 5.0))
    simulation.run(until=round(quarter, 3))
    rest = round(quarter, 3) - quarter
    assert simulation.q[5] / (0.5 * tilt) == pytest.approx(-np.sin(0.5 * np.pi / quarter * rest), abs=2e-4)
    assert abs(simulation.energies.residual) < 1e-13
