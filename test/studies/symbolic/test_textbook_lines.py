"""The equations of systems of textbooks, term by term, with their parameters as symbols."""

# ruff: noqa: E741  # the letters are those of the textbooks

import functools
import re
from pathlib import Path

import numpy as np
import pytest
import sympy as sp

from mbd_sim.dynamics.equations import derive
from mbd_sim.files.checks.override import with_values
from mbd_sim.files.load import load_mechanism, parse_mechanism
from mbd_sim.studies.symbolic import sympy
from mbd_sim.studies.symbolic.latex import constraint_rows, motion_rows
from test.generators.mechanisms import accelerations

HALF, THIRD = sp.Rational(1, 2), sp.Rational(1, 3)
cos, sin = sp.cos, sp.sin


@functools.cache
def model_of(name, keys=()):
    """The model of a shipped mechanism with all of its parameters, and further values, as symbols."""
    mechanism = load_mechanism(name)
    return sympy(mechanism, [*mechanism.parameters, *keys] if keys else None)


def symbols(model, names):
    """Parameters by name."""
    known = {str(symbol): symbol for symbol in model.parameters}
    return [known[name] for name in names.split()]


def compare(ours, textbook):
    """Require that the difference of two matrices or numbers simplifies to zero."""
    difference = sp.Matrix([ours]) - sp.Matrix([textbook])
    assert difference.applyfunc(sp.simplify) == sp.zeros(*difference.shape)


def column(*entries):
    return sp.Matrix(entries)


RODS = """
mechanism: rods
parameters: {m1: 1.5, m2: 0.8, l1: 0.7, l2: 1.1}
parts:
  upper: {mass: m1, shape: {type: rod, to: [0, 0, -l1]}, points: {tip: [0, 0, -l1]}}
  lower: {mass: m2, shape: {type: rod, to: [0, 0, -l2]}}
joints:
  shoulder: {type: revolute, between: [ground, upper], axis: [0, -1, 0]}
  elbow: {type: revolute, between: [upper.tip, lower], axis: [0, -1, 0]}
"""


def test_double_rod():
    """Huston & Liu 11.12.3 in absolute angles θ1 = β1, θ2 = β1 + β2: M_β = Jᵀ M_θ J, with J constant."""
    model = sympy(parse_mechanism(RODS))
    m1, m2, l1, l2, g = symbols(model, "m1 m2 l1 l2 g")
    jacobian = sp.Matrix([[1, 0], [1, 1]])
    theta, rate = jacobian * model.q, jacobian * model.u
    difference = theta[0] - theta[1]
    coupling = HALF * m2 * l1 * l2
    mass = sp.Matrix([
        [m1 * l1**2 / 3 + m2 * l1**2, coupling * cos(difference)],
        [coupling * cos(difference), m2 * l2**2 / 3],
    ])  # fmt: skip
    inertial = coupling * sin(difference) * column(rate[1] ** 2, -(rate[0] ** 2))
    gravity = column(-(m1 / 2 + m2) * g * l1 * sin(theta[0]), -HALF * m2 * g * l2 * sin(theta[1]))
    compare(model.M, jacobian.T * mass * jacobian)
    compare(model.h, jacobian.T * inertial)
    compare(model.Q - model.efforts, jacobian.T * gravity)


def test_cart_with_pendulum_and_spring():
    """Lidström, example 4:14, and with a spring that has mass."""
    for name in ("cart_pendulum_spring", "cart_massive_spring"):
        model = model_of(name)
        mc, m, l, k, g = symbols(model, "mc m l k g")
        spring = symbols(model, "ms")[0] / 3 if name == "cart_massive_spring" else 0
        (x, theta), (_, turning), (a, angular) = model.q, model.u, model.u_rates
        first = (mc + m + spring) * a + m * l * cos(theta) * angular - m * l * sin(theta) * turning**2 + k * x
        second = m * l * cos(theta) * a + m * l**2 * angular + m * g * l * sin(theta)
        on_the_right = {sp.sign(x + sp.Rational(3, 2)): 1, sp.Abs(x + sp.Rational(3, 2)): x + sp.Rational(3, 2)}
        compare((model.residual + model.efforts).subs(on_the_right), column(first, second))


def test_pendulum_on_a_moving_support():
    """T0 = m v²/2, T1 = m l v cos φ φ'/2, T2 = m l²/3 φ'²/2 (Lidström p. 48-53)."""
    model = model_of("moving_support_pendulum")
    (m, l, amplitude, frequency), (phi,), (rate,) = symbols(model, "m l amplitude frequency"), model.q, model.u
    v = amplitude * frequency * cos(frequency * model.t)
    compare(model.T, m * v**2 / 2 + HALF * m * l * v * cos(phi) * rate + m * l**2 / 3 * rate**2 / 2)
    (g,), support = symbols(model, "g"), HALF * m * l * v.diff(model.t) * cos(phi)
    own = m * l**2 / 3 * model.u_rates[0] + support + HALF * m * g * l * sin(phi)
    compare(model.residual + model.efforts, column(own))


def test_mass_in_a_rotating_frame():
    """Gyroscopic terms and centrifugal softening (Géradin & Rixen p. 31-33)."""
    model = model_of("rotating_frame_mass")
    m, omega, k1, k2, c1 = symbols(model, "m omega k1 k2 c1")
    (x, y), (dx, dy), (ax, ay) = model.q, model.u, model.u_rates
    first = m * ax - 2 * m * omega * dy + c1 * dx + (k1 - m * omega**2) * x
    second = m * ay + 2 * m * omega * dx + (k2 - m * omega**2) * y
    compare(model.residual + model.efforts, column(first, second))
    compare(model.D, c1 * dx**2 / 2)


def test_pendulum_with_a_constraint():
    """(l + u1)² + u2² = l² (Géradin & Rixen p. 34-40); the row is this over 2 l."""
    model = model_of("constrained_pendulum")
    (m, l, g), (u1, u2) = symbols(model, "m l g"), model.q
    compare(model.M, m * sp.eye(2))
    compare(model.Q - model.efforts, column(m * g, 0))
    compare(2 * l * model.Phi, column((l + u1) ** 2 + u2**2 - l**2))
    compare(model.G, model.Phi.jacobian(model.q))


def test_spherical_pendulum_in_angles():
    """θ'' = sin θ cos θ φ'² - (g/l) sin θ, from the equations with a constraint, whose multiplier drops out."""
    model = model_of("spherical_pendulum")
    m, l, g = symbols(model, "m l g")
    theta, phi = sp.Function("theta")(model.t), sp.Function("phi")(model.t)
    place = l * column(sin(theta) * cos(phi), sin(theta) * sin(phi), -cos(theta))
    motion = dict(zip(model.q, place, strict=True)) | dict(zip(model.u, place.diff(model.t), strict=False))
    motion |= dict(zip(model.u_rates, place.diff(model.t, 2), strict=True))
    compare(model.Phi.subs(motion), column(0))
    along = place.diff(theta)
    projected = (along.T * (model.residual + model.efforts).subs(motion))[0] / (m * l**2)
    compare(projected, theta.diff(model.t, 2) - sin(theta) * cos(theta) * phi.diff(model.t) ** 2 + g / l * sin(theta))


def test_knife_edge():
    """-x' sin φ + y' cos φ = 0 (Huston & Liu P11.2.3)."""
    model = model_of("knife_edge")
    phi = model.q[2]
    compare(model.G * model.u, column(-model.u[0] * sin(phi) + model.u[1] * cos(phi)))
    assert model.Phi[0] is sp.nan


def test_elastic_bars():
    """V = k (z² - h²)² / 4 l0² and the weight (Lidström p. 103-105)."""
    model = model_of("snap_through")
    (m, k, b, h, g), (z,) = symbols(model, "m k b h g"), model.q
    compare(model.V, k * (z**2 - h**2) ** 2 / (4 * (b**2 + h**2)) + m * g * z)


def test_tumbling_body_has_eulers_equations():
    """I1 ω1' = (I2 - I3) ω2 ω3 and cyclic (Huston & Liu 8.7)."""
    model = sympy(with_values(load_mechanism("tumbling"), {}), ())
    inertia = [1, 2, 3]
    turning, rates = model.u[3:, 0], model.u_rates[3:, 0]
    moments = (model.residual + model.efforts)[3:, 0]
    euler = [
        inertia[i] * rates[i] - (inertia[j] - inertia[k]) * turning[j] * turning[k]
        for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1))
    ]
    compare(moments, column(*euler))


@pytest.mark.parametrize("name", ["double_rod", "constrained_pendulum"])
def test_the_record_holds_together(name):
    model = model_of(name)
    assert model.L == model.T - model.V
    assert model.M.shape == (len(model.u), len(model.u)) and model.M == model.M.T
    assert model.G.shape == (len(model.multipliers), len(model.u)) and model.b.shape == model.multipliers.shape
    compare(model.M, sp.hessian(model.T, list(model.u)))
    compare(model.G + sp.zeros(*model.G.shape), model.Phi.jacobian(model.q) if model.Phi else model.G)


@pytest.mark.parametrize("name", ["cart_pendulum_spring", "rotating_frame_mass"])
def test_the_numbers_are_those_of_the_compiled_equations(name):
    model, engine = model_of(name), derive(load_mechanism(name))
    arguments = [model.t, list(model.q), list(model.u), list(model.efforts)]
    terms = sp.lambdify(arguments, [matrix.subs(model.parameters) for matrix in (model.M, model.Q - model.h)], "numpy")
    random = np.random.default_rng(4)
    for t in (0.0, 0.3, 1.7):
        q, u, efforts = random.normal(size=(3, len(model.u)))
        mass, forces = terms(t, q, u, efforts)
        expected = accelerations(engine, q, u, efforts, t)
        assert np.allclose(np.linalg.solve(mass, forces).ravel(), expected, rtol=1e-12, atol=1e-12)


def test_the_table_of_the_page_is_what_is_printed():
    text = (Path(__file__).parents[3] / "docs" / "symbolic.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (?:`(\w+)`[^|]*)? *\| \$[^$|]+\$ \| \$([^$]+)\$ \|$", text, re.MULTILINE)
    shown, last = {}, ""
    for name, line in rows:
        last = name or last
        shown.setdefault(last, []).append(line)
    assert len(shown) >= 10
    for name, lines in shown.items():
        equations = model_of(name).equations
        printed = [" = ".join(map(line_of, row)) for row in motion_rows(equations) + constraint_rows(equations)]
        assert lines == (printed if name != "knife_edge" else printed[3:])


def line_of(terms):
    return " ".join(term if not number or term[0] == "-" else f"+ {term}" for number, term in enumerate(terms))


def test_the_snippets_of_the_page_run(capsys):
    text = (Path(__file__).parents[3] / "docs" / "symbolic.md").read_text(encoding="utf-8")
    for snippet in re.findall(r"^```python\n(.*?)^```$", text, re.MULTILINE | re.DOTALL):
        exec(compile(snippet, "docs/symbolic.md", "exec"), {})
        assert len(capsys.readouterr().out.splitlines()) >= 2


@pytest.mark.parametrize("exponent", [2, 3])
def test_drag_of_a_power_of_the_speed_is_written_without_its_guard_at_rest(exponent):
    """Géradin & Rixen p. 30: F = -C |v|^(p-1) v and D = C |v|^(p+1)/(p+1), in the plane and about a joint."""
    model = sympy(with_values(load_mechanism("quadratic_drag"), {"forces.drag.exponent": exponent}))
    (c,), (x, y, _) = symbols(model, "C"), model.u
    speed = sp.sqrt(x**2 + y**2)
    assert sp.simplify(model.D - c * speed ** (exponent + 1) / (exponent + 1)) == 0
    assert sp.simplify(model.Q - model.efforts + c * speed ** (exponent - 1) * column(x, y, 0)) == sp.zeros(3, 1)
    turning = load_mechanism("rod_pendulum")
    damper = f"    damper: {{coefficient: 0.3, exponent: {exponent}}}\n"
    model = sympy(parse_mechanism(turning.source.text.replace("    type: revolute\n", "    type: revolute\n" + damper)))
    (rate,) = model.u
    drag = sp.simplify(model.Q[0] - model.efforts[0] - sympy(turning).Q[0] + sympy(turning).efforts[0])
    assert sp.simplify(drag + sp.Rational(3, 10) * sp.Abs(rate) ** (exponent - 1) * rate) == 0
