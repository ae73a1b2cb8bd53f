"""Equations with parameters: they hold for other values too, and read as in textbooks."""

import shutil
import subprocess

import numpy as np
import pytest
import sympy as sp

from mbd_sim.cli.main import main
from mbd_sim.dynamics.equations import derive
from mbd_sim.files.checks.override import with_values
from mbd_sim.files.load import load_mechanism, parse_mechanism
from mbd_sim.studies.algebra.names import key_name, symbol_latex
from mbd_sim.studies.symbolic import linearized, symbolic_equations, to_latex
from test.generators.mechanisms import random_state
from test.studies.symbolic.test_equations import compare

OPEN = (
    "cart_massive_spring",
    "snap_through",
    "moving_support_pendulum",
    "spherical_top",
    "follower_force",
    "stick_slip",
)
CLOSED = ("atwood", "bead_on_wire")


def changed(mechanism, found, spread=0.2):
    """The mechanism with other values of its symbols, and these values; the gravity stays."""
    random = np.random.default_rng(5)
    values = {one.key: one.value * random.uniform(1 - spread, 1 + spread) for one in found.parameters if one.key}
    return with_values(mechanism, values), [values.get(one.key, one.value) for one in found.parameters]


@pytest.mark.parametrize("name", OPEN)
def test_the_equations_hold_for_other_values(name):
    mechanism = load_mechanism(name)
    found = symbolic_equations(mechanism, None)
    assert found.parameters and not found.built_in
    other, values = changed(mechanism, found)
    compare(other, found, parameters=values)


@pytest.mark.parametrize("name", CLOSED)
def test_the_constraints_hold_for_other_values(name):
    mechanism = load_mechanism(name)
    found = symbolic_equations(mechanism, None)
    other, values = changed(mechanism, found, spread=0.03)
    engine, rng = derive(mechanism), np.random.default_rng(3)
    rows = [[c.position or 0, c.drift, *c.gradient] for c in found.constraints]
    symbols = [found.time, *found.q, *found.u, *(one.symbol for one in found.parameters)]
    function = sp.lambdify(symbols, sp.Matrix(rows), "numpy")
    kept = list(engine.start.independent)
    assert [engine.rows[row].owner[1] for row in kept] == [c.owner for c in found.constraints]
    engine = derive(other)
    for t in (0.0, 0.7):
        (q, u, _) = random_state(other, rng)
        numbers = np.array(function(t, *q, *u, *values), dtype=float)
        assert np.allclose(numbers[:, 2:], engine.constraints.gradient(t, q)[kept], rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize(
    ("name", "latex"),
    [
        ("m", "m"),
        ("l1", "l_{1}"),
        ("theta_1", r"\theta_{1}"),
        ("mu", r"\mu"),
        ("omega0", r"\omega_{0}"),
        ("Omega", r"\Omega"),
        ("mc", r"m_{\mathrm{c}}"),
        ("m_rod", r"m_{\mathrm{rod}}"),
        ("r_a", r"r_{\mathrm{a}}"),
        ("k_theta", r"k_{\theta}"),
        ("load", r"\operatorname{load}"),
        ("yaw_rate", r"\operatorname{yaw}_{\mathrm{rate}}"),
    ],
)
def test_names_of_parameters(name, latex):
    assert symbol_latex(name) == latex


def test_names_of_values_at_keys():
    assert key_name("parts.rod_1.mass") == ("m_rod_1", r"m_{\mathrm{rod\_1}}")
    assert key_name("parts.bob.shapes[0].mass") == ("m_bob_0", r"m_{\mathrm{bob},\mathrm{0}}")
    assert key_name("joints.pin.rest") == ("pin_rest", r"\operatorname{pin\_rest}")


GREEK = """
mechanism: greek
parameters: {m: 2 kg, l: 0.5 m, kappa: 3 N*m/rad}
parts: {rod: {mass: m, shape: {type: rod, to: [0, 0, -l]}}}
joints: {theta_1: {type: revolute, between: [ground, rod], axis: [0, -1, 0], stiffness: kappa}}
"""


def test_joints_with_greek_names_have_greek_coordinates():
    text = to_latex(symbolic_equations(parse_mechanism(GREEK), None))
    assert r"\tfrac{1}{3}\, l^{2} m\, \ddot{\theta}_{1} &= \tau_{\mathrm{theta\_1}}" in text
    assert r"- \kappa \theta_{1}" in text and r" - \tfrac{1}{2}\, g l m \sin {\theta_{1}}" in text
    assert r"T &= \tfrac{1}{6}\, l^{2} m \dot{\theta}_{1}^{2}" in text
    assert r"$\kappa$ is the parameter \texttt{kappa}: 3 N*m/rad" in text


def test_further_values_and_the_gravity_are_symbols_on_request():
    mechanism = load_mechanism("balancing_pendulum")
    found = symbolic_equations(mechanism, ["parts.cart.mass", "joints.rail.damping"])
    names = {str(one.symbol): one.symbol for one in found.parameters}
    assert list(names) == ["m_cart", "c_rail", "g"]
    assert sp.expand(found.mass[0][0] - names["m_cart"]) == sp.Rational("0.3")
    assert found.energies.dissipation.coeff(found.u[0] ** 2) == names["c_rail"] / 2
    other, values = changed(mechanism, found)
    compare(other, found, parameters=values)


def test_a_parameter_in_the_direction_of_an_axis_stays_a_number():
    text = """
mechanism: tilted
parameters: {alpha: 0.3, m: 2}
parts: {p: {mass: m}}
joints: {rail: {type: prismatic, between: [ground, p], axis: [cos(alpha), 0, sin(alpha)]}}
"""
    found = symbolic_equations(parse_mechanism(text), None)
    assert list(found.built_in) == ["alpha"] and "axis" in found.built_in["alpha"]
    assert r"built into the equations: \texttt{alpha}" in to_latex(found)


def test_the_energies_give_the_equations():
    """Lagrange's equations from the printed T, V and D, term by term."""
    for name in ("cart_pendulum_spring", "rotating_frame_mass"):
        found = symbolic_equations(load_mechanism(name), None)
        energies = found.energies
        for row, (q, u) in enumerate(zip(found.q, found.u, strict=True)):
            momentum = energies.lagrangian.diff(u)
            rate = sum(momentum.diff(a) * b for a, b in zip(found.u + found.q, found.u_rates + found.u, strict=True))
            lagrange = rate - energies.lagrangian.diff(q) + energies.dissipation.diff(u) - found.efforts[row]
            own = sum(m * a for m, a in zip(found.mass[row], found.u_rates, strict=True))
            assert sp.simplify(lagrange - (own + found.inertial[row] - found.forces[row])) == 0


def test_the_command_prints_parameters_or_numbers(capsys):
    own = ["--latex", "--no-linearization"]
    assert main(["check", "double_rod", *own]) == 0
    assert r"M_{22} &= \tfrac{1}{3}\, l^{2} m" in capsys.readouterr().out
    assert main(["check", "double_rod", *own, "--numbers"]) == 0
    assert r"M_{22} &= \tfrac{1}{3} \\" in capsys.readouterr().out
    assert main(["check", "double_rod", *own, "--symbols", "joints.*.damping"]) == 0
    assert r"c_{\mathrm{elbow}}" in capsys.readouterr().out
    assert main(["check", "double_rod", "--latex", "--symbols", "m", "--symbols", "joints.*.dampng"]) == 1
    assert "--symbols joints.*.dampng: no number" in capsys.readouterr().err
    assert main(["check", "double_rod", "--symbols", "joints.*.damping"]) == 1
    assert "with --latex" in capsys.readouterr().err


@pytest.mark.skipif(
    shutil.which("pdflatex") is None, reason="pdflatex is not installed: apt install texlive-latex-base"
)
def test_latex_compiles_it(tmp_path):
    names = (*OPEN[:4], "rolling_disc", "bounce", "belt")
    bodies = []
    for mechanism in map(load_mechanism, names):
        equations = symbolic_equations(mechanism, None)
        bodies.append(to_latex(equations, linearized(mechanism, equations)))
    bodies.append(to_latex(symbolic_equations(parse_mechanism(GREEK), None)))
    text = "\n\n".join(
        [r"\documentclass{article}\usepackage{amsmath,amssymb}\begin{document}", *bodies, r"\end{document}"]
    )
    (tmp_path / "all.tex").write_text(text, encoding="utf-8")
    command = ["pdflatex", "-halt-on-error", "-interaction=nonstopmode", "all.tex"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, errors="replace", check=False)
    assert done.returncode == 0, done.stdout[-1500:]
    assert "Missing character" not in (tmp_path / "all.log").read_text(encoding="utf-8", errors="replace")
