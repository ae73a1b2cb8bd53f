"""Accelerations at random states against the closed forms of textbooks.

Further mechanisms are in test_systems.py.
"""

from __future__ import annotations

import numpy as np
import pytest

from mbd_sim.dynamics.equations import derive
from mbd_sim.files.load import load_mechanism
from test.generators.mechanisms import accelerations, derived

G = 9.81
TOLERANCE = 1e-13


def draw(rng, *sizes):
    """Positions, speeds and efforts of these sizes."""
    return [rng.uniform(-2.5, 2.5, size) for size in sizes]


@pytest.fixture(params=range(8))
def rng(request):
    return np.random.default_rng(100 + request.param)


def near(expected):
    """Equal to the closed form, relative to the largest acceleration."""
    expected = np.asarray(expected, dtype=float)
    return pytest.approx(expected, rel=0.0, abs=TOLERANCE * float(np.max(np.abs(expected))))


class TestRodPendulum:
    """Huston & Liu, sec. 8.9: (1/3) m l² θ'' + (1/2) m g l sin θ = 0."""

    equations = derive(load_mechanism("rod_pendulum"))

    def test_accelerations(self, rng):
        q, u, effort = draw(rng, 1, 1, 1)
        expected = 3.0 * (effort - 0.5 * G * np.sin(q))
        assert accelerations(self.equations, q, u, effort) == near(expected)


def double_rod(theta, rate, torques, m1=1.0, m2=1.0, l1=1.0, l2=1.0):
    """θ'' of two rods in absolute angles (Huston & Liu, sec. 11.12.3); `torques` are generalized forces of the angles."""
    c, s = np.cos(theta[0] - theta[1]), np.sin(theta[0] - theta[1])
    half = 0.5 * m2 * l1 * l2
    mass = np.array([[m1 * l1**2 / 3 + m2 * l1**2, half * c], [half * c, m2 * l2**2 / 3]])
    right = torques - np.array(
        [
            half * s * rate[1] ** 2 + (m1 / 2 + m2) * G * l1 * np.sin(theta[0]),
            -half * s * rate[0] ** 2 + 0.5 * m2 * G * l2 * np.sin(theta[1]),
        ]
    )
    return np.linalg.solve(mass, right)


class TestDoubleRod:
    """Relative angles β give the motion of the absolute ones: θ1 = β1, θ2 = β1 + β2 (Lidström, theorem 9.2)."""

    equations = derive(load_mechanism("double_rod"))

    def test_accelerations(self, rng):
        beta, rate, effort = draw(rng, 2, 2, 2)
        # a torque at the elbow acts on the lower rod and, reversed, on the upper one
        absolute = double_rod(np.cumsum(beta), np.cumsum(rate), np.array([effort[0] - effort[1], effort[1]]))
        expected = [absolute[0], absolute[1] - absolute[0]]
        assert accelerations(self.equations, beta, rate, effort) == near(expected)


def free_state(rng):
    p = rng.normal(size=4)
    return np.concatenate([rng.uniform(-3, 3, 3), p / np.linalg.norm(p)]), *draw(rng, 6, 6)


class TestFreeBody:
    """Huston & Liu, sec. 8.7: the center of mass falls, and the spin obeys Euler's equations I ω' + ω × I ω = M."""

    tumbling = derive(load_mechanism("tumbling"))

    def test_tumbling(self, rng):
        q, u, effort = free_state(rng)
        moments, w = np.array([1.0, 2.0, 3.0]), u[3:]
        spin = (effort[3:] - np.cross(w, moments * w)) / moments
        assert accelerations(self.tumbling, q, u, effort) == near([*effort[:3], *spin])

    def test_frame_away_from_the_center_of_mass(self, rng):
        """A force at the frame's origin and a couple, with the center of mass elsewhere: Newton–Euler about that center."""
        tensor = np.array([[0.5, 0.05, -0.02], [0.05, 0.6, 0.03], [-0.02, 0.03, 0.4]])
        center = np.array([0.2, -0.1, 0.3])
        equations = derived("""
mechanism: eccentric
parts:
  body: {mass: 2, center: [0.2, -0.1, 0.3],
    inertia: {xx: 0.5, yy: 0.6, zz: 0.4, xy: 0.05, xz: -0.02, yz: 0.03}}
joints: {flight: {type: free, between: [ground, body]}}
""")
        q, u, effort = free_state(rng)
        w0, x, y, z = q[3:]
        rotation = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w0 * z), 2 * (x * z + w0 * y)],
                [2 * (x * y + w0 * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w0 * x)],
                [2 * (x * z - w0 * y), 2 * (y * z + w0 * x), 1 - 2 * (x * x + y * y)],
            ]
        )
        w = u[3:]
        moment = effort[3:] - np.cross(center, rotation.T @ effort[:3])
        alpha = np.linalg.solve(tensor, moment - np.cross(w, tensor @ w))
        of_center = effort[:3] / 2.0 + [0.0, 0.0, -G]
        origin = of_center - rotation @ (np.cross(alpha, center) + np.cross(w, np.cross(w, center)))
        assert accelerations(equations, q, u, effort) == near([*origin, *alpha])
