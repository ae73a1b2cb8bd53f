"""The shipped open chains and prescribed motions against the closed forms of textbooks.

The tests compare accelerations at random states, times and efforts with the closed form, and end states with reference
values. They check conserved quantities, and the energy audit with the work of the drives after a minute.
"""

from __future__ import annotations

import functools

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.base.geometry.rotation import from_quaternion
from mbd_sim.dynamics.equations import derive
from mbd_sim.dynamics.lagrange import lagrange_equations
from mbd_sim.files.load import load_mechanism
from mbd_sim.files.text.library import shipped
from test.generators.mechanisms import KINDS, accelerations, random_state
from test.oracles import kane

G = 9.81
LOOPED = ("constraints", "benchmarks")  # folders whose mechanisms test_constrained_systems.py runs


@functools.cache
def equations(name):
    return derive(load_mechanism(name))


def parameters(name):
    """The parameters of the file by name."""
    return load_mechanism(name).parameters


def block(mass, size):
    a, b, c = np.array(size) ** 2
    return mass / 12.0 * np.array([b + c, c + a, a + b])


def relative(found, expected):
    """The largest error, relative to the largest component."""
    expected = np.asarray(expected, dtype=float)
    return np.max(np.abs(found - expected)) / np.max(np.abs(expected))


# Closed forms: u' from the file's parameters p, the time, the state, and the efforts e.


def simple_pendulum(p, t, q, u, e):
    """Huston & Liu, sec. 8.4: θ'' + (g/l) sin θ = 0."""
    return -G / p["l"] * np.sin(q) + e / (p["m"] * p["l"] ** 2)


def particle_on_circle(p, t, q, u, e):
    """Lidström, p. 16: φ'' + (g/r) cos φ = 0, from the horizontal."""
    return -G / p["r"] * np.cos(q) + e / (p["m"] * p["r"] ** 2)


def triple_rod_torsion(p, t, q, u, e):
    """Huston & Liu, P11.5.5-8: Lagrange's equations in absolute angles, springs -k1 θ1 + k2 (θ2 - θ1), …"""
    theta, rate, m, length = np.cumsum(q), np.cumsum(u), p["m"], p["l"]
    beyond = m * np.array([2.0, 1.0, 0.0]) + p["tip"]  # masses that hang at the end of each rod
    inertia = np.array([[m / 3 if i == j else m / 2 for j in range(3)] for i in range(3)])
    inertia = (inertia + beyond[np.maximum.outer(range(3), range(3))]) * length**2
    difference = theta[:, None] - theta[None, :]
    gravity = (m / 2 + beyond) * G * length * np.sin(theta)
    torques = e - np.array([8.0, 6.0, 4.0]) * q
    right = torques - np.append(torques[1:], 0.0) - (inertia * np.sin(difference)) @ rate**2 - gravity
    return np.diff(np.linalg.solve(inertia * np.cos(difference), right), prepend=0.0)


def sliding_collars(p, t, q, u, e):
    """Huston & Liu, P11.4.2, with springs: the second displacement is measured from the first collar."""
    m1, m2 = 0.7, 0.4
    turning = p["l"] ** 2 + (m1 + m2) * (3 * 0.05**2 + 0.1**2) / 12.0  # rod of 3 kg: m l²/3
    r1, r2, v1, v2, spin = q[1], q[1] + q[2], u[1], u[1] + u[2], u[0]
    f1, f2 = e[1] - 30.0 * (q[1] - p["rest"]), e[2] - 20.0 * (q[2] - p["rest"])
    angular = (e[0] - 2.0 * spin * (m1 * r1 * v1 + m2 * r2 * v2)) / (turning + m1 * r1**2 + m2 * r2**2)
    first, second = r1 * spin**2 + (f1 - f2) / m1, r2 * spin**2 + f2 / m2
    return [angular, first, second - first]


def cart_pendulum_spring(p, t, q, u, e):
    """Lidström, ex. 4:14."""
    (x, theta), rate, m, length = q, u[1], p["m"], p["l"]
    c, s = m * length * np.cos(theta), m * length * np.sin(theta)
    right = [e[0] + s * rate**2 - p["k"] * x, e[1] - G * s]
    return np.linalg.solve([[p["mc"] + m, c], [c, m * length**2]], right)


def projectile(p, t, q, u, e):
    """Huston & Liu, sec. 8.7: I1 ω1' = (I2 - I3) ω2 ω3 and cyclic; the center of mass falls."""
    moments, w = block(2.0, (0.6, 0.3, 0.1)), u[3:]
    return [*(e[:3] / 2.0 - [0.0, 0.0, G]), *((e[3:] - np.cross(w, moments * w)) / moments)]


def disk_driven(p, t, q, u, e):
    """Huston & Liu, sec. 8.8: a force W = e/r at the rim gives W r / I_O."""
    return e / (0.5 * p["m"] * p["r"] ** 2)


def bryan_rates(q):
    """ω in the box's axes is this matrix times (α', β', γ') (Huston & Liu, P11.4.3)."""
    (cb, cc), (sb, sc) = np.cos(q[1:]), np.sin(q[1:])
    return np.array([[cb * cc, sc, 0.0], [-cb * sc, cc, 0.0], [sb, 0.0, 1.0]])


def box_bryan(p, t, q, u, e):
    """Euler's equations with ω of Huston & Liu, P11.4.3."""
    (cb, cc), (sb, sc), (a1, b1, c1) = np.cos(q[1:]), np.sin(q[1:]), u
    moments, rates = block(12.0, (0.2, 0.4, 0.3)), bryan_rates(q)
    omega = rates @ u
    left_over = [
        -a1 * (sb * cc * b1 + cb * sc * c1) + b1 * cc * c1,
        a1 * (sb * sc * b1 - cb * cc * c1) - b1 * sc * c1,
        a1 * cb * b1,
    ]
    moment = np.linalg.solve(rates.T, e)
    return np.linalg.solve(rates, (moment - np.cross(omega, moments * omega)) / moments - left_over)


def universal_pendulum(p, t, q, u, e):
    """From T = m l² (b'² + cos²b a'²)/2 and V = -m g l cos a cos b."""
    (a, b), (a1, b1), inertia = q, u, p["m"] * p["l"] ** 2
    first = 2.0 * np.tan(b) * a1 * b1 - G / p["l"] * np.sin(a) / np.cos(b) + e[0] / (inertia * np.cos(b) ** 2)
    return [first, -np.sin(b) * np.cos(b) * a1**2 - G / p["l"] * np.cos(a) * np.sin(b) + e[1] / inertia]


def top_moments(p):
    """Principal moments of the top about its point."""
    across = p["m"] * (p["r"] ** 2 / 4.0 + p["h"] ** 2)
    return np.array([across, across, p["m"] * p["r"] ** 2 / 2.0])


def spherical_top(p, t, q, u, e):
    """Euler's equations about the point, with the moment of the weight."""
    down = from_quaternion(q).T @ [0.0, 0.0, -G]
    moment = e + np.cross([0.0, 0.0, p["h"]], p["m"] * down)
    return (moment - np.cross(u, top_moments(p) * u)) / top_moments(p)


def screw_press(p, t, q, u, e):
    """(I + m h²) θ'' = -m g h - d θ' with h = lead/2π."""
    rise = 0.02 / (2.0 * np.pi)
    inertia = 4.0 * 0.02**2 / 2.0 + 8.0 * 0.25**2 / 2.0
    return (e - 12.0 * G * rise - 0.1 * u) / (inertia + 12.0 * rise**2)


def cylindrical_slider(p, t, q, u, e):
    """A spring and a weight along the guide, a physical pendulum about it."""
    slide = e[0] - 80.0 * q[0] - (p["m"] + 0.5) * G * np.sin(p["slope"])
    turn = e[1] - p["m"] * p["d"] * G * np.cos(p["slope"]) * np.sin(q[1])
    return [slide / (p["m"] + 0.5), turn / (p["m"] * p["d"] ** 2 + 0.5 * 0.04**2 / 2.0)]


def planar_puck(p, t, q, u, e):
    """Newton's equations of a body whose center of mass is off its point, and the moment about that point."""
    c, s, off = np.cos(q[2]), np.sin(q[2]), 0.2 * p["d"]
    mass = [[0.7, 0.0, -off * s], [0.0, 0.7, off * c], [-off * s, off * c, 0.5 * 0.08**2 / 2.0 + off * p["d"]]]
    springs = [20.0 * q[0] - off * c * u[2] ** 2, 30.0 * q[1] - off * s * u[2] ** 2, 0.0]
    return np.linalg.solve(mass, e - springs)


def spun_tube_particle(p, t, q, u, e):
    """Huston & Liu, sec. 8.5: θ'' - Ω² sin θ cos θ + (g/r) sin θ = 0, from the bottom."""
    return p["omega"] ** 2 * np.sin(q) * np.cos(q) - G / p["r"] * np.sin(q) + e / (p["m"] * p["r"] ** 2)


def support(p, t):
    """The support's position, velocity and acceleration."""
    a, w = p["amplitude"], p["frequency"]
    return a * np.sin(w * t), a * w * np.cos(w * t), -a * w**2 * np.sin(w * t)


def moving_support_pendulum(p, t, q, u, e):
    """Lidström, p. 48-53."""
    m, length = p["m"], p["l"]
    moment = -0.5 * m * length * (G * np.sin(q) + support(p, t)[2] * np.cos(q))
    return (e + moment) / (m * length**2 / 3.0)


def rotating_frame_mass(p, t, q, u, e):
    """Géradin & Rixen, p. 31-33."""
    (x, y), (vx, vy), m, spin = q, u, p["m"], p["omega"]
    return [
        (e[0] + 2.0 * m * spin * vy - p["c1"] * vx - (p["k1"] - m * spin**2) * x) / m,
        (e[1] - 2.0 * m * spin * vx - (p["k2"] - m * spin**2) * y) / m,
    ]


CLOSED_FORMS = {
    form.__name__: form
    for form in (
        simple_pendulum,
        particle_on_circle,
        triple_rod_torsion,
        sliding_collars,
        cart_pendulum_spring,
        projectile,
        disk_driven,
        box_bryan,
        universal_pendulum,
        spherical_top,
        screw_press,
        cylindrical_slider,
        planar_puck,
        spun_tube_particle,
        moving_support_pendulum,
        rotating_frame_mass,
    )
}


@pytest.mark.parametrize("name", CLOSED_FORMS)
def test_accelerations(name):
    """Up to round-off, which is larger where the closed form is near a singular configuration."""
    mechanism, rng = load_mechanism(name), np.random.default_rng(60)
    for _ in range(4):
        q, u, efforts = random_state(mechanism, rng, reach=2.5)
        t = rng.uniform(0.0, 20.0)
        expected = CLOSED_FORMS[name](mechanism.parameters, t, q, u, efforts)
        condition = kane.equations(mechanism, q, u, efforts, t).condition
        found = accelerations(equations(name), q, u, efforts, t)
        assert relative(found, expected) < 2e-14 * max(condition, 5.0)


def end(name, until):
    sim = Simulation.from_file(name)
    assert (sim.model.method.name, sim.step_size) == ("adams11", 1e-3)
    sim.run(until=until)
    return sim


def polar(sim):
    """The bob's θ from the downward vertical, its azimuth φ, and their rates."""
    (a, b), (a1, b1) = sim.q, sim.u
    x, y, z = np.sin(b), np.sin(a) * np.cos(b), -np.cos(a) * np.cos(b)
    vx, vy = np.cos(b) * b1, np.cos(a) * np.cos(b) * a1 - np.sin(a) * np.sin(b) * b1
    vz = np.sin(a) * np.cos(b) * a1 + np.cos(a) * np.sin(b) * b1
    theta = np.arccos(-z)
    return theta, np.arctan2(y, x), vz / np.sin(theta), (x * vy - y * vx) / (x * x + y * y)


def test_parts_of_the_kinetic_energy():
    """Lidström, p. 53: T0 = m v²/2, T1 = m l v cos φ φ'/2, T2 = m l² φ'²/6, with v of the support."""
    mechanism, rng = load_mechanism("moving_support_pendulum"), np.random.default_rng(62)
    p, energies = mechanism.parameters, lagrange_equations(mechanism).energies
    m, length = p["m"], p["l"]
    for _ in range(20):
        t, phi, rate = rng.uniform(-3.0, 3.0, 3)
        v = support(p, t)[1]
        found = [float(value) for value in energies(t, phi, rate)]
        expected = [m * length**2 * rate**2 / 6.0, 0.5 * m * length * v * np.cos(phi) * rate, 0.5 * m * v**2]
        assert found == pytest.approx([*expected, -0.5 * m * G * length * np.cos(phi)], rel=1e-13, abs=1e-15)


@pytest.mark.parametrize("name", ["spun_tube_particle", "rotating_frame_mass"])
def test_work_of_a_steady_spin(name):
    """The drive's moment is the rate of the vertical angular momentum H: its work is Ω times the growth of H."""
    p, sim = parameters(name), Simulation.from_file(name)
    m, spin = p["m"], p["omega"]

    def angular_momentum():
        if name == "spun_tube_particle":
            return m * spin * (p["r"] * np.sin(sim.q[0])) ** 2
        (x, y), (vx, vy) = sim.q, sim.u
        return m * (x * (vy + spin * x) - y * (vx - spin * y))

    start = angular_momentum()
    for _ in range(10):
        sim.step(437)
        work = spin * (angular_momentum() - start)
        assert sim.energies.work_drives == pytest.approx(work, rel=1e-12, abs=1e-13)
    assert abs(sim.energies.residual) < 1e-13


def top(spin, tilt, precession):
    """u of a top that is tilted about y, with a spin about its axis and a precession about the vertical."""
    return [-precession * np.sin(tilt), 0.0, spin]


def largest_energy(sim, seconds):
    """Run, and return the largest energy of the audit."""
    largest = 0.0
    while sim.time < seconds:
        sim.step(round(0.1 / sim.step_size))
        largest = max(largest, *(abs(energy) for energy in sim.energies[:5]))
    return largest


AUDITED = (*KINDS, "disk_driven", "moving_support_pendulum")  # with an effort, and a drive that does work


@pytest.mark.parametrize("name", [name for name in CLOSED_FORMS if name in AUDITED])
def test_energy_audit_after_ten_seconds_to_round_off(name):
    sim = Simulation.from_file(name)
    if name == "disk_driven":
        sim.set_efforts([0.5])
    largest = largest_energy(sim, 10.0)
    assert abs(sim.energies.residual) < 1e-11 * largest
    assert (sim.energies.work_drives != 0.0) == any(joint.drive for joint in sim.mechanism.joints.values())


OTHERS = [name for name in KINDS if name not in CLOSED_FORMS and shipped()[name].parent.name not in LOOPED]


@pytest.mark.parametrize("name", OTHERS)
def test_energy_audit_after_ten_seconds(name):
    sim = Simulation.from_file(name)
    largest = largest_energy(sim, 10.0)
    assert abs(sim.energies.residual) <= 1e-7 * largest
    assert np.all(np.isfinite(sim.state))
