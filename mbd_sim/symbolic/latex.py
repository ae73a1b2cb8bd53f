"""Symbolic equations as a piece of LaTeX: the equations, their matrices entry by entry, and what the symbols mean."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from mbd_sim.symbolic.equations import Coordinate, SymbolicEquations, escaped
from mbd_sim.symbolic.printer import write

LONGEST_LINE = 420  # characters of LaTeX, about what a line of text holds
UNITS = {"revolute": ("rad",), "prismatic": ("m",), "screw": ("rad",), "cylindrical": ("m", "rad"),
         "universal": ("rad", "rad"), "planar": ("m", "m", "rad")}  # fmt: skip


def to_latex(equations: SymbolicEquations) -> str:
    """Text to be put into a LaTeX document with `amsmath`; numbers are in SI units, rounded to six digits."""
    lines = [
        rf"% Equations of motion of {equations.mechanism}, by mbd_sim. Needs \usepackage{{amsmath}}.",
        r"\begin{align*}",
        *_aligned(motion_rows(equations)),
        r"\end{align*}",
        r"that is, $M \dot{u} + h = Q$ with",
        r"\begin{align*}",
        *_aligned([([name], value) for name, value in entry_rows(equations)]),
        r"\end{align*}",
        r"where",
        r"\begin{itemize}",
        *(f"  \\item {line}" for line in _meanings(equations)),
        r"\end{itemize}",
        r"Numbers are in SI units, rounded to six digits.",
    ]
    return "\n".join(lines)


def motion_rows(equations: SymbolicEquations) -> list[tuple[list[str], str]]:
    """The terms of the left side, and the right side, of each equation of motion; then the constraints."""
    rows: list[tuple[list[str], str]] = []
    for row, force in enumerate(equations.forces):
        terms = [
            _times(write(entry, equations.names), entry, equations.names[rate])
            for entry, rate in zip(equations.mass[row], equations.u_rates, strict=True)
            if entry != 0
        ]
        if equations.inertial[row] != 0:
            terms.append(write(equations.inertial[row], equations.names))
        rows.append((terms, write(force + _constraint_force(equations, row), equations.names)))
    return rows + [([write(constraint, equations.names)], "0") for constraint in equations.constraints]


def entry_rows(equations: SymbolicEquations) -> list[tuple[str, str]]:
    """Name and value of each entry of M, by its upper triangle, and of h and Q that is not zero."""
    rows, count = [], len(equations.u)
    for i in range(count):
        for j in range(i, count):
            entry = write(equations.mass[i][j], equations.names)
            name = f"M_{{{i + 1}{j + 1}}}"
            if i == j or equations.mass[i][j] != 0:
                rows.append((name if i == j else f"{name} = M_{{{j + 1}{i + 1}}}", entry))
    for letter, vector in (("h", equations.inertial), ("Q", equations.forces)):
        rows += [(f"{letter}_{{{i + 1}}}", write(entry, equations.names)) for i, entry in enumerate(vector)]
    return rows


def _constraint_force(equations: SymbolicEquations, row: int) -> Any:
    """A component of Gᵀλ, for coordinates whose rates are the speeds."""
    pairs = zip(equations.constraints, equations.multipliers, strict=True)
    return sum(multiplier * constraint.diff(equations.q[row]) for constraint, multiplier in pairs)


def _times(factor: str, entry: Any, symbol: str) -> str:
    if entry in (1, -1):
        return symbol if entry == 1 else f"- {symbol}"
    return rf"\left({factor}\right) {symbol}" if entry.is_Add else rf"{factor}\, {symbol}"


def _aligned(rows: list[tuple[list[str], str]]) -> Iterator[str]:
    """One line an equation, or, where that is too long for a page, one line a term."""
    for number, (terms, right) in enumerate(rows, 1):
        end = r" \\" if number < len(rows) else ""
        signed = [
            term if place == 0 or term.startswith("-") else f"+ {term}" for place, term in enumerate(terms or ["0"])
        ]
        if sum(map(len, signed)) + len(right) <= LONGEST_LINE:
            yield f"  {' '.join(signed)} &= {right}{end}"
            continue
        yield f"  & {signed[0]} " + r"\\"
        for term in signed[1:]:
            yield rf"  & \quad {{}} {term} " + r"\\"
        yield f"  &= {right}{end}"


def _meanings(equations: SymbolicEquations) -> Iterator[str]:
    names = equations.names
    order = ", ".join(f"{names[symbol]}" for symbol in equations.u)
    yield rf"$u = ({order})$ are the generalized speeds, in the order of the rows;"
    for coordinate in equations.coordinates:
        yield from _meaning(coordinate, names)
    if equations.time in {s for e in (*equations.inertial, *equations.forces) for s in e.free_symbols}:
        yield r"$t$ is the time, s;"
    if equations.multipliers:
        listed = ", ".join(names[symbol] for symbol in equations.multipliers)
        yield rf"${listed}$ are the multipliers of the constraints."


def _meaning(coordinate: Coordinate, names: dict[Any, str]) -> Iterator[str]:
    joint = rf"joint \texttt{{{escaped(coordinate.joint)}}}"
    if coordinate.type in UNITS:
        for q, effort, unit in zip(coordinate.q, coordinate.efforts, UNITS[coordinate.type], strict=True):
            what, load = ("angle", r"N\,m") if unit == "rad" else ("displacement", "N")
            yield f"${names[q]}$ is the {what} of {joint}, {unit}, and ${names[effort]}$ its effort, {load};"
        return
    if coordinate.type == "free":
        yield f"$q$ is the position of the second part of {joint}, m, $v$ its velocity, m/s, and $F$ its force, N;"
    rates = r"$\dot{p} = \tfrac{1}{2}\, p \circ (0, \omega)$"
    yield f"$p$ is the unit quaternion $(w, x, y, z)$ of {joint}, with {rates};"
    yield r"$\omega$ is its angular velocity in the axes of the second part, rad/s, and $\tau$ its moment, N\,m;"
