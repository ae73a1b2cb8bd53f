"""Symbolic equations evaluate to the engine's numbers, and read as the textbook's."""

import re

import numpy as np
import pytest
import sympy as sp
from mechanisms import AUDITED, SHIPPED, accelerations, audited, random_state

from mbd_sim.dynamics.equations import derive
from mbd_sim.errors import MbdSimError
from mbd_sim.mechanism.load import load_mechanism, parse_mechanism
from mbd_sim.symbolic import symbolic_equations
from mbd_sim.symbolic.equations import MOST_SPEEDS


def small(name):
    """Whether there are equations to be written out: of open chains with a few degrees of freedom."""
    mechanism = load_mechanism(name)
    loops = mechanism.closing or mechanism.constraints
    return not loops and 0 < len(mechanism.coordinate_names) <= MOST_SPEEDS


def compare(mechanism, states=4):
    """Hold u' from the symbolic M, h and Q against the compiled recursion's at random states."""
    found, engine = symbolic_equations(mechanism), derive(mechanism)
    arguments = [found.time, *found.q, *found.u, *found.efforts]
    terms = sp.lambdify(arguments, [sp.Matrix(found.mass), sp.Matrix(found.inertial), sp.Matrix(found.forces)], "numpy")
    rng = np.random.default_rng(7)
    for _ in range(states):
        (q, u, efforts), t = random_state(mechanism, rng), rng.uniform(0.0, 3.0)
        mass, inertial, forces = (np.array(term, dtype=float) for term in terms(t, *q, *u, *efforts))
        rates = np.linalg.solve(mass, forces - inertial).ravel()
        expected = accelerations(engine, q, u, efforts, t)
        assert np.max(np.abs(rates - expected)) <= 1e-10 * max(1.0, float(np.max(np.abs(expected))))
    return found


@pytest.mark.parametrize("name", [name for name in SHIPPED if small(name)])
def test_shipped_mechanisms_give_the_engines_accelerations(name):
    compare(load_mechanism(name))


@pytest.mark.parametrize("text", [audited(stops=False), audited(stops=True)])
def test_springs_dampers_stops_and_oblique_axes(text):
    assert AUDITED
    compare(parse_mechanism(text))


def test_drives_with_roots_powers_and_exponentials():
    compare(
        parse_mechanism("""
mechanism: driven
parts: {a: {mass: 1}, b: {mass: 2}, c: {mass: 1, center: [0, 0, -0.3], inertia: [1, 2, 2]}}
joints:
  slow: {type: prismatic, between: [ground, a], axis: [1, 0, 1], drive: sqrt(1 + t^2)/(2 + t)}
  fast: {type: prismatic, between: [a, b], axis: [1, 0, 0], drive: exp(-t)*sin(2*pi*t)}
  pin: {type: revolute, between: [c, b], axis: [0, 1, 0], damping: 2}
""")
    )


def test_the_double_rod_reads_as_in_the_book():
    found = symbolic_equations(load_mechanism("double_rod"))
    (shoulder, elbow), (_, turning), third = found.q, found.u, sp.Rational(1, 3)
    assert found.mass[0][0] == sp.Rational(5, 3) + sp.cos(elbow)
    assert found.mass[0][1] == found.mass[1][0] == third + sp.cos(elbow) / 2
    assert found.mass[1][1] == third
    assert found.forces[1] == found.efforts[1] - sp.Rational(981, 200) * sp.sin(shoulder + elbow)
    assert turning in found.inertial[0].free_symbols and turning not in found.inertial[1].free_symbols


def test_a_ball_joint_has_eulers_equations():
    found = symbolic_equations(load_mechanism("spherical_top"))
    x, y, z = found.u
    a, c = sp.Rational("0.02125"), sp.Rational("0.0025")
    assert found.mass == ((a, 0, 0), (0, a, 0), (0, 0, c))
    assert sp.simplify(sp.Matrix(found.inertial) - sp.Matrix([(c - a) * y * z, (a - c) * x * z, 0])) == sp.zeros(3, 1)


def test_springs_along_a_line_have_no_roots_left():
    found = symbolic_equations(load_mechanism("tube_particles"))
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


@pytest.mark.parametrize(
    ("count", "why"), [(4, "terms|operations|products"), (9, "9 degrees of freedom, and the most are 6")]
)
def test_what_is_too_large_is_refused_with_the_reason(count, why):
    with pytest.raises(MbdSimError, match=rf"chain: the equations of motion are too long to be read: .*({why})"):
        symbolic_equations(parse_mechanism(chain(count)))


def test_what_has_no_freedom_is_refused():
    text = "{mechanism: m, parts: {p: {mass: 1}}, joints: {f: {type: fixed, between: [ground, p]}}}"
    with pytest.raises(MbdSimError, match=re.escape("no degree of freedom")):
        symbolic_equations(parse_mechanism(text))
