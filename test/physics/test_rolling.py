"""The rolling disc (Huston & Liu, sec. 11.10.5 and 11.12.5).

The disc is nonholonomic: treating its coordinates as free gives wrong equations. The angles are those of the book, lean
θ, yaw φ and spin ψ, where n2 is the axis of the disc, n1 is horizontal and n3 = n1 × n2.
"""

from __future__ import annotations

import functools

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.base.geometry.rotation import from_quaternion
from mbd_sim.dynamics.equations import derive
from mbd_sim.files.load import load_mechanism
from test.generators.mechanisms import accelerations, consistent_state

G, R = 9.81, 0.5
UP = np.array([0.0, 0.0, 1.0])


@functools.cache
def equations():
    return derive(load_mechanism("rolling_disc"))


def frame(q):
    """The unit vectors n1, n2 and n3 as rows."""
    n2 = from_quaternion(q[3:])[:, 1]
    n1 = np.cross(n2, UP)
    n1 /= np.linalg.norm(n1)
    return np.array([n1, n2, np.cross(n1, n2)])


def angles(q):
    """θ, φ and ψ, each within one turn."""
    n1, n2, _ = n = frame(q)
    ahead = from_quaternion(q[3:])[:, 0]  # lies along n1 where ψ = 0
    return np.array([np.arcsin(n2[2]), np.arctan2(n1[1], n1[0]), np.arctan2(-(ahead @ n[2]), ahead @ n1)])


def rates(q, omega):
    """θ', φ' and ψ' for an angular velocity in ground's axes."""
    n1, n2, n3 = frame(q)
    s, c = n2[2], n3[2]
    yaw = omega @ n3 / c
    return np.array([omega @ n1, yaw, omega @ n2 - yaw * s])


def book(theta, rate):
    """θ'', φ'' and ψ'' from the three equations of motion of the book."""
    s, c, (theta1, phi1, psi1) = np.sin(theta), np.cos(theta), rate
    first = (G / R * s + 1.25 * phi1**2 * s * c + 1.5 * phi1 * psi1 * c) / 1.25
    matrix = [[1.5 * s, 1.5], [1.5 * s**2 + 0.25 * c**2, 1.5 * s]]
    right = [-2.5 * phi1 * theta1 * c, -2.5 * phi1 * theta1 * s * c - 0.5 * psi1 * theta1 * c]
    return np.array([first, *np.linalg.solve(matrix, right)])


def of_angles(q, rate, second):
    """u' of the free joint for θ'', φ'' and ψ''; the center moves with r ω × n3."""
    n = n1, n2, n3 = frame(q)
    s, c, (theta1, phi1, psi1) = n2[2], n3[2], rate
    omega = theta1 * n1 + phi1 * UP + psi1 * n2
    turning = theta1 * n1 + phi1 * UP  # of n1, n2, n3
    along = [second[0], second[2] + second[1] * s + phi1 * theta1 * c, second[1] * c - phi1 * theta1 * s]
    alpha = along @ n + np.cross(turning, omega)
    center = R * (np.cross(alpha, n3) + np.cross(omega, np.cross(turning, n3)))
    return np.concatenate([center, from_quaternion(q[3:]).T @ alpha])


def states(number):
    rng = np.random.default_rng(80)
    for _ in range(number):
        q, u, _ = consistent_state(equations(), rng)
        omega = from_quaternion(q[3:]) @ u[3:]
        yield q, u, np.arcsin(frame(q)[1][2]), rates(q, omega)


def test_accelerations():
    for q, u, theta, rate in states(40):
        found = accelerations(equations(), q, u)
        expected = of_angles(q, rate, book(theta, rate))
        assert found == pytest.approx(expected, rel=0.0, abs=1e-12 * np.max(np.abs(expected)))


def test_a_wheel_rolls_steadily_in_a_circle():
    """At θ'' = 0 in the book's equations, for a given lean and yaw rate, only position and heading change."""
    theta, yaw = 0.3, -1.5
    spin = -(G / R * np.sin(theta) + 1.25 * yaw**2 * np.sin(theta) * np.cos(theta)) / (1.5 * yaw * np.cos(theta))
    sim = Simulation.from_file("rolling_disc")
    omega = np.array([0.0, spin + yaw * np.sin(theta), yaw * np.cos(theta)])
    q = [0.0, 0.0, R * np.cos(theta), np.cos(theta / 2), np.sin(theta / 2), 0.0, 0.0]
    n3 = np.array([0.0, -np.sin(theta), np.cos(theta)])
    sim.reset(q=q, u=[*(R * np.cross(from_quaternion(np.array(q[3:])) @ omega, n3)), *omega])
    for _ in range(10):
        sim.step(100)
        assert angles(sim.q)[0] == pytest.approx(theta, abs=1e-10)
        assert rates(sim.q, from_quaternion(sim.q[3:]) @ sim.u[3:]) == pytest.approx([0.0, yaw, spin], abs=1e-9)
