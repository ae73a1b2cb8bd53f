"""The equations as LaTeX: every formula parses, numbers read well, and constraints have their place."""

import functools
import re

import pytest
import sympy as sp

from mbd_sim.cli.main import main
from mbd_sim.files.load import load_mechanism, parse_mechanism
from mbd_sim.studies.algebra.names import exact_number, number, shortest_numbers, write
from mbd_sim.studies.symbolic import to_latex
from mbd_sim.studies.symbolic.equations import symbolic_equations
from mbd_sim.studies.symbolic.latex import constraint_rows, energy_rows, entry_rows, motion_rows, screen_latex
from mbd_sim.studies.symbolic.latex_elements import sensor_rows
from test.studies.symbolic.test_equations import equations_of

# With every sort of row: drives, quaternions, contacts or stops, tables, loops, rows of speeds and of time, sensors.
FORMULAS = ("air_spring", "balancing_pendulum", "stick_slip", "pencil", "knife_edge", "insect_on_sphere", "atwood",
            "four_bar", "rotating_frame_mass", "scissor_lift", "spherical_top")  # fmt: skip
INNERMOST = re.compile(r"\\left\(((?:(?!\\left|\\right).)*)\\right\)")
NAME = r"\\mathrm\{[A-Za-z0-9,]+(?:\\_[A-Za-z0-9,]+)*\}"


def parse(formula):
    """Let Matplotlib's parser read a formula, bracket by bracket and factor by factor: many recur, and each takes it long."""
    assert formula.count("{") == formula.count("}")
    assert formula.count(r"\left") == formula.count(r"\right")
    while (bracket := INNERMOST.search(formula)) is not None:
        parse_terms(bracket[1])
        formula = formula[: bracket.start()] + "(1)" + formula[bracket.end() :]
    parse_terms(formula)


def parse_terms(formula):
    """Let Matplotlib's parser read the factors of a sum, with the same number for all numbers and the same name for all names."""
    formula = re.sub(r"\d+(\.\d+)?", "1", formula)
    for name in re.findall(NAME, formula):
        parse_factor(name)
    formula = re.sub(NAME, lambda name: r"\mathrm{a\_b}" if r"\_" in name[0] else r"\mathrm{a}", formula)
    for term in split(formula, r" [+-] "):
        assert term.strip()
        for factor in split(term.strip(), r" +"):
            parse_factor(factor)


def split(formula, separator):
    """The pieces of a formula between separators that are not within braces, brackets or cases."""
    start = depth = 0
    for match in re.finditer(rf"[{{}}]|\\left|\\right|\\begin|\\end|{separator}", formula):
        if match[0] in ("{", r"\left", r"\begin"):
            depth += 1
        elif match[0] in ("}", r"\right", r"\end"):
            depth -= 1
        elif depth == 0:
            yield formula[start : match.start()]
            start = match.end()
    yield formula[start:]


@functools.cache
def parse_factor(factor):
    """Let Matplotlib's parser read a factor.

    It has neither small fractions nor cases, and its time doubles with each nested pair of growing brackets.
    """
    from matplotlib.mathtext import MathTextParser

    plain = factor.replace(r"\tfrac", r"\frac").replace(r"\left", "").replace(r"\right", "")
    plain = re.sub(r"\\begin\{cases\}.*?\\end\{cases\}", "1", plain)
    MathTextParser("path").parse(f"${plain}$")


@pytest.mark.parametrize("name", FORMULAS)
def test_every_formula_parses(name):
    equations = equations_of(name)
    for left, right in energy_rows(equations) + motion_rows(equations) + constraint_rows(equations):
        for formula in (*left, *right):
            parse(formula)
    text = to_latex(equations)
    for left, right in entry_rows(equations):
        parse(f"{left} = {right}")
    for formula in re.findall(r"\$([^$]+)\$", text):
        parse(formula)
    for left, right in sensor_rows(equations.sensors, equations.names):
        parse(f"{left} = {right}")
    further = bool(equations.constraints) + bool(equations.sensors)
    assert text.count(r"\begin{align*}") == text.count(r"\end{align*}") == 3 + further
    assert text.count("{") == text.count("}") and text.count(r"\left") == text.count(r"\right")


@pytest.mark.parametrize(
    "formula", [r"2\, \foo{q}", r"1 + \left(2 - \frac{1}\right)", r"q_{\mathrm{a}}^{2}^{2}", "1 + "]
)
def test_formulas_with_mistakes_do_not_parse(formula):
    with pytest.raises((ValueError, AssertionError)):
        parse(formula)


def test_the_command_prints_equations_and_meanings(capsys):
    assert main(["check", "cart_pendulum_spring", "--latex", "--numbers"]) == 0
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
        ((1, 4), r"\tfrac{1}{4}"),
        ((1, 8), r"\tfrac{1}{8}"),
        ((3, 256), r"\tfrac{3}{256}"),
        ((1, 40), "0.025"),
        ((981, 100), "9.81"),
        ((1, 5), "0.2"),
        ((7, 1), "7"),
        ((123456789, 7), r"1.76367 \cdot 10^{7}"),
        ((1, 3000000), r"\tfrac{1}{3} \cdot 10^{-6}"),
        ((-1, 750000), r"-\tfrac{4}{3} \cdot 10^{-6}"),
        ((1, 512), r"\tfrac{1}{512}"),
        ((1, 300), r"\tfrac{1}{300}"),
        ((1, 1000000), "10^{-6}"),
        ((12345678, 10000000), "1.2345678"),
        ((4 * 10**10, 1), r"4 \cdot 10^{10}"),
        ((355, 113), "3.14159"),
    ],
)
def test_numbers_are_fractions_where_they_are_simple(fraction, text):
    assert number(*fraction) == text


def test_numbers_are_shortest_also_in_products():
    m, length = sp.symbols("m l")
    assert shortest_numbers([(100 * m * length**2 + 1) / 50]) == 2 * (m * length**2 + sp.Rational(1, 100))
    long = sp.Rational(1, 30 * 10**15) * m * (4 * 10**10 + 25 * 10**14 * length**2)
    short = shortest_numbers([long, sp.expand(long)])
    assert sp.expand(short - long) == 0
    assert all(exact_number(int(one.p), int(one.q)) for one in short.atoms(sp.Rational))
    assert write(sp.Rational(4, 3) * m / 10**6, {m: "m"}) == r"\tfrac{4}{3} \cdot 10^{-6}\, m"


def test_a_force_along_a_line_has_no_signs_beside_distances(capsys):
    """k (|x| - l) sign x is k (x - l) on the side of the start, and the condition says so."""
    assert main(["check", "cart_massive_spring", "--latex", "--numbers", "--no-linearization"]) == 0
    text = capsys.readouterr().out
    rail = r"\tfrac{3}{2} + q_{\mathrm{rail}}"
    assert r"&= \tau_{\mathrm{rail}} - 20\, q_{\mathrm{rail}}" in text
    assert f"{rail} &> 0" in text
    assert "sign" not in text and "left|" not in text


def test_equations_are_printed_without_their_linearization(capsys):
    assert main(["check", "knife_edge", "--latex", "--no-linearization"]) == 0
    text = capsys.readouterr().out
    assert r"\left(\tfrac{1}{12}\, \operatorname{length}^{2} m + \tfrac{4}{3} \cdot 10^{-6}\, m\right)" in text
    assert r"\delta" not in text and r"M_{33} &=" in text
    assert main(["check", "knife_edge", "--no-linearization"]) == 1


def test_constraints_add_their_multipliers():
    equations = equations_of("four_bar")
    (_, first), (_, second), (_, third) = motion_rows(equations)
    own = [r"\lambda_{\mathrm{rocker\_pin},1}", r"\lambda_{\mathrm{rocker\_pin},2}"]
    for terms in (first, second, third):
        assert [symbol for symbol in own if any(symbol in term for term in terms)] == own
    assert third[1:] == [
        rf"-1.2\, \sin {{q_{{\mathrm{{rocker\_pivot}}}}}}\, {own[0]}",
        rf"1.2\, \cos {{q_{{\mathrm{{rocker\_pivot}}}}}}\, {own[1]}",
    ]
    assert [right for _, right in constraint_rows(equations)] == [["0"], ["0"]]
    text = to_latex(equations)
    assert r"In matrix form, $M \dot{u} + h = Q + G^{T} \lambda$ and $G u = 0$ with" in text
    assert rf"multipliers of joint \texttt{{rocker\_pin}}, which closes a loop: ${own[0]}$, N, of displ" in text
    assert r"omitted, as the other rows imply them: rocker\_pin: displacement along y" in text


def test_nonholonomic_rows_are_written_in_speeds():
    equations = equations_of("knife_edge")
    ((left, right),) = constraint_rows(equations)
    angle = r"q_{\mathrm{ice,angle}}"
    assert left == [
        rf"- \sin {{{angle}}}\, \dot{{q}}_{{\mathrm{{ice,x}}}}",
        rf"\cos {{{angle}}}\, \dot{{q}}_{{\mathrm{{ice,y}}}}",
    ]
    assert right == ["0"]
    assert r"$\lambda_{\mathrm{edge}}$, N, of sideways motion, nonholonomic" in to_latex(equations)


def test_constraints_that_depend_on_time_have_their_drift():
    text = to_latex(equations_of("scissor_lift"))
    assert r"and $G u + b = 0$ with" in text and r"b_{3} &=" in text and r"$t$ is the time" in text


def test_a_mechanism_in_place_of_its_equations_is_refused():
    with pytest.raises(TypeError, match=r"is not SymbolicEquations\. Give symbolic_equations\(mechanism\)\."):
        to_latex(load_mechanism("rod_pendulum"))


LINE = """
mechanism: line
parameters: {{k: 10, m: 2}}
ground: {{points: {{w: [{wall}, 0, 0]}}}}
parts: {{a: {{mass: m}}}}
joints: {{q: {{type: prismatic, between: [ground, a], axis: [1, 0, 0], position: 0.5}}}}
forces: {{s: {{type: spring, between: [ground.w, a], stiffness: k, length: 2.5}}}}
"""


@pytest.mark.parametrize(("wall", "condition", "force"), [(-3, "3 + q", -10.0), (4, "4 - q", 10.0)])
def test_the_length_of_a_spring_on_a_line_is_printed_for_the_side_of_the_start(wall, condition, force):
    r"""It was \left|3 + q\right| and its sign; as SymPy it stays right on both sides."""
    equations = symbolic_equations(parse_mechanism(LINE.format(wall=wall)), None)
    text = to_latex(equations)
    assert "left|" not in text
    assert "sign" not in text
    assert f"{condition}_{{\\mathrm{{q}}}} &> 0" in text
    assert "> 0" in screen_latex(equations)
    (q,), (side,) = equations.q, equations.sides
    numbers = {one.symbol: one.value for one in equations.parameters} | {equations.efforts[0]: 0}
    found = [
        float(equations.forces[0].subs(numbers | {q: at}))
        for at in (0.5, 0.5 - 2 * side.subs(numbers | {q: 0.5}) / side.diff(q))
    ]
    assert found[0] == pytest.approx(force)
    assert found[1] == pytest.approx(-force)  # as far beyond the wall: the spring is as long


def test_absolute_values_of_the_file_stay():
    text = LINE.format(wall=-3) + "  f: {type: effort, coordinate: q, effort: -abs(q + 1)}\n"
    text = text.replace(
        "forces: {s: {type: spring, between: [ground.w, a], stiffness: k, length: 2.5}}",
        "forces:\n  s: {type: spring, between: [ground.w, a], stiffness: k, length: 2.5}",
    )
    equations = symbolic_equations(parse_mechanism(text), None)
    assert not equations.sides
    assert "left|1 + q" in to_latex(equations)
