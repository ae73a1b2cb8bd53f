"""Symbolic equations evaluate to the engine's numbers, and read as the textbook's."""

import functools
import re

import numpy as np
import pytest
import sympy as sp

from mbd_sim.base.errors import MbdSimError
from mbd_sim.dynamics.equations import derive
from mbd_sim.files.load import load_mechanism, parse_mechanism
from mbd_sim.studies.algebra import polynomial
from mbd_sim.studies.symbolic import equations, expressions, symbolic_equations
from mbd_sim.studies.symbolic.equations import MAX_SPEEDS
from test.generators.mechanisms import KINDS, accelerations, audited, consistent_state, random_state

# Of all kinds, those with a few speeds, with and without constraints; to read the files while tests are collected takes long.
OPEN = (
    "air_spring", "balancing_pendulum", "stick_slip", "quadratic_drag", "snap_through", "universal_pendulum", "screw_press",
    "cylindrical_slider", "follower_force", "double_rod", "rotating_frame_mass", "spherical_top",
)  # fmt: skip
CLOSED = (
    "upright_wheel", "pencil", "knife_edge", "rack_and_pinion", "insect_on_sphere", "atwood", "slider_crank", "four_bar",
    "scissor_lift",
)  # fmt: skip
LONG = ("six_axis_arm", "stewart", "bennett", "gas_engine", "a04_bricard")  # with few coordinates, but long equations


def small(name):
    """Whether there are equations to be written out: of mechanisms with a few speeds."""
    return name not in LONG and 0 < len(load_mechanism(name).coordinate_names) <= MAX_SPEEDS


def constrained(name):
    """Whether a mechanism has loops or other constraints."""
    mechanism = load_mechanism(name)
    return bool(mechanism.closing or mechanism.constraints)


@functools.cache
def equations_of(name):
    """The symbolic equations of a shipped mechanism."""
    return symbolic_equations(load_mechanism(name))


def compare(mechanism, found, states=4, parameters=()):
    """Compare u' from the symbolic M, h and Q with the compiled recursion at random states.

    :param parameters: the values of the symbols of `found`.
    """
    engine = derive(mechanism)
    arguments = [found.time, *found.q, *found.u, *found.efforts, *(one.symbol for one in found.parameters)]
    terms = sp.lambdify(arguments, [sp.Matrix(found.mass), sp.Matrix(found.inertial), sp.Matrix(found.forces)], "numpy")
    rng = np.random.default_rng(7)
    for _ in range(states):
        (q, u, efforts), t = random_state(mechanism, rng), rng.uniform(0.0, 3.0)
        mass, inertial, forces = (np.array(term, dtype=float) for term in terms(t, *q, *u, *efforts, *parameters))
        rates = np.linalg.solve(mass, forces - inertial).ravel()
        expected = accelerations(engine, q, u, efforts, t)
        assert np.max(np.abs(rates - expected)) <= 1e-10 * max(1.0, float(np.max(np.abs(expected))))


def rate(found, expression):
    """The time derivative of an expression of q, u and t without what u' contributes; quaternions turn by ½ p ∘ ω."""
    total = expression.diff(found.time)
    for coordinate in found.coordinates:
        q, u = list(coordinate.q), list(coordinate.u)
        if len(q) > len(u):
            place = len(u) - 3
            w, x, y, z = q[place:]
            a, b, c = u[place:]
            turning = [-x * a - y * b - z * c, w * a + y * c - z * b, w * b + z * a - x * c, w * c + x * b - y * a]
            u[place:] = [sp.Rational(1, 2) * entry for entry in turning]
        total += sum(expression.diff(symbol) * speed for symbol, speed in zip(q, u, strict=True))
    return total


def compare_constrained(mechanism, found, states=4):
    """Hold u' and λ from the symbolic equations, with G u' differentiated, against the engine's at closed states."""
    engine = derive(mechanism)
    velocities = [sum(g * u for g, u in zip(c.gradient, found.u, strict=True)) + c.drift for c in found.constraints]
    positions = [0 if c.position is None else c.position for c in found.constraints]
    kept = [velocity if c.position is None else rate(found, c.position)
            for velocity, c in zip(velocities, found.constraints, strict=True)]  # fmt: skip
    wanted = [found.mass, found.inertial, found.forces, [c.gradient for c in found.constraints]]
    wanted += [[rate(found, velocity) for velocity in velocities], positions, velocities, kept]
    arguments, modules = [found.time, *found.q, *found.u, *found.efforts], [{"DiracDelta": np.zeros_like}, "numpy"]
    terms = sp.lambdify(arguments, [sp.Matrix(entry) for entry in wanted], modules)
    rng, rows = np.random.default_rng(11), list(engine.start.independent)
    assert [engine.rows[row].owner[1] for row in rows] == [c.owner for c in found.constraints]
    for _ in range(states):
        t = rng.uniform(0.0, 3.0)
        q, u, efforts = consistent_state(engine, rng, t)
        while (
            np.linalg.matrix_rank(engine.constraints.gradient(t, q)) > engine.start.rank
        ):  # assembled so that it is rigid
            q, u, efforts = consistent_state(engine, rng, t)
        values = (np.array(term, dtype=float) for term in terms(t, *q, *u, *efforts))
        mass, inertial, forces, gradient, bias, position, velocity, derivative = values
        assert np.max(np.abs(position)) <= 1e-8 and np.allclose(velocity, derivative, rtol=1e-10, atol=1e-10)
        matrix = np.block([[mass, -gradient.T], [gradient, np.zeros((len(rows), len(rows)))]])
        solved = np.linalg.solve(matrix, np.vstack([forces - inertial, -bias])).ravel()
        y = np.concatenate([q, u, np.zeros(3)])
        multipliers = np.array(engine.multipliers(t, y, efforts)).ravel()
        pairs = [(solved[: len(mass)], accelerations(engine, q, u, efforts, t))]
        pairs.append((gradient.T @ solved[len(mass) :], engine.constraints.gradient(t, q).T @ multipliers))
        if len(engine.start.active) == len(rows):  # otherwise the multipliers are not unique
            pairs.append((solved[len(mass) :], multipliers[rows]))
        for own, expected in pairs:
            assert np.max(np.abs(own - expected)) <= 1e-10 * max(1.0, float(np.max(np.abs(expected))))


def test_every_kind_with_few_speeds_is_compared():
    kinds = [name for name in KINDS if small(name)]
    assert {*CLOSED} == {name for name in kinds if constrained(name)}
    assert {*OPEN} == {*kinds} - {*CLOSED}


@pytest.mark.parametrize("name", OPEN)
def test_shipped_mechanisms_give_the_engines_accelerations(name):
    compare(load_mechanism(name), equations_of(name))


@pytest.mark.parametrize("name", [name for name in CLOSED if name != "slider_crank"])
def test_shipped_closed_mechanisms_give_the_engines_accelerations_and_multipliers(name):
    compare_constrained(load_mechanism(name), equations_of(name))


def test_the_four_bar_has_the_familiar_closing_equations():
    found = equations_of("four_bar")
    crank, coupler, rocker = found.q
    along, up = (constraint.position for constraint in found.constraints)
    assert sp.expand(-10 * along) == 5 * sp.cos(crank) + 14 * sp.cos(crank + coupler) - 12 * sp.cos(rocker) - 15
    assert sp.expand(-10 * up) == 5 * sp.sin(crank) + 14 * sp.sin(crank + coupler) - 12 * sp.sin(rocker)
    assert [str(symbol) for symbol in found.multipliers] == ["lambda_rocker_pin,1", "lambda_rocker_pin,2"]
    assert "rocker_pin: displacement along y" in found.left_out


def test_a_blade_has_a_velocity_that_stays_zero_and_no_position():
    found = equations_of("knife_edge")
    (edge,), angle = found.constraints, found.q[2]
    assert edge.position is None and edge.drift == 0
    assert edge.gradient == (-sp.sin(angle), sp.cos(angle), 0)
    assert [str(symbol) for symbol in found.multipliers] == ["lambda_edge"]


def test_springs_dampers_stops_and_oblique_axes():
    mechanism = parse_mechanism(audited(stops=True))
    compare(mechanism, symbolic_equations(mechanism))


def test_drives_with_roots_powers_and_exponentials():
    mechanism = parse_mechanism("""
mechanism: driven
parts: {a: {mass: 1}, b: {mass: 2}, c: {mass: 1, center: [0, 0, -0.3], inertia: [1, 2, 2]}}
joints:
  slow: {type: prismatic, between: [ground, a], axis: [1, 0, 1], drive: sqrt(1 + t^2)/(2 + t)}
  fast: {type: prismatic, between: [a, b], axis: [1, 0, 0], drive: exp(-t)*sin(2*pi*t)}
  pin: {type: revolute, between: [c, b], axis: [0, 1, 0], damping: 2}
""")
    compare(mechanism, symbolic_equations(mechanism))


def test_the_double_rod_reads_as_in_the_book():
    found = equations_of("double_rod")
    (shoulder, elbow), (_, turning), third = found.q, found.u, sp.Rational(1, 3)
    assert found.mass[0][0] == sp.Rational(5, 3) + sp.cos(elbow)
    assert found.mass[0][1] == found.mass[1][0] == third + sp.cos(elbow) / 2
    assert found.mass[1][1] == third
    assert found.forces[1] == found.efforts[1] - sp.Rational(981, 200) * sp.sin(shoulder + elbow)
    assert turning in found.inertial[0].free_symbols and turning not in found.inertial[1].free_symbols


def test_a_ball_joint_has_eulers_equations():
    found = equations_of("spherical_top")
    x, y, z = found.u
    a, c = sp.Rational("0.02125"), sp.Rational("0.0025")
    assert found.mass == ((a, 0, 0), (0, a, 0), (0, 0, c))
    assert sp.simplify(sp.Matrix(found.inertial) - sp.Matrix([(c - a) * y * z, (a - c) * x * z, 0])) == sp.zeros(3, 1)


def test_springs_along_a_line_have_no_roots_left():
    found = equations_of("tube_particles")
    assert not any(force.atoms(sp.Abs) or "sqrt" in str(force) for force in found.forces)


def chain(count):
    """Rods about axes in turn."""
    axes = "[0, 1, 0]", "[1, 0, 0]", "[0, 0.6, 0.8]"
    parts = [
        f"  p{i}: {{mass: 1, inertia: [0.1, 0.2, 0.15], center: [0.1, 0.2, -0.5], points: {{tip: [0, 0, -1]}}}}"
        for i in range(count)
    ]
    joints = [
        f"  j{i}: {{type: revolute, between: [{'ground' if i == 0 else f'p{i - 1}.tip'}, p{i}], axis: {axes[i % 3]}}}"
        for i in range(count)
    ]
    return "\n".join(["mechanism: chain", "parts:", *parts, "joints:", *joints])


TOO_LONG = "the equations of motion are too long to read: .*"


@pytest.mark.parametrize(
    ("module", "limit", "most", "why"),
    [
        (equations, "MAX_INSTRUCTIONS", 9, r"their derivation takes \d+ operations"),
        (polynomial, "MAX_PRODUCTS", 9, "their derivation takes more than 9 products"),
        (expressions, "MAX_TERMS", 1, r"one of their entries has \d+ terms"),
        (expressions, "MAX_OPERATIONS", 2, r"one of their entries has \d+ operations"),
        (expressions, "MAX_TOTAL_OPERATIONS", 20, "their entries have more than 20 operations"),
    ],
)
def test_what_is_too_long_is_refused_with_the_reason(monkeypatch, own_builds, module, limit, most, why):
    monkeypatch.setattr(module, limit, most)
    with pytest.raises(MbdSimError, match=f"double_rod: {TOO_LONG}{why}"):
        symbolic_equations(load_mechanism("double_rod"))


def test_what_has_too_many_speeds_is_refused():
    with pytest.raises(MbdSimError, match=f"chain: {TOO_LONG}9 generalized speeds, more than 6"):
        symbolic_equations(parse_mechanism(chain(9)))


def test_what_has_no_freedom_is_refused():
    text = "{mechanism: m, parts: {p: {mass: 1}}, joints: {f: {type: fixed, between: [ground, p]}}}"
    with pytest.raises(MbdSimError, match=re.escape("no degree of freedom")):
        symbolic_equations(parse_mechanism(text))
