"""Symbolic equations as LaTeX: the equations, the entries of their matrices, and linearized equations.

For a screen, equations are one formula, whose lines fit on the page of a notebook.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Any

import sympy as sp

from mbd_sim.base.errors import quoted
from mbd_sim.mechanism.elements.joint_types import JOINT_KINDS
from mbd_sim.studies.algebra.names import escaped, shortest_numbers, write
from mbd_sim.studies.symbolic.constraints import SymbolicConstraint
from mbd_sim.studies.symbolic.equations import SymbolicEquations, on_side
from mbd_sim.studies.symbolic.latex_elements import (
    actuator_lines,
    aligned,
    contact_lines,
    meanings,
    sensor_lines,
    signed,
)
from mbd_sim.studies.symbolic.linearization import SymbolicLinearization

LONGEST_MATRIX = 420  # characters of LaTeX; longer matrices are written entry by entry
Names = dict[Any, str]


def linearization_lines(linearization: SymbolicLinearization, equations: SymbolicEquations) -> list[str]:
    """The lines of a document that state the linearized equations, and their characteristic polynomial."""
    names = equations.names
    own = [
        *zip(equations.q, linearization.equilibrium, strict=True),
        *zip(equations.multipliers, linearization.loads, strict=True),
        *zip(linearization.states, linearization.state_values, strict=True),
    ]
    place = ", ".join(f"{names[symbol]} = {write(value, names)}" for symbol, value in own if symbol != value)
    known = ", ".join(f"${names[symbol]} = {value:.6g}$" for symbol, value in linearization.values.items())
    rows = [row for name, matrix in _matrices(linearization) for row in _rows(name, matrix, names)]
    return [
        rf"Small differences $\delta$ from the equilibrium ${place}$" + (f", where {known}," if known else ""),
        rf"satisfy ${_equation(linearization)}$ with",
        *aligned(rows),
        *_order(linearization, equations),
        *_polynomial_lines(linearization, names),
    ]


def _matrices(linearization: SymbolicLinearization) -> list[tuple[str, Any]]:
    """The matrices that are printed, by name: those of the parts of the equations that there are."""
    by_q, by_u, by_s = linearization.state_rates
    named = [
        ("M", linearization.mass),
        ("C", linearization.damping),
        ("K", linearization.stiffness),
        ("E", linearization.coupling),
        ("W", linearization.commanded),
        ("A", by_q),
        ("B", by_u),
        ("S", by_s),
        ("V", linearization.commanded_rates),
    ]
    always = {"M", "K"}
    shown = [(name, matrix) for name, matrix in named if name in always or not matrix.is_zero_matrix]
    return shown + ([("G", linearization.gradient)] if linearization.loads else [])


def _equation(linearization: SymbolicLinearization) -> str:
    shown = {name for name, _ in _matrices(linearization)}

    def terms(pairs: Sequence[tuple[str, str]]) -> str:
        return " + ".join(rf"{name}\, \delta {symbol}" for name, symbol in pairs if name in shown)

    left = terms([("M", r"\dot{u}"), ("C", "u"), ("K", "q"), ("E", "x")])
    right = r"\delta \tau" + (" + " + terms([("W", "w")]) if "W" in shown else "")
    equation = f"{left} = {right}"
    if linearization.loads:
        equation += r" + G^{T}\, \delta \lambda,\quad G\, \delta u = 0"
    if linearization.states:
        rates = terms([("A", "q"), ("B", "u"), ("S", "x"), ("V", "w")])
        equation += rf",\quad \delta \dot{{x}} = {rates or 0}"
    return equation


def _order(linearization: SymbolicLinearization, equations: SymbolicEquations) -> Iterator[str]:
    """What q, x and w are, where this is not obvious."""
    names = equations.names
    turned = [one.joint for one in equations.coordinates if JOINT_KINDS[one.type].quaternion is not None]
    if turned:
        joints = ", ".join(rf"\texttt{{{escaped(name)}}}" for name in turned)
        yield (
            rf"where $\delta q$ has, in the place of $\omega$ of {joints}, the small rotation in rad about the axes of "
            r"the second part, whose rate is $\delta \omega$;"
        )
    for letter, symbols in (("x", linearization.states), ("w", linearization.commands)):
        if symbols and any(name in ("E", "S", "W", "V") for name, _ in _matrices(linearization)):
            yield f"${letter} = ({', '.join(names[symbol] for symbol in symbols)})$."


def _polynomial_lines(linearization: SymbolicLinearization, names: Names) -> list[str]:
    if linearization.polynomial is None:
        return []
    terms = list(_powers(linearization, names))
    return [
        "The characteristic polynomial is",
        r"\begin{align*}",
        rf"  {_determinant(linearization)} &= {terms[0]}"
        + "".join(" \\\\\n  & \\quad {} " + term for term in terms[1:]),
        r"\end{align*}",
    ]


def _determinant(linearization: SymbolicLinearization) -> str:
    """The determinant that is the characteristic polynomial."""
    shown = {name for name, _ in _matrices(linearization)}
    matrix = rf"M s^{{2}} {'+ C s ' if 'C' in shown else ''}+ K"
    rows = [[matrix]]
    if linearization.states:
        below = " ".join(term for name, term in (("A", "- A"), ("B", r"- B s")) if name in shown)
        rows = [[matrix, "E" if "E" in shown else "0"], [below or "0", "s I - S" if "S" in shown else "s I"]]
    if linearization.loads:
        factor = r"s\, " if linearization.rolling else ""
        rows = [[*rows[0], "-G^{T}"], *([*row, "0"] for row in rows[1:])]
        rows.append([f"{factor}G", *["0"] * (len(rows[0]) - 1)])
    if len(rows) == 1:
        return rf"\det \left({matrix}\right)"
    inside = r" \\ ".join(" & ".join(row) for row in rows)
    return rf"\det \begin{{pmatrix}} {inside} \end{{pmatrix}}"


def _rows(name: str, matrix: Any, names: Names) -> list[str]:
    """A matrix, or its entries that are not zero if it is long."""
    entries = [[write(matrix[row, column], names) for column in range(matrix.cols)] for row in range(matrix.rows)]
    if sum(len(entry) for row in entries for entry in row) <= LONGEST_MATRIX:
        inside = r" \\ ".join(" & ".join(row) for row in entries)
        return [rf"{name} &= \begin{{pmatrix}} {inside} \end{{pmatrix}}"]
    places = [(row, column) for row in range(matrix.rows) for column in range(matrix.cols) if matrix[row, column] != 0]
    return [f"{name}_{{{row + 1}{column + 1}}} &= {entries[row][column]}" for row, column in places]


def _powers(linearization: SymbolicLinearization, names: Names) -> Iterator[str]:
    """The terms of the characteristic polynomial, from the highest power of s."""
    terms = sp.Poly(linearization.polynomial, linearization.s).terms()
    for number, ((power,), value) in enumerate(terms):
        coefficient = shortest_numbers([sp.factor(value), sp.expand(value)])
        negative = coefficient.could_extract_minus_sign() and not coefficient.is_Add
        shown = write(-coefficient if negative else coefficient, names)
        shown = rf"\left({shown}\right)" if coefficient.is_Add and power else shown
        symbol = "" if not power else "s" if power == 1 else f"s^{{{power}}}"
        sign = "- " if negative else "+ " if number else ""
        product = shown if not power else symbol if shown == "1" else rf"{shown}\, {symbol}"
        yield sign + product


LONGEST_LINE = 420  # characters of LaTeX, about one line of a page


def to_latex(equations: SymbolicEquations, linearization: SymbolicLinearization | None = None) -> str:
    """LaTeX for a document with `amsmath` and `amssymb`; numbers are in SI units, see `latex_printer.number`.

    :param linearization: of the same equations, to be stated after them.
    :raises TypeError: `equations` are none, for example a mechanism.
    """
    if not isinstance(equations, SymbolicEquations):
        raise TypeError(f"{quoted(equations)} is not SymbolicEquations. Give symbolic_equations(mechanism).")
    linear: list[str] = []
    if linearization is not None:
        linear = linearization_lines(linearization, equations)
    equations = on_side(equations)
    lines = [
        rf"% Equations of motion of {equations.mechanism}, by mbd_sim. Needs \usepackage{{amsmath,amssymb}}.",
        *_energy_lines(equations),
        *_aligned(motion_rows(equations)),
        *_side_lines(equations),
        *actuator_lines(equations.actuators, equations.names),
        *_constraint_lines(equations),
        *contact_lines(
            equations.contacts,
            equations.names,
            rate=lambda row: _rate_terms(equations, row),
            gap=lambda row: _constraint_terms(equations, row),
            constrained=bool(equations.constraints),
        ),
        rf"In matrix form, ${_matrix_form(equations)}$ with",
        *_aligned([([name], [value]) for name, value in entry_rows(equations)]),
        *linear,
        *sensor_lines(equations.sensors, equations.names),
        r"Here",
        r"\begin{itemize}",
        "\n".join(f"  \\item {line}" for line in meanings(equations)).removesuffix(";") + ".",
        r"\end{itemize}",
        r"Numbers are in SI units; those that are not short fractions or decimals are rounded to six digits.",
    ]
    return "\n".join(lines)


def _side_lines(equations: SymbolicEquations) -> list[str]:
    """Where the equations hold, if lengths of springs in them pass through zero."""
    if not equations.sides:
        return []
    rows = [([write(side, equations.names)], ["0"]) for side in equations.sides]
    conditions = (line.replace("&=", "&>") for line in _aligned(rows))
    return ["as long as no spring passes through zero length:", *conditions]


def energy_rows(equations: SymbolicEquations) -> list[tuple[list[str], list[str]]]:
    """The names and the terms of T, V and, if there are dampers, D."""
    energies = equations.energies
    if energies is None:
        return []
    named = [("T", energies.kinetic), ("V", energies.potential), ("D", energies.dissipation)]
    shown = (pair for pair in named if pair[1] != 0 or pair[0] == "T")
    return [([name], _terms(value, equations.names)) for name, value in shown]


def _terms(value: Any, names: dict[Any, str]) -> list[str]:
    """The terms of a sum that is too long for a line, or else the whole."""
    whole = write(value, names)
    if len(whole) <= LONGEST_LINE or not value.is_Add:
        return [whole]
    return [write(term, names) for term in value.as_ordered_terms()]


def _energy_lines(equations: SymbolicEquations) -> list[str]:
    rows = energy_rows(equations)
    if not rows:
        return []
    what = {("T",): "kinetic energy", ("T", "V"): "kinetic and potential energies"}
    letters = tuple(left[0] for left, _ in rows)
    begin = what.get(
        letters,
        "energies and the dissipation function" if "V" in letters else "kinetic energy and the dissipation function",
    )
    lagrangian = "$L = T - V$" if "V" in letters else "$L = T$"
    after = rf"With the Lagrangian {lagrangian}, the equations of motion are"
    return [
        f"The {begin} are" if letters != ("T",) else f"The {begin} is",
        *_aligned(rows),
        after,
    ]


def motion_rows(equations: SymbolicEquations) -> list[tuple[list[str], list[str]]]:
    """The terms on the left and on the right side of each equation of motion."""
    rows: list[tuple[list[str], list[str]]] = []
    for row, force in enumerate(equations.forces):
        left = _sum(equations, equations.mass[row], equations.u_rates)
        if equations.inertial[row] != 0:
            left.append(write(equations.inertial[row], equations.names))
        slopes = [constraint.gradient[row] for constraint in equations.rows]
        right = _sum(equations, slopes, equations.multipliers)
        if force != 0 or not right:
            right.insert(0, write(force, equations.names))
        rows.append((left, right))
    return rows


def constraint_rows(equations: SymbolicEquations) -> list[tuple[list[str], list[str]]]:
    """The terms of Φ = 0 for each holonomic row, and of G u + b = 0 for each nonholonomic row."""
    return [(_constraint_terms(equations, constraint), ["0"]) for constraint in equations.constraints]


def _constraint_terms(equations: SymbolicEquations, constraint: SymbolicConstraint) -> list[str]:
    if constraint.position is not None:
        return _terms(constraint.position, equations.names)
    return _rate_terms(equations, constraint)


def _rate_terms(equations: SymbolicEquations, constraint: SymbolicConstraint) -> list[str]:
    """The terms of G u + b."""
    drift = [write(constraint.drift, equations.names)] if constraint.drift != 0 else []
    return _sum(equations, constraint.gradient, equations.u) + drift


def _constraint_lines(equations: SymbolicEquations) -> list[str]:
    if not equations.constraints:
        return []
    return ["with the constraints", *_aligned(constraint_rows(equations))]


def _matrix_form(equations: SymbolicEquations) -> str:
    if not equations.constraints:
        return r"M \dot{u} + h = Q" + (r" + G^{T} \lambda" if equations.contacts else "")
    if equations.contacts:
        return r"M \dot{u} + h = Q + G^{T} \lambda"
    moving = any(constraint.drift != 0 for constraint in equations.constraints)
    return rf"M \dot{{u}} + h = Q + G^{{T}} \lambda$ and $G u {'+ b ' if moving else ''}= 0"


def entry_rows(equations: SymbolicEquations) -> list[tuple[str, str]]:
    """The names and values of the entries: the upper triangle of M, h, Q, and the nonzero entries of G and b."""
    rows, count = [], len(equations.u)
    for i in range(count):
        for j in range(i, count):
            entry = write(equations.mass[i][j], equations.names)
            name = f"M_{{{i + 1}{j + 1}}}"
            if i == j or equations.mass[i][j] != 0:
                rows.append((name if i == j else f"{name} = M_{{{j + 1}{i + 1}}}", entry))
    for letter, vector in (("h", equations.inertial), ("Q", equations.forces)):
        rows += [(f"{letter}_{{{i + 1}}}", write(entry, equations.names)) for i, entry in enumerate(vector)]
    for i, constraint in enumerate(equations.rows):
        slopes = ((f"G_{{{i + 1}{j + 1}}}", entry) for j, entry in enumerate(constraint.gradient))
        named = [*slopes, (f"b_{{{i + 1}}}", constraint.drift)]
        rows += [(name, write(entry, equations.names)) for name, entry in named if entry != 0]
    return rows


def _sum(equations: SymbolicEquations, factors: Sequence[Any], symbols: Sequence[Any]) -> list[str]:
    """The terms of Σ factor · symbol that are not zero."""
    names = equations.names
    pairs = zip(factors, symbols, strict=True)
    return [_times(write(factor, names), factor, names[symbol]) for factor, symbol in pairs if factor != 0]


def _times(factor: str, entry: Any, symbol: str) -> str:
    if entry in (1, -1):
        return symbol if entry == 1 else f"- {symbol}"
    return rf"\left({factor}\right) {symbol}" if entry.is_Add else rf"{factor}\, {symbol}"


def _aligned(rows: list[tuple[list[str], list[str]]]) -> Iterator[str]:
    """Equations one below the other, with a line for each, or for each term if the equation is too long for a page."""
    yield r"\begin{align*}"
    for number, (left, right) in enumerate(rows, 1):
        end = r" \\" if number < len(rows) else ""
        first, second = signed(left), signed(right)
        if sum(map(len, first + second)) <= LONGEST_LINE:
            yield f"  {' '.join(first)} &= {' '.join(second)}{end}"
            continue
        lines = [" ".join(second)] if sum(map(len, second)) <= LONGEST_LINE else second
        if len(first) > 1:
            yield f"  & {first[0]} " + r"\\"
            for term in first[1:]:
                yield rf"  & \quad {{}} {term} " + r"\\"
        yield f"  {first[0] if len(first) == 1 else ''} &= {lines[0]}" + (r" \\" if lines[1:] else end)
        for number, term in enumerate(lines[1:], 2):
            yield rf"  & \quad {{}} {term}" + (r" \\" if number < len(lines) else end)
    yield r"\end{align*}"


WIDEST = 48.0  # of a line, in digits; about 700 px in a browser of the usual size

_BLOCK = re.compile(r"\\begin\{align\*\}(.*?)\\end\{align\*\}", re.DOTALL)
_TOKEN = re.compile(r"\\\\|\\[a-zA-Z]+\*?|\\.|\s+|.", re.DOTALL)
_OPENING, _CLOSING = ("{", r"\left", r"\begin"), ("}", r"\right", r"\end")
_BREAKS = ("+", "-", "=", "<", ">", r"\leq", r"\geq", r"\perp", r"\in")
_CONTINUED = re.compile(r"&\s*(?:=|\\quad \{\})")
_FRACTION = re.compile(r"\\[td]?frac\{([^{}]*)\}\{([^{}]*)\}")
_INDEX = re.compile(r"[_^](?:\{((?:[^{}]|\{[^{}]*\})*)\}|(\w))")
_SMALL = 0.7  # size of indices, exponents and fractions relative to the line's
_WITHOUT_WIDTH = re.compile(r"\\(?:left|right|mathrm|dot|ddot|displaystyle|quad|:|,)(?![a-z])|[{}\s&]")
_FUNCTION, _SYMBOL = re.compile(r"\\(sin|cos|tan|tanh|min|max|log|exp)\b"), re.compile(r"\\[a-zA-Z]+")


def screen_latex(equations: SymbolicEquations) -> str:
    """The equations of motion and the constraints as one formula for MathJax."""
    blocks = _BLOCK.findall(to_latex(equations).split("In matrix form")[0])
    aligned = (r" \\ ".join(line for row in equations_of(block) for line in lines(row)) for block in blocks)
    return (
        "$\\displaystyle \\begin{aligned}" + r" \\[1.5ex] ".join(aligned) + "\\end{aligned}$"
    )  # lines of all blocks begin at the same place


def equations_of(block: str) -> list[str]:
    """The equations of an `align` environment without their alignment."""
    rows = list[str]()
    for line in _divided(block, (r"\\",)):
        text = line.removeprefix(r"\\").strip()
        if _CONTINUED.match(text) and rows:
            rows[-1] += " " + _CONTINUED.sub(lambda match: "=" if match[0].endswith("=") else "", text, count=1)
        elif text:
            rows.append(text)
    return [" ".join("".join(piece.removeprefix("&") for piece in _divided(row, ("&",))).split()) for row in rows]


def lines(equation: str) -> Iterator[str]:
    """The lines of an equation, which is broken at relations and signs where it is too wide."""
    line, indent = "", ""
    for piece in (piece.strip() for piece in _divided(equation, _BREAKS)):
        if line.strip() and width(f"{line} {piece}") > WIDEST:
            yield f"& {indent}{line.strip()}"
            line, indent = "", r"\qquad {} "
        line = f"{line} {piece}"
    yield f"& {indent}{line.strip()}"


def width(latex: str) -> float:
    """About the printed width of a formula, in digits."""
    fractions = sum(_SMALL * max(map(width, match.groups())) for match in _FRACTION.finditer(latex))
    latex = _FRACTION.sub("", latex)
    indices = sum(_SMALL * width(match[1] or match[2]) for match in _INDEX.finditer(latex))
    latex = _SYMBOL.sub("x", _FUNCTION.sub(r"\1", _WITHOUT_WIDTH.sub("", _INDEX.sub("", latex))))
    return fractions + indices + len(latex) + 0.7 * sum(latex.count(sign) for sign in "+-=<>")


def _divided(latex: str, separators: tuple[str, ...]) -> Iterator[str]:
    """A formula divided before the separators that are in no brackets."""
    depth, piece, previous = 0, "", " "
    for match in _TOKEN.finditer(latex):
        token = match[0]
        depth += (token in _OPENING) - (token in _CLOSING)
        if depth == 0 and token in separators and (previous.isspace() or token in (r"\\", "&")):
            yield piece
            piece = ""
        piece, previous = piece + token, token
    yield piece
