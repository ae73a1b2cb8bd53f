"""Power-law dampers, dry friction and dissipative stops against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

from mbd_sim import Simulation, load_mechanism
from mbd_sim.dynamics.equations import derive
from test.generators.mechanisms import accelerations
from test.physics.sliders import slider


def test_quadratic_drag_slows_the_puck_as_one_over_t():
    """m v' = -C v²: v = v0 / (1 + C v0 t / m) and s = (m / C) log(1 + C v0 t / m), in a straight line."""
    p = load_mechanism("quadratic_drag").parameters
    sim, v0 = Simulation.from_file("quadratic_drag"), 5.0
    sim.run(until=4.0)
    slower = 1.0 + p["C"] * v0 * 4.0 / p["m"]
    along = np.array([0.6, 0.8])
    assert sim.u == pytest.approx([*along * v0 / slower, 2.0], rel=1e-13)
    assert sim.q == pytest.approx([*along * p["m"] / p["C"] * np.log(slower), 8.0], rel=1e-13)
    assert sim.energies.dissipated == pytest.approx(0.5 * p["m"] * v0**2 * (1 - slower**-2), rel=1e-13)


@pytest.mark.parametrize(
    ("where", "exponent"),
    [("joint", 1.0), ("joint", 1.5), ("line", 3.0), ("velocity", 2.0)],
)
def test_a_power_law_damper_slows_a_slider_down(exponent, where):
    """m v' = -C v^p: v^(1-p) = v0^(1-p) + (p - 1) C t / m, and an exponential for p = 1."""
    law = f"coefficient: 1.5, exponent: {exponent}"
    if where == "joint":
        sim = slider(f"velocity: 0.9, damper: {{{law}}}")
    else:
        sim = slider("velocity: 0.9", f"d: {{type: damper, between: [ground.top, mass], {law}, along: {where}}}")
    sim.run(until=1.5)
    rate = 1.5 * 1.5 / 2.0
    expected = (
        0.9 * np.exp(-rate)
        if exponent == 1.0
        else (0.9 ** (1 - exponent) + (exponent - 1) * rate) ** (1 / (1 - exponent))
    )
    assert sim.u[0] == pytest.approx(expected, rel=1e-12)
    assert sim.energies.dissipated == pytest.approx(0.81 - expected**2, rel=1e-12)


@pytest.mark.parametrize(("exponent", "along"), [(0.0, "line"), (0.5, "velocity"), (2.0, "velocity")])
def test_a_damper_leaves_a_mass_at_rest_at_rest(exponent, along):
    sim = slider(
        "", f"d: {{type: damper, between: [ground.top, mass], coefficient: 3, exponent: {exponent}, along: {along}}}"
    )
    sim.run(until=1.0)
    assert sim.q[0] == sim.u[0] == sim.energies.dissipated == 0.0


def test_a_damper_along_the_line_does_not_damp_transverse_motion():
    text = """
mechanism: circle
gravity: [0, 0, 0]
parts: {arm: {mass: 1, center: [1, 0, 0], points: {end: [1, 0, 0]}}}
joints: {pin: {type: revolute, between: [ground, arm], axis: [0, 0, 1], velocity: 3}}
forces: {d: {type: damper, between: [ground, arm.end], coefficient: 2, exponent: 2, along: line}}
"""
    along_line, along_velocity = (
        Simulation.from_text(text),
        Simulation.from_text(text.replace("along: line", "along: velocity")),
    )
    for sim in (along_line, along_velocity):
        sim.run(until=1.0)
    assert along_line.u[0] == pytest.approx(3.0, rel=1e-14)
    assert along_velocity.u[0] == pytest.approx(3.0 / (1 + 2 * 3.0), rel=1e-13)


@pytest.mark.parametrize("kind", ["prismatic", "revolute"])
def test_friction_stops_a_mass_according_to_its_law(kind):
    """m v' = -F tanh(v/vr): sinh(v/vr) = sinh(v0/vr) exp(-F t / m vr)."""
    text = f"""
mechanism: sliding
gravity: [0, 0, 0]
parts: {{body: {{mass: 2, inertia: [1, 1, 2]}}}}
joints: {{j: {{type: {kind}, between: [ground, body], axis: [0, 0, 1], velocity: 1, friction: {{coulomb: 3, regularization: 0.05}}}}}}
"""
    sim = Simulation.from_text(text)
    for t in (0.3, 0.66, 0.8):
        sim.run(until=t)
        expected = 0.05 * np.arcsinh(np.sinh(1 / 0.05) * np.exp(-3 * t / (2 * 0.05)))
        assert sim.u[0] == pytest.approx(expected, rel=1e-9)
        assert sim.energies.dissipated == pytest.approx(1 - sim.u[0] ** 2, rel=1e-12)


def test_stick_slip_has_the_forces_of_its_law():
    """m s'' = -k x - F(s') with x = v t + s and Stribeck friction."""
    p = load_mechanism("stick_slip").parameters
    equations, rng = derive(load_mechanism("stick_slip")), np.random.default_rng(74)
    for s, speed, t in zip(rng.uniform(-0.2, 0.2, 50), rng.uniform(-0.2, 0.2, 50), rng.uniform(0, 1, 50), strict=True):
        friction = (4 + 2 * np.exp(-((speed / 0.05) ** 2))) * np.tanh(speed / 0.005)
        expected = (-p["k"] * (p["v"] * t + s) - friction) / p["m"]
        found = accelerations(equations, np.array([s]), np.array([speed]), t=t)
        assert found == pytest.approx([expected], rel=1e-12, abs=1e-12)


def rebound(damping, speed):
    """Hunt & Crossley: with G(v) = v/c - log(1 + c v)/c² the speeds before and after a contact with k δ (1 + c v) have the same G."""

    def g(v):
        return v / damping - np.log1p(damping * v) / damping**2

    return brentq(lambda v: g(-v) - g(speed), 0.0, min(1 / damping, speed) * (1 - 1e-15), xtol=1e-15)


@pytest.mark.parametrize(
    ("damping", "speed", "side", "stiffness"), [(0.1, 2.0, -1, 3000), (0.5, 2.0, 1, 3000), (2.0, 3.0, 1, 8000)]
)
def test_a_mass_leaves_a_stop_with_the_speed_of_hunt_and_crossley(damping, speed, side, stiffness):
    """For any mass and stiffness, and never faster than 1/c."""
    lower, upper = (-0.1, 9) if side < 0 else (-9, 0.1)
    limits = f"limits: {{lower: {lower}, upper: {upper}, stiffness: {stiffness}, damping: {damping}}}"
    sim = slider(f"velocity: {side * speed}, {limits}", step=1e-5)
    sim.run(until=0.25)
    kink = stiffness * (speed * 1e-5) ** 2  # J: the error of a method if a force starts within a step
    assert side * sim.q[0] < 0.1 and -side * sim.u[0] < 1 / damping
    assert -side * sim.u[0] == pytest.approx(rebound(damping, speed), abs=kink)
    assert sim.energies.dissipated == pytest.approx(speed**2 - sim.u[0] ** 2, abs=kink)
