"""Loops in space: the driveline, and independence of the joint at which a loop is cut."""

from __future__ import annotations

import functools
import re

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.dynamics.equations import derive
from mbd_sim.files.load import load_mechanism
from mbd_sim.files.text.library import shipped
from test.generators.mechanisms import accelerations, consistent_state, derived, violation

G = 9.81


@functools.cache
def equations(name):
    return derive(load_mechanism(name))


def written(name):
    return shipped()[name].read_text()


def cardan(p, phi):
    """ω2/ω1 of the first joint and its derivative by φ (Lidström, p. 4)."""
    c, s = np.cos(p["beta"]), np.sin(p["beta"])
    below = 1.0 - (s * np.cos(phi)) ** 2
    return c / below, -2.0 * c * s**2 * np.sin(phi) * np.cos(phi) / below**2


def spin_of_the_intermediate_shaft(q, u):
    """The component of its angular velocity ω1 e1 + a' e2 + b' e3 along the shaft."""
    a, b = q[1:3]
    return np.cos(a) * np.cos(b) * u[0] - np.sin(b) * u[1]


def test_driveline_speeds():
    """ω2/ω1 = cos β/(1 - sin²β cos²φ), ω3 = ω1 and ω4 = -(r_a/r_b) ω1, at any angle."""
    p, derived_, rng = load_mechanism("driveline").parameters, equations("driveline"), np.random.default_rng(100)
    for _ in range(30):
        q, u, _ = consistent_state(derived_, rng)
        ratio = spin_of_the_intermediate_shaft(q, u) / u[0]
        assert ratio == pytest.approx(cardan(p, q[0])[0], rel=1e-12)
        assert u[3:] == pytest.approx([u[0], -p["r_a"] / p["r_b"] * u[0]], rel=1e-12)


def axial(name):
    """The moments of inertia of the parts about x, by name."""
    return {part.name: part.inertia[0, 0] for part in load_mechanism(name).parts.values()}


def test_driveline_accelerations():
    """(I1 + k² I2 + I3 + n² I4) φ'' = M1 + M3 - n M4 - k k_φ I2 φ'², with k of the Cardan joint and n of the gears."""
    p, derived_, rng = load_mechanism("driveline").parameters, equations("driveline"), np.random.default_rng(101)
    moments, n = axial("driveline"), p["r_a"] / p["r_b"]
    for _ in range(30):
        q, u, efforts = consistent_state(derived_, rng)
        efforts[1:3] = 0.0
        k, slope = cardan(p, q[0])
        inertia = moments["input"] + k**2 * moments["intermediate"] + moments["output"] + n**2 * moments["counter"]
        moment = efforts[0] + efforts[3] - n * efforts[4] - k * slope * moments["intermediate"] * u[0] ** 2
        expected = np.array([1.0, 1.0, -n]) * moment / inertia
        assert accelerations(derived_, q, u, efforts)[[0, 3, 4]] == pytest.approx(expected, rel=1e-10)


def test_redundant_constraint_of_the_driveline():
    """The length of the intermediate shaft already keeps the bearings apart: Kutzbach's count is 0, the rank gives 1."""
    derived_ = equations("driveline")
    assert (derived_.layout.nv, len(derived_.rows), derived_.start.rank) == (5, 5, 4)
    dropped = [row.name for index, row in enumerate(derived_.rows) if index not in derived_.start.independent]
    assert len(dropped) == 1 and dropped[0].startswith("second_cross: displacement")


def free_lift():
    """The scissor lift without a drive at its screw."""
    return re.sub(r"(?m)^    drive: .*\n", "", written("scissor_lift"))


def test_lift_on_a_free_screw():
    """(2 m_b/3 + (m_f + J k²) s² + m c²) l² α'' + … = …, with k = 2π/lead of a screw of inertia J."""
    found, p = derived(free_lift()), load_mechanism("scissor_lift").parameters
    rng, length, turns = np.random.default_rng(102), p["l"], 2.0 * np.pi / p["lead"]
    heavy = p["m_foot"] + 9.0 * 0.02**2 / 2.0 * turns**2
    for _ in range(20):
        q, u, efforts = consistent_state(found, rng, reach=0.2)
        rate, (c, s) = u[2], (np.cos(q[2]), np.sin(q[2]))
        inertia = (2.0 * p["m_bar"] / 3.0 + heavy * s**2 + p["load"] * c**2) * length**2
        force = -(heavy - p["load"]) * length**2 * s * c * rate**2 - (p["m_bar"] + p["load"]) * G * length * c
        force += -(efforts[0] * turns + efforts[1]) * length * s + efforts[2] - efforts[3] + efforts[4]
        second = force / inertia
        out = -length * (s * second + c * rate**2)
        expected = [turns * out, out, second, -second, second]
        assert accelerations(found, q, u, efforts) == pytest.approx(expected, rel=1e-9)


def test_screw_makes_many_turns():
    """The loop of a screw stays closed over whole turns, which do not show in the poses of its frames."""
    text = (
        re.sub("load: 60 kg", "load: 5 kg", free_lift())
        + "forces:\n  push: {type: couple, on: screw, vector: [-6, 0, 0]}\n"
    )
    sim = Simulation.from_text(text)
    found, start = sim.model.equations, sim.q.copy()
    sim.run(until=3.0)
    turns = (sim.q[0] - start[0]) / (2.0 * np.pi)
    assert abs(turns) > 3.0
    assert sim.q[1] - start[1] == pytest.approx(0.01 * turns, abs=1e-12)
    assert violation(sim, found) < 1e-12


CARRIER = "type: free\n    between: [ground, table]\n    angular_velocity: [0.5, 0.3, 1]"


def test_a_plane_loop_on_a_moving_carrier():
    """Three of its five equations are redundant, the same three in any orientation of its plane."""
    table = "  table:\n    mass: 5 kg\n    inertia: [1, 1, 1]\n    points: {pivot: [base, 0, 0]}\n"
    text = written("four_bar").replace("ground:\n  points: {pivot: [base, 0, 0]}\n", "")
    text = text.replace("parts:\n", f"parts:\n{table}", 1).replace("[ground, crank]", "[table, crank]")
    text = text.replace("[ground.pivot, rocker]", "[table.pivot, rocker]")
    sim = Simulation.from_text(text.replace("joints:\n", f"joints:\n  carrier:\n    {CARRIER}\n", 1))
    found = sim.model.equations
    assert (len(found.rows), found.start.rank) == (5, 2)
    highest = 0.0
    for _ in range(140):
        sim.step(50)
        axes = sim.poses()["table"].rotation
        highest = max(highest, sim.energies.kinetic)
        assert violation(sim, found) < 1e-12
        assert abs(sim.energies.residual) < 1e-12 * highest
    assert axes[0, 0] != pytest.approx(1.0, abs=0.01)


GOVERNOR = """
mechanism: governor
parts:
  spindle: {mass: 1, inertia: [0.05, 0.05, 0.02], points: {top: [0, 0, 1]}}
  sleeve: {mass: 1, inertia: [0.01, 0.01, 0.01]}
  arm: {mass: 0.5, center: [0, 0, -0.3], inertia: [0.01, 0.012, 0.002], points: {tip: [0, 0, -0.6]}}
  link: {mass: 0.3, center: [0, 0, 0.3], inertia: [0.01, 0.012, 0.002], points: {tip: [0, 0, 0.6]}}
joints:
  spin: {type: revolute, between: [ground, spindle], axis: [0, 0, 1], position: 0, velocity: 7}
  slide: {type: cylindrical, between: [ground, sleeve], axis: [0, 0, 1], position: [0.1, 0], guess: true}
  shoulder: {type: revolute, between: [spindle.top, arm], axis: [0, -1, 0], position: 40 deg, guess: true}
  foot: {type: revolute, between: [sleeve, link], axis: [0, 1, 0], position: 40 deg, guess: true}
  knee: {type: revolute, between: [arm.tip, link.tip], axis: [0, 1, 0]}
"""


@pytest.mark.parametrize("cut", ["knee", "shoulder"])
def test_a_loop_on_ground_may_rotate_about_an_axis(cut):
    """The redundant row rotates with Watt's governor; along ground's axes it would not stay redundant."""
    text = GOVERNOR
    if cut != "knee":
        text = text.replace("knee: {", "knee: {position: -80 deg, guess: true, ")
        text = "\n".join(
            line.replace("position: 40 deg, guess: true", "cut: true") if line.strip().startswith(cut) else line
            for line in text.splitlines()
        )
    simulation = Simulation.from_text(text)
    simulation.run(until=3.0)
    assert tuple(simulation.mechanism.closing) == (cut,)
    assert abs(simulation.q[0]) > 6.0
    assert abs(simulation.energies.residual) < 1e-11
    assert max(simulation.violation) < 1e-13
