"""Linearized equations as LaTeX."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from mbd_sim.symbolic.latex_printer import write
from mbd_sim.symbolic.symbolic_linearization import SymbolicLinearization

LONGEST_MATRIX = 420  # characters of LaTeX; longer matrices are written entry by entry
Names = dict[Any, str]


def linearization_lines(
    linearization: SymbolicLinearization, q: Sequence[Any], multipliers: Sequence[Any], names: Names
) -> list[str]:
    """The lines of a document that state the linearized equations, and their characteristic polynomial.

    :param q: the coordinates.
    :param multipliers: those of the constraints.
    """
    own = [*zip(q, linearization.equilibrium, strict=True), *zip(multipliers, linearization.loads, strict=True)]
    place = ", ".join(f"{names[symbol]} = {write(value, names)}" for symbol, value in own)
    constrained = bool(linearization.loads)
    known = ", ".join(f"${names[symbol]} = {value:.6g}$" for symbol, value in linearization.values.items())
    damped = any(entry != 0 for entry in linearization.damping)
    rate = r"C\, \delta u + " if damped else ""
    equation = rf"M\, \delta \dot{{u}} + {rate}K\, \delta q = \delta \tau"
    if constrained:
        equation += r" + G^{T}\, \delta \lambda,\quad G\, \delta u = 0"
    matrices = [("M", linearization.mass), *([("C", linearization.damping)] if damped else [])]
    bordering = [("G", linearization.gradient)] if constrained else []
    rows = [
        row
        for name, matrix in [*matrices, ("K", linearization.stiffness), *bordering]
        for row in _rows(name, matrix, names)
    ]
    lines = [
        rf"Small differences $\delta$ from the equilibrium ${place}$" + (f", where {known}," if known else ""),
        rf"satisfy ${equation}$ with",
        r"\begin{align*}",
        *(rf"  {row} \\" for row in rows[:-1]),
        f"  {rows[-1]}",
        r"\end{align*}",
    ]
    if linearization.polynomial is None:
        return lines
    terms = list(_powers(linearization, names))
    return [
        *lines,
        "The characteristic polynomial is",
        r"\begin{align*}",
        rf"  {_determinant(linearization, damped)} &= {terms[0]}"
        + "".join(" \\\\\n  & \\quad {} " + term for term in terms[1:]),
        r"\end{align*}",
    ]


def _determinant(linearization: SymbolicLinearization, damped: bool) -> str:
    """The determinant that is the characteristic polynomial."""
    matrix = rf"M s^{{2}} {'+ C s ' if damped else ''}+ K"
    if not linearization.loads:
        return rf"\det \left({matrix}\right)"
    factor = r"s\, " if linearization.rolling else ""
    return rf"\det \begin{{pmatrix}} {matrix} & -G^{{T}} \\ {factor}G & 0 \end{{pmatrix}}"


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
        coefficient = sp.factor(value)
        negative = coefficient.could_extract_minus_sign() and not coefficient.is_Add
        shown = write(-coefficient if negative else coefficient, names)
        shown = rf"\left({shown}\right)" if coefficient.is_Add and power else shown
        symbol = "" if not power else "s" if power == 1 else f"s^{{{power}}}"
        sign = "- " if negative else "+ " if number else ""
        product = shown if not power else symbol if shown == "1" else rf"{shown}\, {symbol}"
        yield sign + product
