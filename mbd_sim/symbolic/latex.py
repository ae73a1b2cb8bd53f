"""Symbolic equations as LaTeX: the equations, the entries of their matrices, and the meaning of the symbols."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from mbd_sim.errors import quoted
from mbd_sim.symbolic.actuator_latex import actuator_lines
from mbd_sim.symbolic.contact_latex import contact_lines
from mbd_sim.symbolic.latex_meanings import meanings
from mbd_sim.symbolic.latex_printer import write
from mbd_sim.symbolic.linearization_latex import linearization_lines
from mbd_sim.symbolic.sensor_latex import sensor_lines
from mbd_sim.symbolic.symbolic_constraints import SymbolicConstraint
from mbd_sim.symbolic.symbolic_equations import SymbolicEquations
from mbd_sim.symbolic.symbolic_linearization import SymbolicLinearization

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
    lines = [
        rf"% Equations of motion of {equations.mechanism}, by mbd_sim. Needs \usepackage{{amsmath,amssymb}}.",
        *_energy_lines(equations),
        r"\begin{align*}",
        *_aligned(motion_rows(equations)),
        r"\end{align*}",
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
        r"\begin{align*}",
        *_aligned([([name], [value]) for name, value in entry_rows(equations)]),
        r"\end{align*}",
        *linear,
        *sensor_lines(equations.sensors, equations.names),
        r"Here",
        r"\begin{itemize}",
        "\n".join(f"  \\item {line}" for line in meanings(equations)).removesuffix(";") + ".",
        r"\end{itemize}",
        r"Numbers are in SI units; those that are no short fractions or decimals are rounded to six digits.",
    ]
    return "\n".join(lines)


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
        r"\begin{align*}",
        *_aligned(rows),
        r"\end{align*}",
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
    return [
        r"with the constraints",
        r"\begin{align*}",
        *_aligned(constraint_rows(equations)),
        r"\end{align*}",
    ]


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
    """One line for each equation, or one line for each term if the equation is too long for a page."""
    for number, (left, right) in enumerate(rows, 1):
        end = r" \\" if number < len(rows) else ""
        first, second = _signed(left), _signed(right)
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


def _signed(terms: list[str]) -> list[str]:
    return [term if number == 0 or term.startswith("-") else f"+ {term}" for number, term in enumerate(terms or ["0"])]
