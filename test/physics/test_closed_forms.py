"""Accelerations against the closed forms of the textbooks (SYSTEMS.md), at random states."""

from __future__ import annotations

import numpy as np
import pytest
from mechanisms import CART_PENDULUM, COLLARS, DISK, PROJECTILE, TRIPLE_ROD, accelerations, derived

from mbd_sim.dynamics.equations import derive
from mbd_sim.mechanism.load import load_mechanism

G = 9.81
TOLERANCE = 1e-13


def draw(rng, *sizes):
    """Positions, speeds and efforts of these sizes."""
    return [rng.uniform(-2.5, 2.5, size) for size in sizes]


@pytest.fixture(params=range(8))
def rng(request):
    return np.random.default_rng(100 + request.param)


def near(expected):
    """Equal to the closed form: relative to the largest of the accelerations."""
    expected = np.asarray(expected, dtype=float)
    return pytest.approx(expected, rel=0.0, abs=TOLERANCE * float(np.max(np.abs(expected))))


class TestRodPendulum:
    """Huston & Liu 8.9: (1/3) m l² θ'' + (1/2) m g l sin θ = 0."""

    equations = derive(load_mechanism("rod_pendulum"))

    def test_accelerations(self, rng):
        q, u, effort = draw(rng, 1, 1, 1)
        expected = 3.0 * (effort - 0.5 * G * np.sin(q))
        assert accelerations(self.equations, q, u, effort) == near(expected)


class TestSimplePendulum:
    """Huston & Liu 8.4: θ'' + (g/l) sin θ = 0; Lidström p. 16: the same from the horizontal."""

    equations = derived(
        """
mechanism: simple
parts: {bob: {mass: 0.7}}
joints: {pin: {type: revolute, between: [ground, bob.pivot], axis: [0, -1, 0]}}
""".replace("{mass: 0.7}", "{mass: 0.7, points: {pivot: [0, 0, 1.3]}}")
    )

    def test_accelerations(self, rng):
        q, u = draw(rng, 1, 1)
        assert accelerations(self.equations, q, u) == near(-G / 1.3 * np.sin(q))

    def test_from_the_horizontal(self, rng):
        q, u = draw(rng, 1, 1)
        equations = derived("""
mechanism: circle
parts: {bob: {mass: 2, center: [0.8, 0, 0]}}
joints: {pin: {type: revolute, between: [ground, bob], axis: [0, -1, 0]}}
""")
        assert accelerations(equations, q, u) == near(-G / 0.8 * np.cos(q))


def double_rod(theta, rate, torques, m1=1.0, m2=1.0, l1=1.0, l2=1.0):
    """θ'' of two rods in absolute angles (Huston & Liu 11.12.3); `torques` are generalized forces of the angles."""
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
        # a torque at the elbow turns the lower rod and, reversed, the upper one
        absolute = double_rod(np.cumsum(beta), np.cumsum(rate), np.array([effort[0] - effort[1], effort[1]]))
        expected = [absolute[0], absolute[1] - absolute[0]]
        assert accelerations(self.equations, beta, rate, effort) == near(expected)


class TestTripleRod:
    """Three rods with a particle at the tip and torsion springs, from Lagrange's equations in absolute angles."""

    equations = derived(TRIPLE_ROD)

    def test_accelerations(self, rng):
        beta, rate = draw(rng, 3, 3)
        theta, omega = np.cumsum(beta), np.cumsum(rate)
        m, length = 1.0, 0.5
        beyond = np.array([2.5, 1.5, 0.5]) * m  # masses that hang at the end of each rod, the tip among them
        across = np.array(
            [[m / 3 + beyond[i] if i == j else m / 2 + beyond[max(i, j)] for j in range(3)] for i in range(3)]
        )
        difference = theta[:, None] - theta[None, :]
        mass = across * length**2 * np.cos(difference)
        centrifugal = (across * length**2 * np.sin(difference)) @ omega**2
        gravity = (m / 2 + beyond) * G * length * np.sin(theta)
        k = np.array([8.0, 6.0, 4.0])
        springs = -k * beta + np.append(k[1:] * beta[1:], 0.0)
        expected = np.linalg.solve(mass, springs - centrifugal - gravity)
        assert accelerations(self.equations, beta, rate) == near(np.diff(expected, prepend=0.0))


class TestCartPendulum:
    """Lidström ex. 4:14: a cart on a spring with a pendulum and a force."""

    equations = derived(CART_PENDULUM)

    def test_accelerations(self, rng):
        (x, theta), (_, rate), (force, torque) = draw(rng, 2, 2, 2)
        c, s = np.cos(theta), np.sin(theta)
        expected = np.linalg.solve([[2.0, c], [c, 1.0]], [force + s * rate**2 - 20.0 * x, torque - G * s])
        found = accelerations(self.equations, np.array([x, theta]), np.array([0.3, rate]), [force, torque])
        assert found == near(expected)


class TestCollars:
    """Huston & Liu P11.4.2: two collars in series on a rotating rod; the second's position is relative to the first."""

    equations = derived(COLLARS)

    def test_accelerations(self, rng):
        q, u, effort = draw(rng, 3, 3, 3)
        inertia, m1, m2 = 3.0 * 2.0**2 / 3.0, 0.7, 0.4
        r1, r2, v1, v2 = q[1], q[1] + q[2], u[1], u[1] + u[2]
        spin = u[0]
        angular = (effort[0] - 2.0 * spin * (m1 * r1 * v1 + m2 * r2 * v2)) / (inertia + m1 * r1**2 + m2 * r2**2)
        first = r1 * spin**2 + (effort[1] - effort[2]) / m1
        second = r2 * spin**2 + effort[2] / m2
        assert accelerations(self.equations, q, u, effort) == near([angular, first, second - first])


class TestDisk:
    """Huston & Liu 8.8: a force W at the rim turns a disk by W r / I_O."""

    equations = derived(DISK)

    def test_accelerations(self, rng):
        q, u, force = draw(rng, 1, 1, 1)
        assert accelerations(self.equations, q, u, force * 0.3) == near(force * 0.3 / (0.5 * 4.0 * 0.3**2))


def free_state(rng):
    p = rng.normal(size=4)
    return np.concatenate([rng.uniform(-3, 3, 3), p / np.linalg.norm(p)]), *draw(rng, 6, 6)


class TestFreeBody:
    """Huston & Liu 8.7: the mass centre falls, the spin obeys Euler's equations I ω' + ω × I ω = M."""

    tumbling = derive(load_mechanism("tumbling"))
    projectile = derived(PROJECTILE)

    def test_tumbling(self, rng):
        q, u, effort = free_state(rng)
        moments, w = np.array([1.0, 2.0, 3.0]), u[3:]
        spin = (effort[3:] - np.cross(w, moments * w)) / moments
        assert accelerations(self.tumbling, q, u, effort) == near([*effort[:3], *spin])

    def test_projectile(self, rng):
        q, u, _ = free_state(rng)
        moments, w = np.array([0.1, 0.25, 0.3]), u[3:]
        expected = [0.0, 0.0, -G, *(-np.cross(w, moments * w) / moments)]
        assert accelerations(self.projectile, q, u) == near(expected)

    def test_frame_away_from_the_mass_centre(self, rng):
        """A force at the frame's origin and a couple, with the mass centre elsewhere: Newton and Euler about it."""
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


class TestBryanAngles:
    """Huston & Liu P11.4.3: a box on three hinges x, y, z with massless rings between."""

    equations = derived("""
mechanism: bryan
gravity: [0, 0, 0]
parts: {a: {mass: 0}, b: {mass: 0}, box: {mass: 5, inertia: [1, 2, 2.5]}}
joints:
  alpha: {type: revolute, between: [ground, a], axis: [1, 0, 0]}
  beta: {type: revolute, between: [a, b], axis: [0, 1, 0]}
  gamma: {type: revolute, between: [b, box], axis: [0, 0, 1]}
""")

    def test_angular_velocity(self, rng):
        (a, b, c), (a1, b1, c1) = draw(rng, 3, 3)
        omega = np.array(
            [
                a1 * np.cos(b) * np.cos(c) + b1 * np.sin(c),
                b1 * np.cos(c) - a1 * np.cos(b) * np.sin(c),
                c1 + a1 * np.sin(b),
            ]
        )
        kinetic, _ = self.equations.energies(0.0, [a, b, c, a1, b1, c1, 0, 0, 0]).nz
        assert kinetic == pytest.approx(0.5 * omega @ (np.array([1.0, 2.0, 2.5]) * omega), rel=1e-14)
