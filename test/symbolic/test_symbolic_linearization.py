"""Linearized equations agree with the numerical linearization, and read as in textbooks."""

# ruff: noqa: E741  # the letters are those of the textbooks

import numpy as np
import pytest
import sympy as sp

from mbd_sim.analysis.linearization import linearize
from mbd_sim.dynamics.equations import derive
from mbd_sim.load import load_mechanism, parse_mechanism
from mbd_sim.symbolic import linearized, symbolic_equations, to_latex

NAMES = ("rod_pendulum", "double_rod", "cart_pendulum_spring", "rotating_frame_mass", "spun_tube_particle",
         "tube_particles", "snap_through", "van_der_pol", "follower_force", "triple_rod_torsion")  # fmt: skip


def linearization_of(name):
    mechanism = load_mechanism(name)
    equations = symbolic_equations(mechanism, None)
    return mechanism, equations, linearized(mechanism, equations)


@pytest.mark.parametrize("name", NAMES)
def test_it_agrees_with_the_numerical_one(name):
    mechanism, equations, found = linearization_of(name)
    numbers = {one.symbol: one.value for one in equations.parameters} | dict(found.values)
    place = np.array([float(sp.sympify(value).subs(numbers)) for value in found.equilibrium])
    nv = len(equations.u)
    mass, damping, stiffness = (
        np.array(matrix.subs(numbers), dtype=float) for matrix in (found.mass, found.damping, found.stiffness)
    )
    a = linearize(derive(mechanism), place, np.zeros(nv), np.zeros(nv)).a
    own = np.block(
        [[np.zeros((nv, nv)), np.eye(nv)], [-np.linalg.solve(mass, stiffness), -np.linalg.solve(mass, damping)]]
    )
    assert np.allclose(own, a, rtol=1e-9, atol=1e-9 * np.max(np.abs(a)))
    if found.polynomial is not None:
        coefficients = sp.Poly(found.polynomial.subs(numbers), found.s).all_coeffs()
        expected = np.poly(a)
        assert np.allclose(np.array(coefficients, dtype=float) / float(coefficients[0]), expected, rtol=1e-8, atol=1e-8)


def test_the_tilted_equilibrium_in_a_spinning_tube():
    _, equations, found = linearization_of("spun_tube_particle")
    m, r, omega, g = (one.symbol for one in equations.parameters)
    assert found.equilibrium == (sp.acos(g / (omega**2 * r)),) and not found.values
    assert sp.simplify(found.stiffness[0] - m * (omega**2 * r**2 - g**2 / omega**2)) == 0


def test_springs_sag_under_the_weight():
    _, equations, found = linearization_of("tube_particles")
    _, l, m, k, g = (one.symbol for one in equations.parameters)
    expected = (0, l + 3 * m * g / (2 * k), 2 * l + 2 * m * g / k, 3 * l + 3 * m * g / (2 * k))
    assert all(sp.simplify(a - b) == 0 for a, b in zip(found.equilibrium, expected, strict=True))


def test_an_equilibrium_without_a_formula_is_a_symbol_with_its_number():
    _, equations, found = linearization_of("snap_through")
    (symbol,) = found.equilibrium
    assert found.values[symbol] == pytest.approx(0.0872376443)
    assert r"where ${q_{\mathrm{guide}}}^{0} = 0.0872376$" in to_latex(equations, found)


def test_the_matrices_are_printed():
    _, equations, found = linearization_of("rotating_frame_mass")
    text = to_latex(equations, found)
    assert r"C &= \begin{pmatrix} c_{1} & -2\, m \omega \\ 2\, m \omega & 0 \end{pmatrix}" in text
    assert r"\det \left(M s^{2} + C s + K\right) &= m^{2}\, s^{4}" in text
    assert r"& \quad {} + c_{1} m\, s^{3}" in text


@pytest.mark.parametrize("name", ["motor_drive", "moving_support_pendulum", "spherical_top", "bounce"])
def test_what_has_no_linearization_has_none(name):
    mechanism = load_mechanism(name)
    assert linearized(mechanism, symbolic_equations(mechanism, ())) is None


CONSTRAINED = ("constrained_pendulum", "bead_on_wire", "atwood", "knife_edge", "four_bar")


@pytest.mark.parametrize("name", CONSTRAINED)
def test_with_constraints_it_agrees_with_the_numerical_one(name):
    mechanism, equations, found = linearization_of(name)
    numbers = {one.symbol: one.value for one in equations.parameters} | dict(found.values)
    place = np.array([float(sp.sympify(value).subs(numbers)) for value in found.equilibrium])
    linear = linearize(derive(mechanism), place, np.zeros(len(place)), np.zeros(len(place)))
    mass, damping, stiffness, gradient = (
        np.array(matrix.subs(numbers), dtype=float)
        for matrix in (found.mass, found.damping, found.stiffness, found.gradient)
    )
    assert np.allclose(gradient @ linear.speeds, 0.0, atol=1e-12)
    along, reduced = linear.speeds, linear.speeds.T @ mass @ linear.speeds
    own = np.hstack(
        [-np.linalg.solve(reduced, along.T @ matrix) for matrix in (stiffness @ linear.displacements, damping @ along)]
    )
    assert np.allclose(own, linear.a[linear.displacements.shape[1] :], rtol=1e-9, atol=1e-9 * np.max(np.abs(linear.a)))
    if found.polynomial is not None:
        coefficients = np.array(sp.Poly(found.polynomial.subs(numbers), found.s).all_coeffs(), dtype=float)
        assert np.allclose(coefficients / coefficients[0], np.poly(linear.a), rtol=1e-8, atol=1e-8)


def test_the_cord_of_a_pendulum_carries_its_weight():
    _, equations, found = linearization_of("constrained_pendulum")
    (m, l, g), s = (one.symbol for one in equations.parameters), found.s
    assert found.loads == (-m * g,) and sp.simplify(found.stiffness - sp.eye(2) * m * g / l) == sp.zeros(2)
    assert sp.simplify(found.polynomial - m * (s**2 + g / l)) == 0
    text = to_latex(equations, found)
    assert r"K\, \delta q = \delta \tau + G^{T}\, \delta \lambda,\quad G\, \delta u = 0" in text
    assert r"\det \begin{pmatrix} M s^{2} + K & -G^{T} \\ G & 0 \end{pmatrix}" in text


SERVO = """
mechanism: servo
parameters: {m: 2, l: 0.5, kp: 60, kd: 3}
parts: {rod: {mass: m, shape: {type: rod, to: [0, 0, -l]}}}
joints: {pin: {type: revolute, between: [ground, rod], axis: [0, -1, 0]}}
actuators:
  motor: {type: effort, joint: pin, effort_limit: 100, rotor_inertia: 0.01, servo: {controls: position, kp: kp, kd: kd}}
"""


def test_a_servo_is_stiffness_and_damping():
    """(m l²/3 + J) s² + kd s + kp + m g l/2; a limit of the effort does not matter within it."""
    equations = symbolic_equations(mechanism := parse_mechanism(SERVO), None)
    found = linearized(mechanism, equations)
    m, l, kp, kd, g = (sp.Symbol(name, positive=True) for name in ("m", "l", "kp", "kd", "g"))
    own = {symbol: sp.Symbol(str(symbol), positive=True) for symbol in found.polynomial.free_symbols - {found.s}}
    expected = (m * l**2 / 3 + sp.Rational(1, 100)) * found.s**2 + kd * found.s + kp + m * g * l / 2
    assert sp.simplify(found.polynomial.subs(own) - expected) == 0
