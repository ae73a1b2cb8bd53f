"""The Rosenbrock-W method: its order for any Jacobian, its stability, and the linear systems of joint forces."""

from __future__ import annotations

import numpy as np
import pytest

from mbd_sim import Simulation, parse_mechanism
from mbd_sim.integrators.implicit import ROSENBROCK_W
from test.integrators.classic_form import classic, require_l_stable

METHOD = ROSENBROCK_W["rosenbrock_w"]

# Two arms with friction and dampers; the second one is light, so that its friction is stiff.
ARMS = """
mechanism: arms
parts:
  upper: {mass: 1, inertia: [0.01, 0.01, 0.01], center: [0.2, 0, 0], points: {tip: [0.4, 0, 0]}}
  lower: {mass: 0.01, inertia: [1e-6, 1e-6, 1e-6], center: [0.01, 0, 0], points: {tip: [0.1, 0, 0]}}
joints:
  shoulder: {type: revolute, between: [ground, upper], axis: [0, 1, 0], damping: 0.2, stiffness: 3}
  elbow:
    {type: revolute, between: [upper.tip, lower], axis: [0, 1, 0], damping: 0.3, friction: {coulomb: 0.5},
     limits: {lower: -0.1, upper: 0.1, stiffness: 1e4}}
"""
LOOP = ARMS + "constraints:\n  gear: {type: coupling, terms: {shoulder: 1, elbow: -2}}\n"


def test_order_three_for_any_jacobian():
    """The conditions of a W-method of order 3 (Hairer & Wanner II, sec. IV.7, table 7.3 and eq. 7.26)."""
    alpha, gamma, b, _ = classic(METHOD)
    one = np.ones(METHOD.stages)
    a, g = alpha @ one, gamma @ one
    found = [b @ one, b @ a, b @ g, b @ a**2, b @ alpha @ a, b @ alpha @ g, b @ gamma @ a, b @ gamma @ g]
    assert found == pytest.approx([1.0, 1 / 2, 0.0, 1 / 3, 1 / 6, 0.0, 0.0, 0.0], abs=1e-13)
    assert a == pytest.approx(METHOD.c, abs=1e-14)


def test_it_is_l_stable_and_stiffly_accurate():
    require_l_stable(METHOD, np.geomspace(1e-3, 1e4, 500))


@pytest.mark.parametrize("text", [ARMS, LOOP], ids=["tree", "loop"])
def test_the_linear_system_is_that_of_the_joint_forces(text):
    """U with (I - g A) U = r, where A holds N, and -M⁻¹ (D, K) with the constraints eliminated."""
    simulation = Simulation(parse_mechanism(text), method="rosenbrock_w")
    equations, nq, nv = simulation.model.equations, 2, 2
    y, g, rng = simulation.state, 1e-3, np.random.default_rng(0)
    if text is ARMS:
        y[:4] = [0.1, 0.12, 0.3, 0.002]
    joints = equations.joint_linearization
    at = [0.0, y, simulation.inputs]
    damping, stiffness = (np.array(value) for value in joints.slopes(*at))
    base = np.array(equations.rates.call(at)[0]).ravel()
    units = [np.array(equations.rates.call([0.0, y, simulation.inputs + unit])[0]).ravel() for unit in np.eye(nv)]
    inverse = np.column_stack([(row - base)[nq : nq + nv] for row in units])
    jacobian = np.zeros((len(y), len(y)))
    jacobian[:nq, nq : nq + nv] = np.eye(nv)
    jacobian[nq : nq + nv, nq : nq + nv] = -inverse * damping.ravel()
    jacobian[nq : nq + nv, :nq] = -inverse @ stiffness
    right = rng.normal(size=len(y))
    begin, solve = joints.partial_system
    solution = np.array(solve(begin(*at, g), right)).ravel()
    exact = np.linalg.solve(np.eye(len(y)) - g * jacobian, right)
    assert damping.min() > 0.0 and damping.max() > 10.0
    assert solution[: nq + nv] == pytest.approx(exact[: nq + nv], rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("text", [ARMS, LOOP], ids=["tree", "loop"])
def test_it_agrees_with_the_exact_jacobian(text):
    mechanism = parse_mechanism(text)
    partial, exact = (Simulation(mechanism, method=name) for name in ("rosenbrock_w", "rosenbrock"))
    for simulation in (partial, exact):
        simulation.run(until=1.0)
    assert partial.q == pytest.approx(exact.q, abs=1e-5)
    assert abs(partial.energies.residual) < 2e-3 * partial.energies.dissipated  # contact is not resolved at this step
