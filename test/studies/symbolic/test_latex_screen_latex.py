"""Equations for a screen: the same as in a document, in lines that fit on a page."""

import re

import pytest

from mbd_sim import load_mechanism, symbolic_equations, to_latex
from mbd_sim.studies.symbolic.latex import WIDEST, equations_of, lines, screen_latex, width


def plain(latex):
    """What a formula prints, without its layout."""
    latex = re.sub(r"\\\\\[1\.5ex\]|\\(?:q?quad|begin\{align(?:ed|\*)\}|end\{align(?:ed|\*)\})", "", latex)
    return re.sub(r"\\\\|[\s&$]|\{\}|\\displaystyle", "", latex)


@pytest.mark.parametrize("name", ["double_rod", "four_bar", "slider_crank_friction", "bounce"])
def test_lines_contain_all_equations_and_fit(name):
    equations = symbolic_equations(load_mechanism(name), ())
    document = to_latex(equations).split("In matrix form")[0]
    blocks = re.findall(r"\\begin\{align\*\}(.*?)\\end\{align\*\}", document, re.DOTALL)
    assert plain(screen_latex(equations)) == plain("".join(blocks))
    listed = [line for block in blocks for equation in equations_of(block) for line in lines(equation)]
    assert len(listed) > 3
    wide = [line for line in listed if width(line) > WIDEST and r"\begin{cases}" not in line]
    assert not wide


def test_an_equation_is_broken_at_its_signs_only():
    terms = [rf"{number}\, \left(a + b_{{\mathrm{{one - two}}}}\right)" for number in range(9)]
    broken = list(lines(" + ".join(terms) + " = 0"))
    assert len(broken) > 2
    assert all(line.count(r"\left(") == line.count(r"\right)") for line in broken)
    assert all(line.startswith(r"& \qquad {} +") for line in broken[1:-1])


@pytest.mark.parametrize(("latex", "digits"), [("12345", 5.0), (r"\tfrac{1}{2}\, x", 1.7), (r"q_{\mathrm{pin}}", 3.1)])
def test_the_width_is_that_of_what_is_printed(latex, digits):
    assert width(latex) == pytest.approx(digits)
