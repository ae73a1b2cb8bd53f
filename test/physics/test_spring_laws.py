"""Nonlinear springs, elastic bars and springs with mass against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import ellipj

from mbd_sim import Simulation, load_mechanism
from mbd_sim.dynamics.equations import derive
from test.generators.mechanisms import accelerations
from test.physics.sliders import slider

G = 9.81


def test_duffing_oscillator_is_jacobis_cosine():
    """m x'' + k x + k3 x³ = 0 from rest at A: x = A cn(ω t | k3 A² / 2 m ω²) with ω² = (k + k3 A²) / m."""
    p = load_mechanism("duffing").parameters
    squared = (p["k"] + p["k3"] * p["amplitude"] ** 2) / p["m"]
    modulus = p["k3"] * p["amplitude"] ** 2 / (2.0 * p["m"] * squared)
    sim = Simulation.from_file("duffing")
    for t in (0.1, 0.77, 3.0, 10.0):
        sim.run(until=t)
        sn, cn, dn, _ = ellipj(np.sqrt(squared) * t, modulus)
        assert sim.q[0] == pytest.approx(p["amplitude"] * cn, abs=1e-12)
        assert sim.u[0] == pytest.approx(-p["amplitude"] * np.sqrt(squared) * sn * dn, abs=1e-11)
    start = 0.5 * p["k"] * p["amplitude"] ** 2 + 0.25 * p["k3"] * p["amplitude"] ** 4
    assert Simulation.from_file("duffing").energies.potential == pytest.approx(start, rel=1e-15)


def test_a_spring_in_a_joint_and_one_between_points_are_the_same():
    law = "10*x + 400*x**3 + 3*sin(5*x)"
    inside = slider(f"spring: {{force: {law}}}, rest: -0.8, position: 0.3")
    between = slider("position: 0.3", f"s: {{type: spring, between: [mass, ground.top], length: 1.2, force: {law}}}")
    mirrored = slider("position: 0.3", f"s: {{type: spring, between: [ground.top, mass], length: 2.8, force: {law}}}")
    assert inside.energies.potential != between.energies.potential
    for sim, elongation in ((inside, 1.1), (between, 0.5), (mirrored, -1.1)):
        energy = 5 * elongation**2 + 100 * elongation**4 + 0.6 * (1 - np.cos(5 * elongation))
        assert sim.energies.potential == pytest.approx(energy, rel=1e-14)
        sim.run(until=5.0)
        assert abs(sim.energies.residual) < 1e-11
    assert inside.q[0] == pytest.approx(mirrored.q[0], abs=1e-10)  # the law is odd


def test_a_torsion_spring_from_a_table_oscillates_piecewise_harmonically():
    """A stiffness k to one side and 4k to the other: half periods π √(I/k) and ½ π √(I/k)."""
    text = """
mechanism: wheel
gravity: [0, 0, 0]
parts: {wheel: {mass: 1, inertia: [1, 1, 0.5]}}
joints:
  pin:
    {type: revolute, between: [ground, wheel], axis: [0, 0, 1], velocity: 1,
     spring: {table: [[-8, -64], [-1e-9, -8e-9], [0, 0], [1e-9, 2e-9], [8, 16]]}}
"""
    # Steps end at the kink, and the stages of this method stay within each step.
    sim = Simulation.from_text(text, method="dop853", step=np.pi / 4000.0)
    sim.step(2000)  # half a period at 2 N·m/rad, ω = 2
    assert sim.q[0] == pytest.approx(0.0, abs=1e-8) and sim.u[0] == pytest.approx(-1.0, abs=1e-8)
    sim.step(1000)  # and half a period at 8
    assert sim.q[0] == pytest.approx(0.0, abs=1e-7) and sim.u[0] == pytest.approx(1.0, abs=1e-7)
    assert abs(sim.energies.residual) < 1e-7  # the kink costs that


def test_a_smooth_table_conserves_the_energy():
    rows = ", ".join(f"[{x:.3f}, {np.sinh(3 * x):.6f}]" for x in np.linspace(-0.8, 0.8, 9))
    sim = slider(f"velocity: 1.5, spring: {{table: [{rows}]}}")
    sim.run(until=20.0)
    assert abs(sim.energies.residual) < 1e-6
    coarse, fine = (slider(f"velocity: 1.5, spring: {{table: [{rows}]}}", step=h) for h in (4e-3, 5e-4))
    for other in (coarse, fine):
        other.run(until=20.0)
    # The second derivative jumps at the rows, so the error decreases with the third power of the step or faster.
    assert abs(fine.energies.residual) < abs(coarse.energies.residual) / 60.0


def test_snap_through_moves_in_the_two_potential_wells_of_its_bars():
    """m z'' = -k z (z² - h²) / l0² - m g, for U = k (z² - h²)² / 4 l0² (Lidström, p. 103-105)."""
    p = load_mechanism("snap_through").parameters
    square = p["b"] ** 2 + p["h"] ** 2
    equations = derive(load_mechanism("snap_through"))
    for z in np.linspace(-0.5, 0.5, 41):
        y = np.array([z, 0.3, 0, 0, 0])
        expected = -2.0 * p["k"] * z * (z**2 - p["h"] ** 2) / (2.0 * square * p["m"]) - G
        assert accelerations(equations, y[:1], y[1:2]) == pytest.approx([expected], rel=1e-12, abs=1e-11)
        potential = p["k"] * (z**2 - p["h"] ** 2) ** 2 / (4.0 * square) + p["m"] * G * z
        assert np.array(equations.energies(0.0, y))[1] == pytest.approx(potential, rel=1e-12, abs=1e-13)
    sim, places = Simulation.from_file("snap_through"), []
    for _ in range(200):
        sim.step(10)
        places.append(sim.q[0])
    assert min(places) < -p["h"] and max(places) > p["h"] and abs(sim.energies.residual) < 1e-12


def bar(strain, at):
    keys = f"type: elastic_bar, between: [mass, ground.top], stiffness: 300, length: 1.5, strain: {strain}"
    return slider(f"position: {at}", f"s: {{{keys}}}")


@pytest.mark.parametrize("elongation", [-0.7, -0.01, 0.0, 0.02, 0.8])
def test_the_force_of_an_elastic_bar(elongation):
    """k e (1 + e/l0)(1 + e/2l0) with U = ½ k e² (1 + e/2l0)², and for small strain k e with ½ k e²."""
    e, l0 = elongation, 1.5
    green = 300 * e * (1 + e / l0) * (1 + e / (2 * l0)), 150 * e**2 * (1 + e / (2 * l0)) ** 2
    for strain, (force, energy) in (("green", green), ("small", (300 * e, 150 * e**2))):
        sim = bar(strain, 2.0 - (l0 + e))
        equations = derive(sim.mechanism)
        assert 2 * accelerations(equations, sim.q, sim.u) == pytest.approx([force], rel=1e-12, abs=1e-10)
        assert sim.energies.potential == pytest.approx(energy, rel=1e-12, abs=1e-13)


def test_a_bar_with_greens_strain_may_shrink_to_zero_length_and_invert():
    sim = bar("green", 2.0)
    assert accelerations(derive(sim.mechanism), sim.q, sim.u) == pytest.approx([0.0], abs=1e-15)
    sim.reset(u=[5.0])
    sim.run(until=3.0)
    assert abs(sim.energies.residual) < 1e-11


def test_cart_massive_spring_has_the_equations_of_the_book():
    """Lidström, ex. 4:14 with T of the spring: (mc + m + ms/3) x'' + m l cθ θ'' - m l sθ θ'² + k x = F."""
    p = load_mechanism("cart_massive_spring").parameters
    equations, rng = derive(load_mechanism("cart_massive_spring")), np.random.default_rng(73)
    m, ell = p["m"], p["l"]
    for _ in range(50):
        (x, theta), (v, w), efforts = rng.uniform(-1, 1, 2), rng.uniform(-3, 3, 2), rng.uniform(-5, 5, 2)
        mass = [[p["mc"] + m + p["ms"] / 3, m * ell * np.cos(theta)], [m * ell * np.cos(theta), m * ell**2]]
        forces = [m * ell * np.sin(theta) * w**2 - p["k"] * x, -m * G * ell * np.sin(theta)]
        found = accelerations(equations, np.array([x, theta]), np.array([v, w]), efforts)
        assert found == pytest.approx(np.linalg.solve(mass, forces + efforts), rel=1e-11, abs=1e-11)


def test_half_the_weight_of_a_hanging_spring_is_carried_by_its_end():
    """(m + ms/3) z'' = k (2 - z - l) - (m + ms/2) g, and V = ½ k e² + m g z + ms g (2 + z) / 2."""
    sim = slider("position: 0.4", "s: {type: spring, between: [mass, ground.top], stiffness: 80, mass: 0.9, length: 1}",
                 gravity="[0, 0, -9.81]")  # fmt: skip
    moved = 2 + 0.9 / 3
    rest = 1.0 - (2 + 0.45) * G / 80
    omega = np.sqrt(80 / moved)
    assert sim.energies.potential == pytest.approx(40 * 0.36 + 2 * G * 0.4 + 0.9 * G * 1.2, rel=1e-14)
    sim.run(until=3.7)
    assert sim.q[0] == pytest.approx(rest + (0.4 - rest) * np.cos(3.7 * omega), rel=1e-11)
    assert sim.energies.kinetic == pytest.approx(0.5 * moved * sim.u[0] ** 2, rel=1e-14)
    assert abs(sim.energies.residual) < 1e-12
