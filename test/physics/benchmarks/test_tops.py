"""The heavy symmetric top and the free top: exact motions, and Euler's equations integrated independently."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from mbd_sim import Simulation
from mbd_sim.base.geometry.rotation import from_quaternion
from mbd_sim.files.load import load_mechanism

G = 9.81
WEIGHT, TRANSVERSE, AXIAL = 15.0 * G, 0.234375 + 15.0, 0.46875  # of the heavy top, about its point


def turned(vector):
    return Rotation.from_rotvec(vector).as_matrix()


def top_rates(t, state):
    """Euler's equations about the point and R' = R [ω]×, with the nine numbers of R; the axis is the body's y."""
    turn, omega = state[:9].reshape(3, 3), state[9:]
    moments = np.array([TRANSVERSE, AXIAL, TRANSVERSE])
    moment = np.cross([0.0, 1.0, 0.0], turn.T @ [0.0, 0.0, -WEIGHT])
    x, y, z = omega
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.concatenate([(turn @ cross).ravel(), (moment - np.cross(omega, moments * omega)) / moments])


def test_heavy_top_follows_eulers_equations():
    sim = Simulation.from_file("heavy_top")
    start = np.concatenate([np.eye(3).ravel(), sim.u])
    found = solve_ivp(top_rates, (0.0, 0.3), start, method="DOP853", rtol=1e-13, atol=1e-12, t_eval=[0.1, 0.3])
    for until, state in zip(found.t, found.y.T, strict=True):
        sim.run(until=until)
        axis = from_quaternion(sim.q)[:, 1]
        assert axis == pytest.approx(state[:9].reshape(3, 3)[:, 1], abs=1e-8)
        assert sim.u == pytest.approx(state[9:], abs=1e-6)


def test_heavy_top_keeps_its_momenta():
    """The spin, the angular momentum about the vertical, and the energy."""
    sim = Simulation.from_file("heavy_top")
    moments = np.array([TRANSVERSE, AXIAL, TRANSVERSE])

    def vertical():
        return (from_quaternion(sim.q) @ (moments * sim.u))[2]

    start = vertical()
    nods = []
    for _ in range(200):
        sim.step(50)
        assert sim.u[1] == pytest.approx(150.0, rel=1e-13)
        assert vertical() == pytest.approx(start, rel=1e-11)
        nods.append(from_quaternion(sim.q)[2, 1])
    assert np.ptp(nods) > 0.1
    assert abs(sim.energies.residual) < 1e-11 * sim.energies.kinetic


@pytest.mark.parametrize(("tilt", "slow"), [(0.3, True), (np.pi / 2, True), (2.0, False)])
def test_heavy_top_precesses_steadily(tilt, slow):
    """At both roots of I1 Ω² cos θ - I3 ω3 Ω + m g h = 0 (at the only root if the axis is horizontal)."""
    spin, c = 230.0, np.cos(tilt)
    roots = (
        np.roots([TRANSVERSE * c, -AXIAL * spin, WEIGHT]) if abs(c) > 1e-12 else np.array([WEIGHT / (AXIAL * spin)] * 2)
    )
    rate = roots[np.argmin(np.abs(roots)) if slow else np.argmax(np.abs(roots))].real
    turn = turned([np.pi / 2 - tilt, 0.0, 0.0])  # the axis, the body's y, is tilted from the vertical toward +y
    omega = turn.T @ [0.0, 0.0, rate]
    omega[1] = spin
    sim = Simulation.from_file("heavy_top")
    quaternion = Rotation.from_matrix(turn).as_quat()[[3, 0, 1, 2]]
    sim.reset(q=quaternion, u=omega)
    for _ in range(8):
        sim.step(200)
        phase = rate * sim.time
        expected = [-np.sin(tilt) * np.sin(phase), np.sin(tilt) * np.cos(phase), c]
        assert from_quaternion(sim.q)[:, 1] == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(("spin", "sleeps"), [(1.05, True), (0.95, False)])
def test_sleeping_top(spin, sleeps):
    """An upright top is stable only while it spins faster than 2 sqrt(I1 m g h)/I3."""
    critical = 2.0 * np.sqrt(TRANSVERSE * WEIGHT) / AXIAL
    sim = Simulation.from_file("heavy_top")
    lean = 1e-4
    quaternion = Rotation.from_rotvec([np.pi / 2 - lean, 0.0, 0.0]).as_quat()[[3, 0, 1, 2]]
    sim.reset(q=quaternion, u=[0.0, spin * critical, 0.0])
    farthest = 0.0
    for _ in range(100):
        sim.step(100)
        farthest = max(farthest, np.hypot(*from_quaternion(sim.q)[:2, 1]))
    assert (farthest < 10.0 * lean) == sleeps
    assert sleeps or farthest > 0.1


def test_symmetric_top_moves_as_euler_says():
    """R(t) = exp(L t/I1) R(0) exp((I1 - I3)/I1 ω3 t): exact."""
    p, sim = load_mechanism("symmetric_top").parameters, Simulation.from_file("symmetric_top")
    across, along = p["m"] * (3.0 * p["r"] ** 2 + p["h"] ** 2) / 12.0, p["m"] * p["r"] ** 2 / 2.0
    omega = sim.u[3:].copy()
    momentum = np.array([across, across, along]) * omega
    for _ in range(10):
        sim.step(300)
        around = turned(momentum / across * sim.time)
        about = turned([0.0, 0.0, (across - along) / across * omega[2] * sim.time])
        assert from_quaternion(sim.q[3:]) == pytest.approx(around @ about, abs=1e-10)
        height = 5.0 * sim.time - 0.5 * G * sim.time**2
        assert sim.q[:3] == pytest.approx([0.0, 0.0, height], abs=1e-11)
