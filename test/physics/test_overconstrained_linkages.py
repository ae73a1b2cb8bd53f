"""The shipped overconstrained linkages against their closed forms."""

import numpy as np
import pytest

from mbd_sim import Simulation


def test_three_cranks_turn_like_one_pendulum():
    """T = ½ (Σ m/3 + M) r² ω² and V = (Σ m/2 + M) g r sin θ, so that ω follows from θ; the coupler only translates."""
    sim = Simulation.from_file("three_cranks")
    parts, r = sim.mechanism.parts, 0.2
    cranks = sum(parts[f"crank{number}"].mass for number in (1, 2, 3))
    inertia, weight = (cranks / 3 + parts["coupler"].mass) * r**2, (cranks / 2 + parts["coupler"].mass) * 9.81 * r
    for _ in range(20):
        sim.step(77)
        theta, speed = sim.q[0], sim.u[0]
        square = 100.0 - 2.0 * weight * (np.sin(theta) - np.sin(0.6)) / inertia
        assert abs(speed) == pytest.approx(np.sqrt(square), rel=1e-10)
        assert sim.poses()["coupler"].rotation == pytest.approx(np.eye(3), abs=1e-11)
        # all loads in the plane: Σ over the ground's pins carries the weight and the inertia force
        force = sum(sim.reactions()[name].force for name in ("a1", "a2", "a3"))
        rate = -weight * np.cos(theta) / inertia
        along, across = np.array([np.cos(theta), 0, np.sin(theta)]), np.array([-np.sin(theta), 0, np.cos(theta)])
        moved = (cranks / 2 + parts["coupler"].mass) * r * (rate * across - speed**2 * along)
        mass = cranks + parts["coupler"].mass
        assert force == pytest.approx(moved + np.array([0.0, 0.0, mass * 9.81]), abs=1e-8)
    assert abs(sim.energies.residual) < 1e-12
    assert sim.model.load_sharing.indeterminacy == 7


def test_bennett_keeps_the_product_of_the_half_angles():
    """tan(t1/2) tan(t2/2) = sin((β + α)/2) / sin((β - α)/2) (Bennett 1903)."""
    sim = Simulation.from_file("bennett")
    alpha, beta = np.deg2rad([40.0, 75.0])
    expected = np.sin((beta + alpha) / 2) / np.sin((beta - alpha) / 2)
    turned = []
    for _ in range(40):
        sim.step(49)
        turned.append(sim.q[0])
        assert abs(np.tan(sim.q[0] / 2) * np.tan(sim.q[1] / 2)) == pytest.approx(expected, rel=1e-9)
        assert np.sin(sim.q[2]) == pytest.approx(-np.sin(sim.q[0]), abs=1e-10)
    assert max(turned) - min(turned) > 2.0 * np.pi
    assert abs(sim.energies.residual) < 1e-11
