"""The equations as LaTeX: every formula parses, numbers read well, and constraints have their place."""

import dataclasses
import re
import subprocess
import sys

import pytest
import sympy as sp
from mechanisms import SHIPPED
from test_equations import small

from mbd_sim.cli import main
from mbd_sim.mechanism.load import load_mechanism
from mbd_sim.symbolic import symbolic_equations, to_latex
from mbd_sim.symbolic.latex import entry_rows, motion_rows
from mbd_sim.symbolic.printer import number


def parse(formula):
    """Let Matplotlib's parser read a formula.

    It has neither small fractions nor cases, and its time doubles with each nested pair of growing brackets.
    """
    from matplotlib.mathtext import MathTextParser

    plain = formula.replace(r"\tfrac", r"\frac").replace(r"\left", "").replace(r"\right", "")
    plain = re.sub(r"\\begin\{cases\}.*?\\end\{cases\}", "1", plain)
    MathTextParser("path").parse(f"${plain}$")


@pytest.mark.parametrize("name", [name for name in SHIPPED if small(name)])
def test_every_formula_parses(name):
    equations = symbolic_equations(load_mechanism(name))
    for terms, right in motion_rows(equations):
        for formula in (*terms, right):
            parse(formula)
    for left, right in entry_rows(equations):
        parse(f"{left} = {right}")
    text = to_latex(equations)
    for formula in re.findall(r"\$([^$]+)\$", text):
        parse(formula)
    assert text.count(r"\begin{align*}") == text.count(r"\end{align*}") == 2
    assert text.count("{") == text.count("}") and text.count(r"\left") == text.count(r"\right")


def test_the_command_prints_equations_and_meanings(capsys):
    assert main(["check", "cart_pendulum_spring", "--latex"]) == 0
    text = capsys.readouterr().out
    assert r"\ddot{q}_{\mathrm{rail}} \cos {q_{\mathrm{pin}}}" in text or r"\cos {q_{\mathrm{pin}}}\, \ddot" in text
    assert r"M_{12} = M_{21} &= \cos {q_{\mathrm{pin}}}" in text
    assert r"Q_{1} &= \tau_{\mathrm{rail}} - 20\, q_{\mathrm{rail}}" in text
    assert r"$q_{\mathrm{pin}}$ is the angle of joint \texttt{pin}, rad" in text


@pytest.mark.parametrize(
    ("fraction", "text"),
    [
        ((1, 3), r"\tfrac{1}{3}"),
        ((-5, 2), r"-\tfrac{5}{2}"),
        ((981, 100), "9.81"),
        ((1, 5), "0.2"),
        ((7, 1), "7"),
        ((123456789, 7), r"1.76367 \cdot 10^{7}"),
        ((1, 3000000), r"3.33333 \cdot 10^{-7}"),
        ((355, 113), "3.14159"),
    ],
)
def test_numbers_are_fractions_where_they_are_simple(fraction, text):
    assert number(*fraction) == text


def test_constraints_add_their_multipliers():
    equations = symbolic_equations(load_mechanism("cart_pendulum_spring"))
    x, angle = equations.q
    multiplier = sp.Symbol("lambda_1", real=True)
    kept = dataclasses.replace(
        equations,
        constraints=(x - sp.sin(angle),),
        multipliers=(multiplier,),
        names=equations.names | {multiplier: r"\lambda_{1}"},
    )
    (_, first), (_, second), (closed, zero) = motion_rows(kept)
    assert r"\lambda_{1}" in first and r"\lambda_{1} \cos" in second
    assert zero == "0" and r"\sin" in closed[0]
    assert r"$\lambda_{1}$ are the multipliers" in to_latex(kept)


def test_sympy_is_loaded_only_to_derive():
    code = "import sys, mbd_sim.symbolic, mbd_sim.cli; print('sympy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "False\n"
