"""Equilibria as formulas: coordinates, multipliers of the constraints, and states of actuators.

States of actuators are, for example, currents and integrals of servos.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any

import numpy as np
import sympy as sp

from mbd_sim.base.geometry.pose import Array
from mbd_sim.mechanism.elements.joint_types import JOINT_KINDS
from mbd_sim.studies.algebra.polynomial import Exact, exact, in_sympy
from mbd_sim.studies.symbolic.equations import SymbolicEquations

NEAR = 1e-7  # between an equilibrium in numbers and its formula
LARGEST_DENOMINATOR = 12  # of components of quaternions

Equilibrium = tuple[tuple[Any, ...], tuple[Any, ...], dict[Any, float]]


def free_equilibrium(
    equations: SymbolicEquations, forces: Any, found: Array, numbers: Mapping[Any, float]
) -> tuple[tuple[Any, ...], dict[Any, float]]:
    """The coordinates (nv,) at an equilibrium without constraints as formulas, and the numbers of symbols among them.

    :param forces: h - Q (nv,) at rest, which are zero at the equilibrium.
    :param found: the coordinates (nq,) in numbers.
    :param numbers: the values of all symbols.
    """
    place = _recognized(equations, found)
    exact_place = dict(zip(equations.q, place, strict=True))
    if all(sp.simplify(force.subs(exact_place)) == 0 for force in forces):
        return tuple(place), {}
    angles = {q: value for q, value in exact_place.items() if not value.is_Float}  # zero, or simple fractions of a turn
    for fixed in (angles, {}):
        solved = _solved(equations, [force.subs(fixed) for force in forces], fixed, found, numbers)
        if solved is not None:
            return solved, {}
    symbols = _symbols(equations, equations.q)
    return symbols, dict(zip(symbols, map(float, found), strict=True))


def _solved(
    equations: SymbolicEquations,
    forces: Sequence[Any],
    fixed: Mapping[Any, Any],
    found: Array,
    numbers: Mapping[Any, float],
) -> tuple[Any, ...] | None:
    """The solution of the equations of equilibrium that has the values found; None if there is no formula."""
    unknown = [q for q in equations.q if q not in fixed]
    left = [force for force in (sp.simplify(force) for force in forces) if force != 0]
    if not unknown or any(not force.free_symbols & set(unknown) for force in left):
        return None
    degree = _degree(left, unknown)
    if degree > 2 or (degree != 1 and len(unknown) > 1):
        return None
    try:
        solutions = sp.solve(left, unknown, dict=True)
    except NotImplementedError:
        return None
    for solution in solutions:
        place = [fixed.get(q, solution.get(q, q)) for q in equations.q]
        if all(not (entry.free_symbols & set(equations.q)) for entry in place):
            values = [complex(entry.subs(numbers)) for entry in place]
            if np.allclose(values, found, rtol=NEAR, atol=NEAR):
                return tuple(place)
    return None


def _degree(forces: Sequence[Any], unknown: Sequence[Any]) -> int:
    """The total degree in the unknowns, 0 if the forces are not polynomials."""
    try:
        return max((sp.Poly(force, *unknown).total_degree() for force in forces), default=0)
    except sp.PolynomialError:
        return 0


def _recognized(equations: SymbolicEquations, found: Array) -> list[Any]:
    """The coordinates (nq,) as fractions of a turn, those of quaternions as fractions and roots, or as decimals."""
    numbers = iter(found.tolist())
    place = []
    for coordinate in equations.coordinates:
        start = JOINT_KINDS[coordinate.type].quaternion
        own = [next(numbers) for _ in coordinate.q]
        place += [recognized(value) for value in own[:start]]
        for value in own[start:] if start is not None else ():
            number = exact(value, NEAR) if abs(value) > NEAR else Exact(Fraction(0))
            short = number.ratio.denominator <= LARGEST_DENOMINATOR and not number.pi
            place.append(in_sympy(number) if short else sp.Float(value))
    return place


def recognized(value: float) -> Any:
    """A number as a fraction of a turn if it is one, else as a decimal."""
    if abs(value) < NEAR:
        return sp.S.Zero
    number: Exact = exact(round(value / np.pi * 12.0) / 12.0)
    if number.ratio and abs(float(number) * np.pi - value) < NEAR:
        return sp.Rational(number.ratio.numerator, number.ratio.denominator) * sp.pi
    return sp.Float(value)


def constrained_equilibrium(
    equations: SymbolicEquations, balance: Any, gradient: Any, found: Array, numbers: Mapping[Any, float]
) -> Equilibrium:
    """The coordinates (nv,) and the multipliers (m,) at an equilibrium, and the numbers of symbols among them.

    They are formulas where the coordinates are simple fractions of a turn, and at most one follows from a linear or
    quadratic constraint. Otherwise they are symbols.

    :param balance: h - Q (nv,) at rest, of which Gᵀ λ is equal at the equilibrium.
    :param gradient: G (m, nv).
    :param found: the coordinates (nv,) in numbers.
    :param numbers: the values of all symbols but the multipliers.
    """
    place = _place(equations, found, numbers)
    if place is not None:
        loads = _loads(equations, balance, gradient, dict(zip(equations.q, place, strict=True)))
        if loads is not None:
            return place, loads, {}
    at = np.array(balance.subs(numbers), dtype=float).ravel(), np.array(gradient.subs(numbers), dtype=float)
    multipliers = np.linalg.lstsq(at[1].T, at[0], rcond=None)[0]
    place, loads = _symbols(equations, equations.q), _symbols(equations, equations.multipliers)
    values = dict(zip((*place, *loads), (*found.tolist(), *multipliers.tolist()), strict=True))
    return place, loads, values


def _place(equations: SymbolicEquations, found: Array, numbers: Mapping[Any, float]) -> tuple[Any, ...] | None:
    """The coordinates as formulas; None if they have none."""
    place = dict(zip(equations.q, _recognized(equations, found), strict=True))
    unknown = [q for q, value in place.items() if value.is_Float]
    known = {q: value for q, value in place.items() if not value.is_Float}
    positions = [sp.simplify(row.position.subs(known)) for row in equations.rows if row.position is not None]
    left = [position for position in positions if position != 0]
    if not unknown:
        return None if left else tuple(place.values())
    if len(unknown) > 1 or not left:
        return None
    (q,) = unknown
    if any(not position.is_polynomial(q) or sp.degree(position, q) > 2 for position in left):
        return None
    for solution in sp.solve(left, [q], dict=True):
        value = complex(solution[q].subs(numbers))
        if abs(value - found[equations.q.index(q)]) < NEAR:
            return tuple((known | solution)[one] for one in equations.q)
    return None


def _loads(equations: SymbolicEquations, balance: Any, gradient: Any, place: dict[Any, Any]) -> tuple[Any, ...] | None:
    """The multipliers as formulas; None if nothing balances."""
    unknown = list(equations.multipliers)
    left = [sp.simplify(row) for row in (balance - gradient.T * sp.Matrix(unknown)).subs(place)]
    solutions = sp.solve([row for row in left if row != 0], unknown, dict=True)
    if len(solutions) != 1 or any(symbol not in solutions[0] for symbol in unknown):
        return None
    return tuple(solutions[0][symbol] for symbol in unknown)


def _symbols(equations: SymbolicEquations, of: tuple[Any, ...]) -> tuple[Any, ...]:
    """Symbols for values at the equilibrium."""
    symbols = tuple(sp.Symbol(f"{symbol}_0", real=True) for symbol in of)
    equations.names.update({own: f"{{{equations.names[one]}}}^{{0}}" for own, one in zip(symbols, of, strict=True)})
    return symbols


def states_at_rest(
    equations: SymbolicEquations, balance: Any, rates: Any, numbers: Mapping[Any, float]
) -> tuple[Any, tuple[Any, ...], dict[Any, float]]:
    """The equations of rest without the states, these states (k,) as formulas of coordinates, and numbers of others.

    Each state comes from an equation that is linear in it: of the rates or, without constraints, of the balance. The
    equations that are left come first, those of the balance last. A state without such an equation stays a symbol.

    :param balance: h - Q (nv,) at rest.
    :param rates: of the states (k,) at rest.
    :param numbers: the values of all symbols at the equilibrium.
    """
    symbols = [state.symbol for one in equations.actuators for state in one.states]
    formulas: dict[Any, Any] = {}
    left = {index: sp.expand(entry) for index, entry in enumerate((*rates, *balance))}
    usable = len(symbols) if equations.rows else len(left)
    for _ in symbols:
        for symbol in (one for one in symbols if one not in formulas):
            places = (index for index, entry in left.items() if _is_linear(entry, symbol, numbers))
            place = next(places, usable)
            if place < usable:
                formula = sp.solve(left.pop(place), symbol)[0]
                left = {index: sp.expand(entry.subs(symbol, formula)) for index, entry in left.items()}
                formulas = {key: value.subs(symbol, formula) for key, value in formulas.items()} | {symbol: formula}
                break
    others = {symbol: numbers[symbol] for symbol in symbols if symbol not in formulas}
    entries = [entry for index, entry in left.items() if index >= len(symbols) or entry != 0]
    return sp.Matrix(entries), tuple(formulas.get(symbol, symbol) for symbol in symbols), others


def _is_linear(entry: Any, symbol: Any, numbers: Mapping[Any, float]) -> bool:
    slope = entry.diff(symbol)
    if slope == 0 or symbol in slope.free_symbols:
        return False
    value = slope.subs(numbers)
    return bool(value.is_number and abs(value) > NEAR)
