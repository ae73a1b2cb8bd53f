"""Systems whose forces depend on the motion, against closed forms, published values and independent integrations."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import PchipInterpolator

from mbd_sim import Simulation, load_mechanism
from test.physics.sliders import slider

G = 9.81
TIGHT = {"method": "DOP853", "rtol": 1e-13, "atol": 1e-13}


def limit_cycle(sim, cycles):
    """The period and the amplitude of an oscillation, by cubic interpolation between steps at its upward zeros."""
    zeros, largest, before = [], 0.0, (0.0, 0.0, 0.0)
    while len(zeros) <= cycles:
        sim.step(1)
        now = (sim.time, sim.q[0], sim.u[0])
        if before[1] < 0.0 <= now[1]:
            zeros.append(_root(before, now, (before[1], now[1]), (before[2], now[2])))
        if before[2] > 0.0 >= now[2] and zeros:
            x, v = (before[1], now[1]), (before[2], now[2])
            largest = max(*x, largest) if v[0] == v[1] else x[1] + 0.5 * v[1] ** 2 / (v[0] - v[1]) * sim.step_size
        before = now
    return zeros[-1] - zeros[-2], largest


def _root(before, now, x, v):
    """Where the cubic with these end values and slopes is zero."""
    h, s = now[0] - before[0], -x[0] / (x[1] - x[0])
    for _ in range(5):
        value = (1 + 2 * s) * (1 - s) ** 2 * x[0] + s * (1 - s) ** 2 * h * v[0] + s**2 * (3 - 2 * s) * x[1]
        value += s**2 * (s - 1) * h * v[1]
        slope = 6 * s * (s - 1) * (x[0] - x[1]) + (1 - s) * (1 - 3 * s) * h * v[0] + s * (3 * s - 2) * h * v[1]
        s -= value / slope
    return before[0] + s * h


def test_van_der_pols_limit_cycle_has_the_published_period_and_amplitude():
    """Period 6.663286859323… and amplitude 2.008619860874… at μ = 1 (Buonomo 1998)."""
    sim = Simulation.from_file("van_der_pol")
    period, amplitude = limit_cycle(sim, 8)
    assert period == pytest.approx(6.66328685932313, abs=1e-10)
    assert amplitude == pytest.approx(2.00861986087484, abs=1e-8)
    assert abs(sim.energies.residual) < 1e-11 and sim.energies.work_applied > 5.0 < sim.energies.dissipated


@pytest.mark.parametrize("method", ["rosenbrock"])
def test_relaxation_oscillations_follow_an_independent_integration(method):
    sim = Simulation.from_file("van_der_pol", method=method, live=["parameters.mu"])
    sim.set_live({"parameters.mu": 30.0})
    sim.reset(q=[2.0], u=[0.0])
    sim.run(until=20.0)
    exact = solve_ivp(lambda t, y: [y[1], 30.0 * (1.0 - y[0] ** 2) * y[1] - y[0]], (0.0, 20.0), [2.0, 0.0], **TIGHT)
    assert [sim.q[0], sim.u[0]] == pytest.approx(exact.y[:, -1].tolist(), abs=1e-9)


def engine_forces(tables):
    """The gas force in N of the engine against the crank angle, by SciPy."""
    curve = tables["gas"]
    x, f = np.array(curve.x), np.array(curve.values)
    turn = 4.0 * np.pi
    table = PchipInterpolator([*(x[:-1] - turn), *x, *(x[1:] + turn)], [*f[:-1], *f, *f[1:]])
    return lambda angle: float(table(np.mod(angle, turn)))


def test_the_engine_follows_its_equation_in_the_crank_angle():
    """(J + m y'²) φ'' + m y' y'' φ'² = -(F + m g) y' - c φ' with the piston's height y(φ)."""
    mechanism = load_mechanism("gas_engine")
    p, gas = mechanism.parameters, engine_forces(mechanism.applied[0].vector[2].tables)
    r, length, m = p["r"], p["l"], p["m_piston"]

    def height(angle):
        s, c = np.sin(angle), np.cos(angle)
        rod = np.sqrt(length**2 - (r * s) ** 2)
        first = -r * s - r * r * s * c / rod
        return r * c + rod, first, -r * c - r * r * (c * c - s * s) / rod - r**4 * s * s * c * c / rod**3

    def rates(t, y):
        angle, speed = y
        _, first, second = height(angle)
        force = -(gas(angle) + m * G) * first - p["load"] * speed - m * first * second * speed**2
        return [speed, force / (p["flywheel"] + m * first**2)]

    sim = Simulation(mechanism)
    start = [sim.q[0], sim.u[0]]
    sim.run(until=0.05)  # two revolutions
    exact = solve_ivp(rates, (0.0, 0.05), start, method="DOP853", rtol=1e-12, atol=1e-12, max_step=1e-4)
    assert [sim.q[0], sim.u[0]] == pytest.approx(exact.y[:, -1].tolist(), rel=1e-7)
    assert sim.q[1] == pytest.approx(height(sim.q[0])[0], abs=1e-13)
    assert sim.energies.work_applied > 1.0 and abs(sim.energies.residual) < 1e-9 * sim.energies.work_applied


def test_an_adiabatic_column_of_air_has_its_potential_and_frequency():
    sim = Simulation.from_file("air_spring", live=["parameters.c"])
    sim.set_live({"parameters.c": 0.0})
    p = sim.mechanism.parameters
    push = p["p"] * p["area"]

    def potential(x):
        return push * (p["h"] ** 1.4 * x**-0.4 / 0.4 + x)

    start = sim.energies
    sim.run(until=0.4)
    fallen = potential(sim.q[0]) - potential(p["h"]) + p["m"] * G * (sim.q[0] - p["h"])
    assert sim.energies.potential - start.potential == pytest.approx(fallen, rel=1e-9)
    assert 0.5 * p["m"] * sim.u[0] ** 2 == pytest.approx(-fallen, rel=1e-9)
    assert abs(sim.energies.residual) < 1e-10 and sim.energies.dissipated == 0.0


def test_quadratic_drag_leads_to_the_terminal_speed():
    """v = -v∞ tanh(g t / v∞) with v∞ = √(m g / c), by an effort and by a force on the part."""
    law = "-0.5*rail.velocity*abs(rail.velocity)"
    along = slider("position: 0", f"drag: {{type: effort, coordinate: rail, effort: {law}}}", "[0, 0, -9.81]")
    at = slider("position: 0", f"drag: {{type: force, at: mass, vector: [0, 0, {law}]}}", "[0, 0, -9.81]")
    terminal = np.sqrt(2.0 * G / 0.5)
    for sim in (along, at):
        sim.run(until=1.5)
        assert sim.u[0] == pytest.approx(-terminal * np.tanh(G * 1.5 / terminal), rel=1e-13)
        lost = 2.0 * G * -sim.q[0] - sim.u[0] ** 2
        assert sim.energies.dissipated == pytest.approx(lost, rel=1e-12) and sim.energies.work_applied == 0.0


def test_a_magnet_that_floats_above_another_has_its_potential_and_frequency():
    """Two dipoles repel with C / x⁴: the upper one floats at x⁴ = C / m g, where ω² = 4 g / x."""
    height = (3e-3 / (2.0 * G)) ** 0.25
    magnet = (
        f"magnet: {{type: line_force, between: [ground, mass], force: -3e-3/(x + {height!r})**4, length: {height!r}}}"
    )
    sim = slider(f"position: {height!r}", magnet, "[0, 0, -9.81]")
    modes = np.linalg.eigvals(sim.linearize().a)
    assert sorted(abs(modes.imag)) == pytest.approx([np.sqrt(4.0 * G / height)] * 2, rel=1e-12)
    sim.reset(q=[1.5 * height], u=[0.0])
    start = sim.energies.total
    sim.run(until=1.0)
    exact = 1e-3 / sim.q[0] ** 3 - 1e-3 / height**3
    assert sim.energies.potential == pytest.approx(exact + 2.0 * G * sim.q[0], rel=1e-10)
    assert sim.energies.total == pytest.approx(start, abs=1e-12) and sim.energies.work_applied == 0.0


def test_a_hydraulic_buffer_with_a_check_valve_brakes_one_way():
    """Compression meets an orifice, c v²: v = v₀ / (1 + c v₀ t / m). Extension is free."""
    law = "where(x.velocity < 0, -40*x.velocity**2, 0)"
    buffer = f'b: {{type: line_force, between: [ground.top, mass], force: "{law}", length: 2}}'
    sim = slider("velocity: 1.5", buffer)
    sim.run(until=0.4)
    assert sim.u[0] == pytest.approx(1.5 / (1.0 + 40.0 * 1.5 * 0.4 / 2.0), rel=1e-13)
    assert sim.energies.dissipated == pytest.approx(1.5**2 - sim.u[0] ** 2, rel=1e-12)
    sim.reset(q=[0.0], u=[-1.5])
    sim.run(until=0.4)
    assert sim.u[0] == -1.5


def test_a_negative_damper_does_work_and_a_spring_of_the_time_too():
    """m x'' = a x' grows: all of its work is applied. A force that depends on time alone is applied with its sign."""
    pump = slider("velocity: 1", "p: {type: effort, coordinate: rail, effort: 0.8*rail.velocity}")
    pump.run(until=2.0)
    assert pump.u[0] == pytest.approx(np.exp(0.8), rel=1e-14) and pump.energies.dissipated == 0.0
    brake = slider("velocity: 1", "p: {type: effort, coordinate: rail, effort: -0.8*t}")
    brake.run(until=1.0)
    assert brake.energies.dissipated == 0.0 and brake.energies.work_applied < 0.0
    assert brake.energies.work_applied == pytest.approx(brake.u[0] ** 2 - 1.0, rel=1e-13)
