"""The shipped mechanisms with loops and constraints against the closed forms of textbooks.

The tests compare accelerations at random consistent states with the closed form, end states with reference values, and
check the energy audit and the constraints over ten seconds. See also test_rolling.py and test_loops.py.
"""

from __future__ import annotations

import functools

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.dynamics.equations import derive
from mbd_sim.files.load import load_mechanism
from mbd_sim.files.text.library import shipped
from test.generators.mechanisms import KINDS, accelerations, consistent_state, violation

G = 9.81


@functools.cache
def equations(name):
    return derive(load_mechanism(name))


def relative(found, expected):
    """The largest error relative to the largest component, or to 1: forces of order 1 cancel in smaller ones."""
    expected = np.asarray(expected, dtype=float)
    return np.max(np.abs(found - expected)) / max(np.max(np.abs(expected)), 1.0)


# Planar loops in complex numbers: a bar is a exp(iθ), and the loop equation is solved for two rates at a time.


def two_rates(first, second, known):
    """Real x and y with x first + y second = known; the other numbers are complex."""
    return np.linalg.solve([[first.real, second.real], [first.imag, second.imag]], [known.real, known.imag])


def bar(length, angle):
    return length * np.exp(1j * angle)


def one_freedom(motions, force):
    """The acceleration θ'' of Σ m |z|² θ'' = Q - Σ m Re(z* b), for masses m with accelerations z θ'' + b."""
    inertia = sum(m * abs(z) ** 2 for m, z, _ in motions)
    return (force - sum(m * (np.conj(z) * b).real for m, z, b in motions)) / inertia


# Closed forms: u' from the file's parameters p, the time, the state, and the efforts e.


def constrained_pendulum(p, t, q, u, e):
    """θ'' + (g/l) sin θ = 0 (Huston & Liu, sec. 8.4) in u1 = l cos θ - l and u2 = l sin θ."""
    length = p["l"]
    c, s = 1.0 + q[0] / length, q[1] / length
    rate = (c * u[1] - s * u[0]) / length
    second = -G / length * s + (c * e[1] - s * e[0]) / (p["m"] * length)
    return [-length * (s * second + c * rate**2), length * (c * second - s * rate**2)]


def a01_simple_pendulum(p, t, q, u, e):
    """The pendulum in x and z."""
    down = constrained_pendulum({"m": 1.0, "l": 1.0}, t, [-q[1] - 1.0, q[0]], [-u[1], u[0]], [-e[1], e[0]])
    return [down[1], -down[0]]


def on_a_sphere(m, radius, q, u, e):
    """On a sphere a particle accelerates along the sphere as the force demands, and toward the center by v²/R."""
    normal, free = q / radius, e / m - [0.0, 0.0, G]
    return free - normal * (normal @ free + u @ u / radius)


def spherical_pendulum(p, t, q, u, e):
    """Lidström, sec. 9.1, without angles."""
    return on_a_sphere(p["m"], p["l"], q, u, e)


def insect_on_sphere(p, t, q, u, e):
    """Huston & Liu, P11.2.2."""
    return on_a_sphere(p["m"], p["radius"], q, u, e)


def bead_on_wire(p, t, q, u, e):
    """A curve (x, y(x), z(x)) of slope s: m |s|² x'' + m (s · ds/dx) x'² = s · (force - m g)."""
    (x, y, _), a, k = q, p["a"], p["k"]
    y1, y2 = a * k * np.cos(k * x), -a * k**2 * np.sin(k * x)
    slope = np.array([1.0, y1, (x + y * y1) / p["p"]])
    bend = np.array([0.0, y2, (1.0 + y1**2 + y * y2) / p["p"]])
    pull = slope @ (e / p["m"] - [0.0, 0.0, G]) - slope @ bend * u[0] ** 2
    return slope * pull / (slope @ slope) + bend * u[0] ** 2


def slider_crank(p, t, q, u, e):
    """Lidström, p. 10-12, as a mechanism of one degree of freedom."""
    r, length = p["r"], p["b"] + p["c"]
    crank, coupler = bar(r, q[0]), bar(length, q[0] + q[1])
    turned, _ = two_rates(1j * coupler, -1.0 + 0j, -1j * crank)
    bend = (crank + turned**2 * coupler) * u[0] ** 2
    bent, _ = two_rates(1j * coupler, -1.0 + 0j, bend)
    motions = [
        (p["m_crank"] / 3.0, 1j * crank, 0.0),
        (
            p["m_coupler"],
            1j * crank + 0.5j * turned * coupler,
            0.5j * bent * coupler - 0.5 * (bend + crank * u[0] ** 2),
        ),
        (p["m_coupler"] / 12.0, length * turned, length * bent),
        (p["m_slider"], 1j * crank + 1j * turned * coupler, 1j * bent * coupler - bend),
    ]
    weight = -G * sum(m * z.imag for m, z in ((p["m_crank"] / 2, 1j * crank), (p["m_coupler"], motions[1][1])))
    second = one_freedom(motions, weight + e @ [1.0, turned - 1.0, -turned])
    phi = turned * second + bent
    return [second, phi - second, -phi]


def four_bar(p, t, q, u, e):
    """Crank, coupler and rocker: a exp(iθ) + b exp(iφ) = d + c exp(iψ)."""
    crank, coupler, rocker = bar(p["crank"], q[0]), bar(p["coupler"], q[0] + q[1]), bar(p["rocker"], q[2])
    phi1, psi1 = two_rates(1j * coupler, -1j * rocker, -1j * crank)
    known = (crank + phi1**2 * coupler - psi1**2 * rocker) * u[0] ** 2
    phi2, psi2 = two_rates(1j * coupler, -1j * rocker, known)
    a, b, c = (p["density"] * p[name] for name in ("crank", "coupler", "rocker"))
    middle = 1j * crank + 0.5j * phi1 * coupler
    motions = [
        (a / 3.0, 1j * crank, 0.0),
        (b, middle, 0.5j * phi2 * coupler - (crank + 0.5 * phi1**2 * coupler) * u[0] ** 2),
        (b / 12.0, p["coupler"] * phi1, p["coupler"] * phi2),
        (c / 3.0, p["rocker"] * psi1, p["rocker"] * psi2),
    ]
    weight = -G * (0.5 * a * crank.real + b * middle.imag + 0.5 * c * psi1 * rocker.real)
    second = one_freedom(motions, weight + e @ [1.0, phi1 - 1.0, psi1])
    return [second, (phi1 - 1.0) * second + phi2, psi1 * second + psi2]


def knife_edge(p, t, q, u, e):
    """Huston & Liu, P11.2.3: it accelerates forward by the force along the edge, and sideways as the edge turns."""
    c, s = np.cos(q[2]), np.sin(q[2])
    forward, speed = (c * e[0] + s * e[1]) / p["m"], c * u[0] + s * u[1]
    inertia = p["m"] * (p["length"] ** 2 + 0.004**2) / 12.0
    return [c * forward - s * speed * u[2], s * forward + c * speed * u[2], e[2] / inertia]


def upright_wheel(p, t, q, u, e):
    """Géradin & Rixen, p. 12-14: (m + I/r²) x'' = m g sin(slope) + F + M/r."""
    down = (p["m"] * G * np.sin(p["slope"]) + e[1] + e[2] / p["r"]) / (1.5 * p["m"])
    return [0.0, down, down / p["r"]]


def disk_weight(p, t, q, u, e):
    """Huston & Liu, sec. 8.8: α = W r/(I + mass r²)."""
    alpha = (e[0] + p["r"] * (p["mass"] * G + e[1])) / (0.5 * p["m"] * p["r"] ** 2 + p["mass"] * p["r"] ** 2)
    return [alpha, p["r"] * alpha]


def atwood(p, t, q, u, e):
    """(m1 + m2) x'' = (m2 - m1) g - k x."""
    pull = (p["m2"] - p["m1"]) * G - p["k"] * (q[1] - p["h"]) + e[1] - e[0]
    return np.array([-1.0, 1.0]) * pull / (p["m1"] + p["m2"])


def swinging_atwood(p, t, q, u, e):
    """(M + m) ρ'' = m ρ θ'² + g (m cos θ - M) and ρ θ'' + 2 ρ' θ' + g sin θ = 0, with forces along both."""
    m, rho = p["m"], np.hypot(q[0], q[1])
    out, around = np.array([q[0], q[1]]) / rho, np.array([-q[1], q[0]]) / rho
    spin, out1 = around @ u[:2] / rho, out @ u[:2]
    force = e[:2] - [0.0, m * G]
    rho2 = (m * rho * spin**2 + out @ force - p["M"] * G - e[2]) / (p["M"] + m)
    spin2 = (around @ force / m - 2.0 * out1 * spin) / rho
    return [*(out * (rho2 - rho * spin**2) + around * (rho * spin2 + 2.0 * out1 * spin)), -rho2]


def rack_and_pinion(p, t, q, u, e):
    """(I + m r²) θ'' + k r² θ = 0."""
    r = p["r"]
    alpha = (e[0] + r * (e[1] - p["k"] * q[1])) / (0.5 * p["m_pinion"] * r**2 + p["m_rack"] * r**2)
    return [alpha, r * alpha]


def scissor_lift(p, t, q, u, e):
    """Everything follows the screw: x'' is lead/2π times its angular acceleration, and x = l cos α."""
    w = 2.0 * np.pi / p["period"]
    out = p["lead"] / 2.0 * p["turns"] * w**2 * np.cos(w * t)
    tilt = -(out + q[0] * u[1] ** 2) / (p["l"] * np.sin(q[1]))
    return [out, tilt, -tilt, tilt]


def a02_four_bars(p, t, q, u, e):
    """((N + 1)/3 + N) θ'' + ((N + 1)/2 + N) g cos θ = 0 for all rods, from the horizontal; the bars stay level."""
    pull = 3.5 * G * np.sin(q[0]) + e[:3].sum() - e[3:].sum()
    return np.array([1.0, 1.0, 1.0, -1.0, -1.0]) * pull / 3.0


CLOSED_FORMS = {
    form.__name__: form
    for form in (
        constrained_pendulum,
        spherical_pendulum,
        insect_on_sphere,
        bead_on_wire,
        slider_crank,
        four_bar,
        knife_edge,
        upright_wheel,
        disk_weight,
        atwood,
        swinging_atwood,
        rack_and_pinion,
        scissor_lift,
        a01_simple_pendulum,
        a02_four_bars,
    )
}
# The distance of random states from the start, where other branches or singular configurations are near.
REACH = {"slider_crank": 0.5, "four_bar": 0.7, "scissor_lift": 0.2, "swinging_atwood": 0.5, "a02_four_bars": 0.4}


@pytest.mark.parametrize("name", CLOSED_FORMS)
def test_accelerations(name):
    derived_, rng, worst = equations(name), np.random.default_rng(70), 0.0
    parameters = load_mechanism(name).parameters
    for _ in range(4):
        t = rng.uniform(0.0, 3.0) if name == "scissor_lift" else 0.0
        q, u, efforts = consistent_state(derived_, rng, t, REACH.get(name, 1.0))
        expected = CLOSED_FORMS[name](parameters, t, q, u, efforts)
        worst = max(worst, relative(accelerations(derived_, q, u, efforts, t), expected))
    assert worst < 1e-12


# Those of each kind, and of others the ones whose loops have a freedom of their own, or are singular or indeterminate.
LOOPED = sorted(
    name
    for name in (*KINDS, "rolling_disc", "rssr", "stewart", "three_cranks")
    if shipped()[name].parent.name in ("constraints", "benchmarks")
)


@pytest.mark.parametrize("name", LOOPED)
def test_energy_audit_and_constraints(name):
    """Over two seconds; scripts/systems_table runs for a minute or longer."""
    sim, derived_ = Simulation.from_file(name), equations(name)
    largest = worst = 0.0
    while sim.time < 2.0:
        sim.step(100)
        largest = max(largest, *(abs(energy) for energy in sim.energies[:5]))
        worst = max(worst, violation(sim, derived_))
        assert abs(sim.energies.residual) < 1e-9 * largest
    assert worst < 1e-12
