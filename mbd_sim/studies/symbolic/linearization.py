"""Equations linearized about an equilibrium, and their characteristic polynomial (Géradin & Rixen, ch. 1–2).

Small changes of a state are displacements δq, changes of speed δu, and changes δs of the states of actuators, such as
currents. Displacements are those along the speeds: q' = N u, so that they change q by N δq. For a spherical or free
joint these include a small rotation about the axes of its second part, by which the quaternion p changes by ½ p ∘ (0,
δq): at rest its rate is the angular velocity.

The characteristic polynomial is given where it is short enough to be read.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import sympy as sp

from mbd_sim.analysis.equilibria.equilibrium import nearest_equilibrium
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.interrupts import interruptible
from mbd_sim.base.short_repr import record
from mbd_sim.dynamics.equations import Equations, derive
from mbd_sim.mechanism.contents import has_one_sided
from mbd_sim.mechanism.elements.joint_types import JOINT_KINDS
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.studies.algebra.names import shortest_numbers
from mbd_sim.studies.algebra.polynomial import MAX_OPERATIONS
from mbd_sim.studies.symbolic.coordinates import Coordinate
from mbd_sim.studies.symbolic.equations import SymbolicEquations
from mbd_sim.studies.symbolic.equilibrium import NEAR, constrained_equilibrium, free_equilibrium, states_at_rest

MAX_POLYNOMIAL = 3  # speeds up to which the characteristic polynomial is expanded
MAX_STATES = 2  # of actuators up to which it is
MAX_ROWS = 2  # constraints up to which it is
MAX_POLYNOMIAL_OPERATIONS = 250
MAX_ENTRIES = 250  # operations of the matrices from which it is expanded; with 400 this takes half a minute


def characteristic_polynomial(blocks: Sequence[Any], s: Any, gradient: Any, factor: Any) -> Any | None:
    """The determinant of the linearized equations in s, bordered by -Gᵀ and by G times a factor, by powers of s.

    :param blocks: M, C, K, E, A, B and S, see `SymbolicLinearization`.
    """
    mass, damping, stiffness, coupling, by_q, by_u, by_s = blocks
    own = mass * s**2 + damping * s + stiffness
    right, below, corner = coupling, -by_q - by_u * s, s * sp.eye(by_s.rows) - by_s
    if sum(int(entry.count_ops()) for matrix in (*blocks, gradient) for entry in matrix) > MAX_ENTRIES:
        return None
    if own.rows > MAX_POLYNOMIAL or gradient.rows > MAX_ROWS or corner.rows > MAX_STATES:
        return None
    matrix = sp.Matrix(sp.BlockMatrix([[own, right], [below, corner]])) if corner.rows else own
    if gradient.rows:
        border = gradient.row_join(sp.zeros(gradient.rows, corner.rows))
        matrix = sp.Matrix(sp.BlockMatrix([[matrix, -border.T], [factor * border, sp.zeros(gradient.rows)]]))
    determinant = sp.expand(matrix.det(method="berkowitz"))
    result = sp.collect(determinant, s, sp.factor)
    return result if result.count_ops() <= MAX_POLYNOMIAL_OPERATIONS else None


SOLUTION_ROUND_OFF = 1e-13  # of values at an equilibrium in SI units


@record
class SymbolicLinearization:
    """M δu' + C δu + K δq + E δs = δτ + W δw + Gᵀ δλ, δs' = A δq + B δu + S δs + V δw, G δu = 0 about an equilibrium.

    The δ are small differences from it: δq (nv,) along the speeds, with small rotations about the axes of the second
    part for quaternions; δs (k,) of the `states` of actuators, δw (c,) of their `commands`.

    `equilibrium` has the value of each coordinate (nq,): a formula, or a symbol that satisfies the equations of
    equilibrium, with its number in `values`; where an entry of a matrix would be too long to read, the number itself.
    `loads` has the values of the multipliers λ (m,), `state_values` those of s.
    `mass` M, `damping` C and `stiffness` K are SymPy matrices (nv, nv), `gradient` is G (m, nv); `damping` includes
    gyroscopic terms, `stiffness` those of a prescribed motion and of the loads. `coupling` is E (nv, k), and
    `state_rates` are A (k, nv), B (k, nv) and S (k, k). `commanded` is W (nv, c), `commanded_rates` V (k, c).

    `polynomial` is det(M s² + C s + K) in the symbol `s`, with states that of the matrix [[M s² + C s + K, E],
    [-A - B s, s - S]], with constraints that bordered by -Gᵀ and by G, or by s G where they are nonholonomic
    (`rolling`). It is None if it is too long, or if only some of the constraints are holonomic.
    """

    equilibrium: tuple[Any, ...]
    values: Mapping[Any, float]
    mass: Any
    damping: Any
    stiffness: Any
    s: Any
    polynomial: Any
    gradient: Any
    coupling: Any
    state_rates: tuple[Any, Any, Any]
    commanded: Any
    commanded_rates: Any
    states: tuple[Any, ...] = ()
    commands: tuple[Any, ...] = ()
    loads: tuple[Any, ...] = ()
    state_values: tuple[Any, ...] = ()
    rolling: bool = False


@interruptible()
def linearized(mechanism: Mechanism, equations: SymbolicEquations) -> SymbolicLinearization | None:
    """Linearize the equations of a mechanism about an equilibrium near its start.

    The commands of actuators are those at the start. None if there is no equilibrium, or the mechanism has contacts,
    actuators that change between steps only (samples, delays), laws that are too long, or forces that depend on time.
    """
    if not _can_be_linearized(mechanism, equations):
        return None
    terms = _terms(equations)
    if any(equations.time in matrix.free_symbols for matrix in terms):
        return None
    near = nearest_equilibrium(derived := derive(mechanism))
    found = None if near is None else (near.q, near.states)
    numbers = _numbers(derived, equations, *found) if found else {}
    smooth = _without_kinks(terms, numbers) if found else None
    if found is None or smooth is None or any(drift != 0 for drift in terms.drifts):
        return None
    commands = {symbol: numbers[symbol] for one in equations.actuators for symbol in one.commands.values()}
    zero = {symbol: sp.S.Zero for symbol, value in commands.items() if value == 0.0}
    at_rest = dict.fromkeys((*equations.u, *equations.efforts), sp.S.Zero) | zero
    place, loads, held, values = _formulas(
        equations, _Terms(*(matrix.xreplace(at_rest) for matrix in smooth)), smooth.gradient, found, numbers
    )
    used = smooth.forces.subs(zero).free_symbols | smooth.rates.subs(zero).free_symbols
    values = values | {symbol: commands[symbol] for symbol in commands if symbol in used}
    symbols = [state.symbol for one in equations.actuators for state in one.states]
    held_at = zip((*equations.q, *symbols, *equations.multipliers), (*place, *held, *loads), strict=True)
    still = at_rest | dict(held_at)
    matrices = [matrix.xreplace(still) for matrix in _derivatives(equations, smooth, symbols, list(commands))]
    if any(matrix.has(sp.Derivative, sp.Subs, sp.nan, sp.zoo) for matrix in matrices):
        return None
    if any(entry.count_ops() > MAX_OPERATIONS for matrix in matrices for entry in matrix):
        matrices = [_in_numbers(matrix, values) for matrix in matrices]
        place, loads, held = (tuple(_in_numbers(sp.Matrix([one]), values)) for one in (place, loads, held))
        values = {}
    mass, gradient, damping, stiffness, coupling, by_q, by_u, by_s, commanded, commanded_rates = map(_simple, matrices)
    s, kinds, by_state = sp.Symbol("s"), {row.position is None for row in equations.rows}, (by_q, by_u, by_s)
    blocks, factor = (mass, damping, stiffness, coupling, *by_state), s if True in kinds else sp.S.One
    polynomial = characteristic_polynomial(blocks, s, gradient, factor) if len(kinds) < 2 else None
    return SymbolicLinearization(
        place,
        values,
        mass,
        damping,
        stiffness,
        s,
        polynomial,
        gradient,
        coupling,
        by_state,
        commanded,
        commanded_rates,
        states=tuple(symbols),
        commands=tuple(commands),
        loads=loads,
        state_values=held,
        rolling=True in kinds and polynomial is not None,
    )


class _Terms(NamedTuple):
    """M (nv, nv), h - Q (nv,), the rates of the states (k,), G (m, nv) and b (m,) as SymPy matrices."""

    mass: Any
    forces: Any
    rates: Any
    gradient: Any
    drifts: Any


def _terms(equations: SymbolicEquations) -> _Terms:
    """The terms of the equations, with the laws of the actuators in place of their efforts."""
    rates = [state.rate for one in equations.actuators for state in one.states]
    entries = [entry for row in equations.rows for entry in row.gradient]
    forces = sp.Matrix(equations.inertial) - sp.Matrix(equations.forces)
    return _Terms(
        sp.Matrix([list(row) for row in equations.mass]),
        forces.subs({actuator.effort: actuator.law for actuator in equations.actuators}),
        sp.Matrix(len(rates), 1, rates),
        sp.Matrix(len(equations.rows), len(equations.u), entries),
        sp.Matrix(len(equations.rows), 1, [row.drift for row in equations.rows]),
    )


def _derivatives(
    equations: SymbolicEquations, terms: _Terms, states: Sequence[Any], commands: Sequence[Any]
) -> list[Any]:
    """M and G, then the derivatives of forces and rates by u, q, states and commands, in the order of the record."""
    loaded = terms.forces - terms.gradient.T * sp.Matrix(len(equations.rows), 1, list(equations.multipliers))
    along = _kinematic_matrix(equations.coordinates)

    def derivative(matrix: Any, by: Sequence[Any]) -> Any:
        return matrix.jacobian(list(by)) if matrix.rows and by else sp.zeros(matrix.rows, len(by))

    return [
        terms.mass,
        terms.gradient,
        derivative(terms.forces, equations.u),
        derivative(loaded, equations.q) * along,
        derivative(terms.forces, states),
        derivative(terms.rates, equations.q) * along,
        derivative(terms.rates, equations.u),
        derivative(terms.rates, states),
        -derivative(terms.forces, commands),
        derivative(terms.rates, commands),
    ]


def _can_be_linearized(mechanism: Mechanism, equations: SymbolicEquations) -> bool:
    states = [state for one in equations.actuators for state in one.states]
    lawful = all(one.law is not None and not one.delay for one in equations.actuators)
    return lawful and all(state.sampled is None for state in states) and not has_one_sided(mechanism)


def _formulas(
    equations: SymbolicEquations,
    at_rest: _Terms,
    gradient: Any,
    found: tuple[Array, Array],
    numbers: Mapping[Any, float],
) -> tuple[tuple[Any, ...], tuple[Any, ...], tuple[Any, ...], dict[Any, float]]:
    """Coordinates, multipliers and states at the equilibrium as formulas, and the numbers of symbols among them."""
    balance, rates = at_rest.forces, at_rest.rates
    states: tuple[Any, ...] = ()
    others: dict[Any, float] = {}
    if rates.rows:
        balance, states, others = states_at_rest(equations, balance, rates, numbers)
    if equations.rows:
        place, loads, values = constrained_equilibrium(equations, balance, gradient, found[0], numbers)
    else:
        (place, values), loads = free_equilibrium(equations, balance, found[0], numbers), ()
    at = dict(zip(equations.q, place, strict=True)) | dict(zip(equations.multipliers, loads, strict=True))
    return place, loads, tuple(value.subs(at) for value in states), values | others


def _kinematic_matrix(coordinates: Sequence[Coordinate]) -> Any:
    """N (nq, nv) with q' = N u."""
    blocks = []
    for coordinate in coordinates:
        start = JOINT_KINDS[coordinate.type].quaternion
        if start is None:
            blocks.append(sp.eye(len(coordinate.q)))
            continue
        w, x, y, z = coordinate.q[start:]
        turning = sp.Matrix([[-x, -y, -z], [w, -z, y], [z, w, -x], [-y, x, w]]) / 2
        blocks.append(sp.diag(sp.eye(start), turning))
    return sp.diag(*blocks)


def _numbers(derived: Equations, equations: SymbolicEquations, q: Array, states: Array) -> dict[Any, float]:
    """The values of parameters, coordinates, speeds, states and commands at rest in an equilibrium."""
    numbers = {one.symbol: one.value for one in equations.parameters}
    numbers |= dict(zip(equations.q, q.tolist(), strict=True)) | dict.fromkeys(equations.u, 0.0)
    names = derived.actuator_layout.core_names(derived.mechanism.actuators)
    own = {f"{one.name}.{state.name}": state.symbol for one in equations.actuators for state in one.states}
    numbers |= {own[name]: value for name, value in zip(names, states.tolist(), strict=False)}
    commands = [symbol for actuator in equations.actuators for symbol in actuator.commands.values()]
    held = derived.inputs_without_commands[derived.inputs.commands].tolist()
    return numbers | dict(zip(commands, held, strict=True))


def _without_kinks(terms: _Terms, numbers: Mapping[Any, float]) -> _Terms | None:
    """The terms with |x|, sign x, least and greatest as they are near the equilibrium; None if they change there."""
    kinds, smooth = (sp.Abs, sp.sign, sp.Min, sp.Max), []
    for matrix in terms:
        while kinks := sorted(matrix.atoms(*kinds), key=lambda kink: (kink.count_ops(), str(kink))):
            side = _side(kinks[0], numbers)
            if side is None:
                return None
            matrix = matrix.xreplace({kinks[0]: side})
        smooth.append(matrix)
    return _Terms(*smooth)


def _side(kink: Any, numbers: Mapping[Any, float]) -> Any | None:
    """What |x|, sign x, least or greatest is near these numbers; None if it changes there."""
    values = [argument.subs(numbers) for argument in kink.args]
    if any(not value.is_number for value in values):
        return None
    if isinstance(kink, sp.Abs | sp.sign):
        (value,) = values
        return None if abs(value) < NEAR else sp.sign(value) * (kink.args[0] if isinstance(kink, sp.Abs) else 1)
    order = sorted(range(len(values)), key=lambda place: values[place], reverse=isinstance(kink, sp.Max))
    first, second = (values[place] for place in order[:2])
    return None if abs(first - second) < NEAR else kink.args[order[0]]


def _in_numbers(matrix: Any, values: Mapping[Any, float]) -> Any:
    """The matrix with the values of symbols as fractions, and zero in the place of round-off."""
    found = sp.expand(matrix.xreplace({symbol: sp.Float(value) for symbol, value in values.items()}))
    floats = found.atoms(sp.Float)
    return found.xreplace({one: sp.Rational(one) if abs(one) > SOLUTION_ROUND_OFF else sp.S.Zero for one in floats})


def _simple(matrix: Any) -> Any:
    def short(entry: Any) -> Any:
        expanded = sp.expand_mul(entry)
        return shortest_numbers([sp.factor_terms(expanded), expanded])

    return matrix.applyfunc(short)
