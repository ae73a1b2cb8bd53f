"""Round bodies in contact with finite ones: closed forms, and the same motion as on a plane."""

from __future__ import annotations

import numpy as np
import pytest

from mbd_sim import Simulation

G = 9.81
SCENE = """
mechanism: scene
gravity: GRAVITY
parts:
  a: {shape: SHAPE}
  b: {shape: {type: block, size: [2, 1, 0.2], mass: 1}, points: {top: [0, 0, 0.1]}}
joints:
  a: {type: free, between: [ground, a], START}
  b: {type: fixed, between: [ground, b]}
contacts: {k: {CONTACT}}
"""


def scene(shape, start, contact="between: [a, b]", friction=0.3, gravity=(0.0, 0.0, -G)):
    text = SCENE.replace("SHAPE", shape).replace("START", start).replace("GRAVITY", str([*map(float, gravity)]))
    return Simulation.from_text(text.replace("CONTACT", f"{contact}, friction: {friction}"))


def test_a_cylinder_rolls_down_an_inclined_block_and_leaves_its_edge():
    """With 2/3 g sin α; at the edge it is too fast to follow it, and flies."""
    slope = 0.2
    cylinder = "{type: cylinder, radius: 0.1, length: 0.4, mass: 2, axis: [0, 1, 0]}"
    gravity = (G * np.sin(slope), 0.0, -G * np.cos(slope))
    simulation = scene(cylinder, "position: [0, 0, 0.2]", friction=0.6, gravity=gravity)
    rate = 2.0 / 3.0 * G * np.sin(slope)
    simulation.run(until=1.0)
    assert simulation.q[:3] == pytest.approx([0.5 * rate, 0.0, 0.2], abs=1e-12)
    assert simulation.u[4] == pytest.approx(rate / 0.1, abs=1e-11)
    simulation.run(until=1.3)
    (time, *_), left = {event.time for event in simulation.contact_events}, np.sqrt(2.0 / rate)
    assert time == pytest.approx(left, abs=1e-9)
    flown = 1.3 - left
    expected = [1.0 + rate * left * flown + 0.5 * gravity[0] * flown**2, 0.0, 0.2 + 0.5 * gravity[2] * flown**2]
    assert simulation.q[:3] == pytest.approx(expected, abs=1e-9)
    assert abs(simulation.energies.residual) < 1e-12


def test_a_can_slides_on_a_block_as_on_a_plane():
    """Flat, spinning, on six points of its rim."""
    can = "{type: cylinder, radius: 0.1, length: 0.1, mass: 2}"
    start = "position: [0.3, 0, 0.15], velocity: [0.4, 0.2, 0], angular_velocity: [0, 0, 3]"
    both = [scene(can, start, contact) for contact in ("between: [a, b]", "parts: [a], plane: b.top")]
    for simulation in both:
        simulation.run(until=0.1)
    assert both[0].q == pytest.approx(both[1].q, abs=1e-11)
    assert both[0].u == pytest.approx(both[1].u, abs=1e-10)
    assert both[0].energies.dissipated == pytest.approx(both[1].energies.dissipated, rel=1e-10)


def test_a_can_that_slides_over_an_edge_tips_where_its_pressure_reaches_the_edge():
    """The pressure is μ h ahead of the mass center at the height h, by the balance of moments."""
    can = "{type: cylinder, radius: 0.1, length: 0.1, mass: 2}"
    simulation = scene(can, "position: [0.93, 0, 0.15], velocity: [0.6, 0, 0]", friction=0.05)
    simulation.run(until=0.13)
    slowing, way = 0.05 * G, 1.0 - 0.05 * 0.05 - 0.93
    time = (0.6 - np.sqrt(0.36 - 2.0 * slowing * way)) / slowing
    events = [event.time for event in simulation.contact_events]  # first points of the rim pass over the edge
    assert min(abs(np.array(events) - time)) < 1e-9
    assert simulation.u[4] > 0.0
    assert abs(simulation.energies.residual) < 1e-12


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
