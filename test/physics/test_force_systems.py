"""Textbook systems with force elements: closed forms and reference end states from other programs."""

import numpy as np
import pytest

from mbd_sim import Simulation, load_mechanism
from mbd_sim.dynamics.equations import derive
from mbd_sim.files.checks.override import with_values
from test.generators.mechanisms import accelerations

G = 9.81


def test_tube_particles_has_the_accelerations_of_the_book():
    """F* + F = 0 with the generalized forces of Huston & Liu, sec. 11.10.4 and 11.12.4."""
    big, small, k, ell = 2.0, 0.2, 200.0, 0.25
    length = 4 * ell
    equations, rng = derive(load_mechanism("tube_particles")), np.random.default_rng(5)
    for _ in range(50):
        x, theta = rng.uniform(-0.1, 0.1, 3), rng.uniform(-3, 3)
        rates, omega = rng.uniform(-2, 2, 3), rng.uniform(-4, 4)
        place = np.arange(1, 4) * ell + x
        springs = k * np.array([x[1] - 2 * x[0], x[0] + x[2] - 2 * x[1], x[1] - 2 * x[2]])
        along = (small * G * np.cos(theta) + springs) / small + place * omega**2
        torque = -0.5 * big * G * length * np.sin(theta) - small * G * np.sin(theta) * place.sum()
        inertia = big * length**2 / 3 + small * (place**2).sum()
        turning = (torque - 2 * small * (place * rates).sum() * omega) / inertia
        found = accelerations(equations, np.array([theta, *place]), np.array([omega, *rates]))
        assert found == pytest.approx([turning, *along], rel=1e-11, abs=1e-10)


def test_follower_force_gives_the_generalized_forces_of_the_book():
    """Q1 = l1 f0 sin(θ1 - θ2) and Q2 = M0 (Lidström, sec. 9.6), against the double rod without them."""
    loaded, plain = derive(load_mechanism("follower_force")), derive(load_mechanism("double_rod"))
    rng = np.random.default_rng(6)
    for _ in range(50):
        q, u = rng.uniform(-3, 3, 2), rng.uniform(-3, 3, 2)
        first = 3.0 * np.sin(-q[1])
        relative = np.array([first + 0.5, 0.5])  # Q for the relative angles: θ2 = β1 + β2
        assert accelerations(loaded, q, u) == pytest.approx(accelerations(plain, q, u, relative), rel=1e-11, abs=1e-11)


LAWS = ("cart_massive_spring", "snap_through", "duffing", "quadratic_drag", "stick_slip", "box_kite")


@pytest.mark.parametrize("name", LAWS)
def test_the_energy_audit_of_nonlinear_and_lossy_elements_closes_over_a_minute(name):
    sim = Simulation.from_file(name)
    largest = 0.0
    for second in range(1, 61):
        sim.run(until=float(second))
        largest = max(largest, *map(abs, sim.energies[:5]))
        assert abs(sim.energies.residual) < 1e-13 * max(largest, 30.0)
    assert largest > 1.0


@pytest.mark.parametrize("n, mode", [(8, 2), (5, 1)])
def test_a_chain_of_springs_oscillates_in_one_of_its_modes(n, mode):
    """x_i = a sin(mode π i/(n + 1)) cos(ω t) with ω = 2 sqrt(k/m) sin(mode π/(2 (n + 1))), exactly."""
    chain = with_values(load_mechanism("spring_chain"), {"n": n, "mode": mode})
    p, sim = chain.parameters, Simulation(chain)
    sim.run(until=2.0)
    rate = 2.0 * np.sqrt(p["k"] / p["m"]) * np.sin(mode * np.pi / (2 * (n + 1)))
    shape = p["amplitude"] * np.sin(mode * np.pi * np.arange(1, n + 1) / (n + 1))
    assert sim.q == pytest.approx(shape * np.cos(rate * sim.time), abs=1e-13)
