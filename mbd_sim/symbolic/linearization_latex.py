"""Linearized equations as LaTeX."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from mbd_sim.mechanism.joint_types import JOINT_KINDS
from mbd_sim.symbolic.latex_printer import escaped, write
from mbd_sim.symbolic.short_numbers import shortest_numbers
from mbd_sim.symbolic.symbolic_equations import SymbolicEquations
from mbd_sim.symbolic.symbolic_linearization import SymbolicLinearization

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
        r"\begin{align*}",
        *(rf"  {row} \\" for row in rows[:-1]),
        f"  {rows[-1]}",
        r"\end{align*}",
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
    import sympy as sp

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
