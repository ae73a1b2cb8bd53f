"""What the symbols of equations mean, in LaTeX."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import groupby
from typing import Any

from mbd_sim.mechanism.joint_types import JOINT_KINDS
from mbd_sim.symbolic.actuator_latex import actuator_meanings
from mbd_sim.symbolic.contact_latex import contact_meanings
from mbd_sim.symbolic.latex_printer import escaped, plain
from mbd_sim.symbolic.sensor_latex import sensor_meanings
from mbd_sim.symbolic.symbolic_constraints import SymbolicConstraint
from mbd_sim.symbolic.symbolic_coordinates import Coordinate
from mbd_sim.symbolic.symbolic_equations import SymbolicEquations
from mbd_sim.symbolic.symbolic_values import ParameterSymbol


def meanings(equations: SymbolicEquations) -> Iterator[str]:
    """What each symbol means, an item each."""
    names = equations.names
    order = ", ".join(f"{names[symbol]}" for symbol in equations.u)
    yield rf"$u = ({order})$ are the generalized speeds, in the order of the rows;"
    for coordinate in equations.coordinates:
        yield from _coordinate_meaning(coordinate, names)
    yield from actuator_meanings(equations.actuators, names)
    for parameter in equations.parameters:
        yield _parameter_meaning(parameter)
    if equations.built_in:
        listed = ", ".join(rf"\texttt{{{plain(key.removeprefix('parameters.'))}}}" for key in equations.built_in)
        yield f"parameters whose values are built into the equations: {listed};"
    rows = [(c.position or 0) + c.drift + sum(c.gradient) for c in equations.rows]
    measured = [value for one in equations.sensors for value in one.values.values()]
    expressions = (*equations.inertial, *equations.forces, *rows, *measured)
    if equations.time in {symbol for expression in expressions for symbol in expression.free_symbols}:
        yield r"$t$ is the time, s;"
    if equations.constraints:
        yield (
            r"$G^{T} \lambda$ are the constraint forces; a row of $G u + b$ is the rate of a holonomic constraint, "
            "or a nonholonomic constraint itself;"
        )
    yield from contact_meanings(equations.contacts, names)
    for _, group in groupby(equations.constraints, lambda constraint: constraint.owner):
        yield _multiplier_meaning(list(group), names)
    yield from sensor_meanings(equations.sensors)
    if equations.left_out:
        yield f"omitted, as the other rows imply them: {escaped(', '.join(equations.left_out))};"


def _parameter_meaning(parameter: ParameterSymbol) -> str:
    own = rf" \texttt{{{plain(parameter.key.removeprefix('parameters.'))}}}" if parameter.key else ""
    return rf"${parameter.latex}$ is {plain(parameter.stands_for)}{own}: {plain(parameter.written)};"


def _multiplier_meaning(rows: list[SymbolicConstraint], names: dict[Any, str]) -> str:
    """The multipliers of one joint or constraint, with the quantity that each row keeps at zero."""
    first = rows[0]
    owner = rf"joint \texttt{{{escaped(first.owner)}}}, which closes a loop" if first.closes else ""
    owner = owner or rf"constraint \texttt{{{escaped(first.owner)}}}"
    listed = "; ".join(_row_meaning(row, names) for row in rows)
    return f"{'multipliers' if rows[1:] else 'multiplier'} of {owner}: {listed};"


def _row_meaning(row: SymbolicConstraint, names: dict[Any, str]) -> str:
    unit = row.load or "J per unit of the equation"
    kind = ", nonholonomic" if row.position is None else ""
    return f"${names[row.multiplier]}$, {unit}, of {escaped(row.quantity)}{kind}"


def _coordinate_meaning(coordinate: Coordinate, names: dict[Any, str]) -> Iterator[str]:
    joint = rf"joint \texttt{{{escaped(coordinate.joint)}}}"
    kind = JOINT_KINDS[coordinate.type]
    if kind.quaternion is None:
        for q, effort, freedom in zip(coordinate.q, coordinate.efforts, kind.coordinates, strict=False):
            what, load = ("angle", r"N\,m") if freedom.rotation else ("displacement", "N")
            yield f"${names[q]}$ is the {what} of {joint}, {freedom.unit}, and ${names[effort]}$ its effort, {load};"
        return
    if kind.quaternion:  # after a position
        yield f"$q$ is the position of the second part of {joint}, m, $v$ its velocity, m/s, and $F$ its force, N;"
    rates = r"$\dot{p} = \tfrac{1}{2}\, p \circ (0, \omega)$"
    yield f"$p$ is the unit quaternion $(w, x, y, z)$ of {joint}, with {rates};"
    yield r"$\omega$ is its angular velocity in the axes of the second part, rad/s, and $\tau$ its moment, N\,m;"
