"""Linearized equations agree with the numerical linearization, and read as in textbooks."""

# ruff: noqa: E741  # the letters are those of the textbooks

import functools

import numpy as np
import pytest
import sympy as sp

from mbd_sim.analysis.linear.linearization import linearize
from mbd_sim.dynamics.equations import derive
from mbd_sim.files.checks.override import with_values
from mbd_sim.files.load import load_mechanism, parse_mechanism
from mbd_sim.studies.symbolic import linearization, linearized, symbolic_equations, to_latex

NAMES = ("cart_pendulum_spring", "rotating_frame_mass", "tube_particles", "snap_through")


@functools.cache
def linearization_of(name):
    mechanism = load_mechanism(name)
    equations = symbolic_equations(mechanism, None)
    return mechanism, equations, linearized(mechanism, equations)


def compare(mechanism, equations, found):
    """Compare with the numerical linearization about the same equilibrium."""
    numbers = {one.symbol: one.value for one in equations.parameters} | dict(found.values)

    def in_numbers(matrix):
        matrix = sp.Matrix(matrix)
        function = sp.lambdify(list(numbers), matrix, "numpy", cse=True)
        return np.array(function(*map(float, numbers.values())), dtype=float).reshape(matrix.shape)

    place, states = in_numbers(found.equilibrium).ravel(), in_numbers(list(found.state_values)).ravel()
    nv, derived = len(equations.u), derive(mechanism)
    linear = linearize(derived, place, np.zeros(nv), np.zeros(nv), states=states)
    names = [f"{one.name}.{state.name}" for one in equations.actuators for state in one.states]
    assert list(linear.states) == names
    mass, by_q, by_u, by_s = map(in_numbers, (found.mass, found.stiffness, found.damping, found.coupling))
    rates, commands = [in_numbers(rate) for rate in found.state_rates], in_numbers(found.commanded)
    above = np.hstack([np.zeros((nv, nv)), np.eye(nv), np.zeros((nv, len(names)))])
    own = np.vstack([above, -np.linalg.solve(mass, np.hstack([by_q, by_u, by_s])), np.hstack(rates)])
    a, size = linear.a, np.max(np.abs(linear.a))
    assert np.allclose(own, a, rtol=1e-10, atol=1e-10 * size)
    b = np.vstack(
        [np.zeros((nv, commands.shape[1])), np.linalg.solve(mass, commands), in_numbers(found.commanded_rates)]
    )
    assert np.allclose(b, linear.by_commands, rtol=1e-10, atol=1e-10 * np.max(np.abs(b), initial=1.0))
    if found.polynomial is not None:
        coefficients = sp.Poly(found.polynomial.subs(numbers), found.s).all_coeffs()
        expected = np.poly(a)
        assert np.allclose(np.array(coefficients, dtype=float) / float(coefficients[0]), expected, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("name", NAMES)
def test_it_agrees_with_the_numerical_one(name):
    compare(*linearization_of(name))


def test_numbers_take_the_place_of_an_equilibrium_without_formulas_in_long_entries(monkeypatch):
    mechanism, equations, formulas = linearization_of("snap_through")
    monkeypatch.setattr(linearization, "MAX_OPERATIONS", 10)
    found = linearized(mechanism, equations)
    assert formulas.values and not found.values
    assert not {*formulas.values} & set.union(*(matrix.free_symbols for matrix in (found.stiffness, found.mass)))
    compare(mechanism, equations, found)


def test_the_tilted_equilibrium_in_a_spinning_tube():
    start = with_values(load_mechanism("spun_tube_particle"), {"joints.slide.position": 0.9})
    equations = symbolic_equations(start, None)
    found = linearized(start, equations)
    compare(start, equations, found)
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


@pytest.mark.parametrize("name", ["motor_drive", "moving_support_pendulum", "bounce"])
def test_what_has_no_linearization_has_none(name):
    mechanism = load_mechanism(name)
    assert linearized(mechanism, symbolic_equations(mechanism, ())) is None


CONSTRAINED = ("constrained_pendulum", "bead_on_wire", "knife_edge")


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


def text_linearization(text):
    mechanism = parse_mechanism(text)
    equations = symbolic_equations(mechanism, None)
    found = linearized(mechanism, equations)
    compare(mechanism, equations, found)
    own = {str(one): one for one in found.polynomial.free_symbols} if found.polynomial is not None else {}
    return equations, found, own


MOTOR = """
mechanism: motor
parameters: {m: 2, l: 0.5, R: 0.8, k: 0.05, L: 1 mH, n: 20}
parts: {rod: {mass: m, shape: {type: rod, to: [0, 0, -l]}}}
joints: {theta: {type: revolute, between: [ground, rod], axis: [0, -1, 0]}}
actuators:
  drive: {type: dc_motor, joint: theta, torque_constant: k, resistance: R, inductance: L, gear_ratio: n, control: voltage}
"""


def test_the_current_of_a_motor_is_a_state():
    """(m l²/3 s² + m g l/2) (L s + R) + n² k² s, divided by L."""
    equations, found, own = text_linearization(MOTOR)
    m, l, resistance, k, inductance, n, g, s = (own[name] for name in "mlRkLngs")
    expected = (m * l**2 / 3 * s**2 + m * g * l / 2) * (inductance * s + resistance) + n**2 * k**2 * s
    assert sp.simplify(found.polynomial * inductance - expected) == 0
    text = to_latex(equations, found)
    assert r"E &= \begin{pmatrix} - k n \end{pmatrix}" in text and r"$x = (i_{\mathrm{drive}})$" in text
    assert r"\det \begin{pmatrix} M s^{2} + K & E \\ - B s & s I - S \end{pmatrix}" in text


def test_the_integral_of_a_servo_carries_the_weight():
    text = (
        SERVO.replace("kd: 3}", "kd: 3, ki: 40}")
        .replace("kd: kd}", "kd: kd, ki: ki}")
        .replace("[0, -1, 0]}", "[0, -1, 0], position: 0.4}")
    )
    equations, found, _ = text_linearization(text)
    (w,) = found.values
    m, l, _, _, _, g = (one.symbol for one in equations.parameters)
    assert found.equilibrium == (w,) and found.values[w] == 0.4
    assert sp.simplify(found.state_values[0] - m * g * l / 2 * sp.sin(w)) == 0


BALL = """
mechanism: ball
parameters: {m: 2, l: 0.5}
parts: {bob: {mass: m, center: [0, 0, -l], inertia: [0.02, 0.03, 0.04]}}
joints: {socket: {type: spherical, between: [ground, bob]}}
"""
HUNG = """
mechanism: hung
parameters: {m: 2, k: 300}
ground: {points: {hook: [0, 0, 1]}}
parts: {body: {mass: m, inertia: [0.02, 0.03, 0.04]}}
joints: {base: {type: free, between: [ground, body], position: [0, 0, 0.4]}}
forces: {cord: {type: spring, between: [ground.hook, body], stiffness: k, length: 0.3, damping: 2}}
"""
TILTED = """
mechanism: tilted
parts: {bob: {mass: 2, center: [0, 0, -0.3], inertia: [0.02, 0.03, 0.04], points: {eye: [0.3, 0, 0]}}}
ground: {points: {hook: [0.5, 0, 0.2]}}
joints: {socket: {type: spherical, between: [ground, bob], orientation: {axis: [0, 1, 0], angle: 0.3}}}
forces: {pull: {type: spring, between: [ground.hook, bob.eye], stiffness: 60, length: 0}}
"""


def test_a_ball_joint_has_small_rotations():
    """(J + m l²) s² + m g l about x and about y, and J s² about z."""
    equations, found, own = text_linearization(BALL)
    m, l, g = (own[name] for name in "mlg")
    assert found.equilibrium == (1, 0, 0, 0)
    assert found.stiffness == sp.diag(m * g * l, m * g * l, 0)
    assert sp.simplify(found.mass - sp.diag(m * l**2 + 0.02, m * l**2 + 0.03, sp.Rational(1, 25))).evalf() == sp.zeros(
        3
    )
    assert r"in the place of $\omega$ of \texttt{socket}, the small rotation" in to_latex(equations, found)


def test_a_free_body_on_a_spring():
    equations, found, _ = text_linearization(HUNG)
    m, k, g = (one.symbol for one in equations.parameters)
    assert sp.simplify(found.equilibrium[2] - sp.Rational(7, 10) + m * g / k) == 0
    assert sp.simplify(found.damping[2, 2] - 2) == 0


def test_a_ball_joint_at_an_equilibrium_without_a_formula():
    _, found, _ = text_linearization(TILTED)
    assert len(found.values) == 4 and found.stiffness.shape == (3, 3)
