"""Equations linearized about an equilibrium, and their characteristic polynomial (Géradin & Rixen, ch. 1–2)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mbd_sim.analysis.equilibrium import equilibrium
from mbd_sim.dynamics.equations import derive
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.joint_types import JOINT_KINDS
from mbd_sim.mechanism.one_sided import has_one_sided
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.symbolic.exact_numbers import Exact, exact
from mbd_sim.symbolic.symbolic_equations import SymbolicEquations

MAX_POLYNOMIAL = 3  # speeds up to which the characteristic polynomial is expanded
MAX_OPERATIONS = 250  # of the polynomial
NEAR = 1e-7  # between an equilibrium in numbers and its formula


@dataclass(frozen=True, eq=False)
class SymbolicLinearization:
    """M δu' + C δu + K δq = δe about an equilibrium, where δ are small differences from it.

    `equilibrium` has the value of each coordinate (nv,): a formula, or a symbol that satisfies the equations of
    equilibrium, with its number in `values`. `mass`, `damping` and `stiffness` are SymPy matrices (nv, nv); `damping`
    includes gyroscopic terms, `stiffness` those of a prescribed motion. `polynomial` is det(M s² + C s + K) in the
    symbol `s`, or None if it is too long.
    """

    equilibrium: tuple[Any, ...]
    values: Mapping[Any, float]
    mass: Any
    damping: Any
    stiffness: Any
    s: Any
    polynomial: Any


def linearized(mechanism: Mechanism, equations: SymbolicEquations) -> SymbolicLinearization | None:
    """Linearize the equations of a mechanism about an equilibrium near its start.

    None if there is no equilibrium, or the mechanism has constraints, contacts, actuators, spherical or free joints, or
    forces that depend on time.
    """
    import sympy as sp

    kinds = [JOINT_KINDS[coordinate.type] for coordinate in equations.coordinates]
    forces = sp.Matrix(equations.inertial) - sp.Matrix(equations.forces)
    mass = sp.Matrix([list(row) for row in equations.mass])
    if (
        equations.actuators
        or equations.rows
        or has_one_sided(mechanism)
        or any(kind.quaternion is not None for kind in kinds)
    ):
        return None
    if equations.time in forces.free_symbols | mass.free_symbols:
        return None
    found = equilibrium(derive(mechanism))
    if found is None:
        return None
    forces = _without_kinks(equations, forces, found)
    if forces is None:
        return None
    at_rest = dict.fromkeys((*equations.u, *equations.efforts), sp.S.Zero)
    place, values = _equilibrium(equations, forces.subs(at_rest), found)
    still = {**at_rest, **dict(zip(equations.q, place, strict=True))}
    damping = forces.jacobian(list(equations.u)).subs(still)
    stiffness = forces.jacobian(list(equations.q)).subs(still)
    if any(matrix.has(sp.Derivative, sp.Subs, sp.nan, sp.zoo) for matrix in (damping, stiffness)):
        return None
    mass, damping, stiffness = (_simple(matrix) for matrix in (mass.subs(still), damping, stiffness))
    s = sp.Symbol("s")
    return SymbolicLinearization(place, values, mass, damping, stiffness, s, _polynomial(mass, damping, stiffness, s))


def _without_kinks(equations: SymbolicEquations, forces: Any, found: Array) -> Any | None:
    """The forces with |x| and sign x as they are near the equilibrium; None if x is zero there."""
    import sympy as sp

    numbers = {one.symbol: one.value for one in equations.parameters}
    numbers |= dict(zip(equations.q, found.tolist(), strict=True)) | dict.fromkeys(equations.u, 0.0)
    sides = {}
    for kink in forces.atoms(sp.Abs, sp.sign):
        value = kink.args[0].subs(numbers)
        if not value.is_number or abs(value) < NEAR:
            return None
        sides[kink] = sp.sign(value) * (kink.args[0] if isinstance(kink, sp.Abs) else 1)
    return forces.subs(sides)


def _simple(matrix: Any) -> Any:
    import sympy as sp

    return matrix.applyfunc(lambda entry: sp.factor_terms(sp.expand_mul(entry)))


def _polynomial(mass: Any, damping: Any, stiffness: Any, s: Any) -> Any | None:
    """det(M s² + C s + K), by powers of s."""
    import sympy as sp

    if mass.rows > MAX_POLYNOMIAL:
        return None
    determinant = sp.expand((mass * s**2 + damping * s + stiffness).det(method="berkowitz"))
    result = sp.collect(determinant, s, sp.factor)
    return result if result.count_ops() <= MAX_OPERATIONS else None


def _equilibrium(equations: SymbolicEquations, forces: Any, found: Array) -> tuple[tuple[Any, ...], dict[Any, float]]:
    """The coordinates at an equilibrium, as formulas as far as possible."""
    import sympy as sp

    place = [_recognized(float(value)) for value in found]
    exact_place = dict(zip(equations.q, place, strict=True))
    if all(sp.simplify(force.subs(exact_place)) == 0 for force in forces):
        return tuple(place), {}
    for fixed in (_angles(equations, place), {}):
        solved = _solved(equations, [force.subs(fixed) for force in forces], fixed, found)
        if solved is not None:
            return solved, {}
    symbols = [sp.Symbol(f"{symbol}_0", real=True) for symbol in equations.q]
    equations.names.update(
        {own: f"{{{equations.names[symbol]}}}^{{0}}" for own, symbol in zip(symbols, equations.q, strict=True)}
    )
    return tuple(symbols), dict(zip(symbols, map(float, found), strict=True))


def _recognized(value: float) -> Any:
    """A number as a fraction of a turn if it is one, else as a decimal."""
    import sympy as sp

    if abs(value) < NEAR:
        return sp.S.Zero
    number: Exact = exact(round(value / np.pi * 12.0) / 12.0)
    if number.ratio and abs(float(number) * np.pi - value) < NEAR:
        return sp.Rational(number.ratio.numerator, number.ratio.denominator) * sp.pi
    return sp.Float(value)


def _angles(equations: SymbolicEquations, place: Sequence[Any]) -> dict[Any, Any]:
    """The coordinates whose value is zero or a simple fraction of a turn."""
    return {q: value for q, value in zip(equations.q, place, strict=True) if not value.is_Float}


def _solved(
    equations: SymbolicEquations, forces: Sequence[Any], fixed: Mapping[Any, Any], found: Array
) -> tuple[Any, ...] | None:
    """The solution of the equations of equilibrium that has the values found; None if there is no formula."""
    import sympy as sp

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
    numbers = {one.symbol: one.value for one in equations.parameters}
    for solution in solutions:
        place = [fixed.get(q, solution.get(q, q)) for q in equations.q]
        if all(not (entry.free_symbols & set(equations.q)) for entry in place):
            values = [complex(entry.subs(numbers)) for entry in place]
            if np.allclose(values, found, rtol=NEAR, atol=NEAR):
                return tuple(place)
    return None


def _degree(forces: Sequence[Any], unknown: Sequence[Any]) -> int:
    """The total degree in the unknowns, 0 if the forces are not polynomials."""
    import sympy as sp

    try:
        return max((sp.Poly(force, *unknown).total_degree() for force in forces), default=0)
    except sp.PolynomialError:
        return 0
