"""Equations linearized about an equilibrium, and their characteristic polynomial (Géradin & Rixen, ch. 1–2)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from mbd_sim.analysis.equilibrium import equilibrium
from mbd_sim.dynamics.equations import Equations, derive
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.joint_types import JOINT_KINDS
from mbd_sim.mechanism.one_sided import has_one_sided
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.symbolic.equilibrium_formulas import NEAR, constrained_equilibrium, free_equilibrium
from mbd_sim.symbolic.symbolic_equations import SymbolicEquations

MAX_POLYNOMIAL = 3  # speeds up to which the characteristic polynomial is expanded
MAX_ROWS = 2  # constraints up to which it is
MAX_OPERATIONS = 250  # of the polynomial


@dataclass(frozen=True, eq=False)
class SymbolicLinearization:
    """M δu' + C δu + K δq = δe + Gᵀ δλ and G δu = 0 about an equilibrium, where δ are small differences from it.

    `equilibrium` has the value of each coordinate (nv,): a formula, or a symbol that satisfies the equations of
    equilibrium, with its number in `values`; `loads` has those of the multipliers λ (m,). `mass`, `damping` and
    `stiffness` are SymPy matrices (nv, nv), and `gradient` is G (m, nv); `damping` includes gyroscopic terms,
    `stiffness` those of a prescribed motion and of the loads. `polynomial` is det(M s² + C s + K) in the symbol `s`,
    with constraints that of the matrix bordered by -Gᵀ and by G, or by s G where they are nonholonomic (`rolling`).
    It is None if it is too long, or if only some of the constraints are holonomic.
    """

    equilibrium: tuple[Any, ...]
    values: Mapping[Any, float]
    mass: Any
    damping: Any
    stiffness: Any
    s: Any
    polynomial: Any
    gradient: Any
    loads: tuple[Any, ...] = ()
    rolling: bool = False


def linearized(mechanism: Mechanism, equations: SymbolicEquations) -> SymbolicLinearization | None:
    """Linearize the equations of a mechanism about an equilibrium near its start.

    The commands of actuators are those at the start. None if there is no equilibrium, or the mechanism has contacts,
    actuators with states or delays, spherical or free joints, or forces that depend on time.
    """
    import sympy as sp

    if not _can_be_linearized(mechanism, equations):
        return None
    forces = _with_actuators(equations, sp.Matrix(equations.inertial) - sp.Matrix(equations.forces))
    mass = sp.Matrix([list(row) for row in equations.mass])
    entries = [entry for row in equations.rows for entry in row.gradient]
    gradient = sp.Matrix(len(equations.rows), len(equations.u), entries)
    drifts = sp.Matrix([row.drift for row in equations.rows])
    if equations.time in forces.free_symbols | mass.free_symbols | gradient.free_symbols | drifts.free_symbols:
        return None
    derived = derive(mechanism)
    found = equilibrium(derived)
    if found is None:
        return None
    numbers = _numbers(derived, equations, found)
    forces, gradient = _without_kinks(forces, numbers), _without_kinks(gradient, numbers)
    if forces is None or gradient is None or any(drift != 0 for drift in drifts):
        return None
    commands = {symbol: numbers[symbol] for one in equations.actuators for symbol in one.commands.values()}
    forces = forces.subs({symbol: sp.S.Zero for symbol, value in commands.items() if value == 0.0})
    at_rest = dict.fromkeys((*equations.u, *equations.efforts), sp.S.Zero)
    balance = forces.subs(at_rest)
    if equations.rows:
        place, loads, values = constrained_equilibrium(equations, balance, gradient, found, numbers)
    else:
        (place, values), loads = free_equilibrium(equations, balance, found), ()
    values = values | {symbol: commands[symbol] for symbol in commands if symbol in forces.free_symbols}
    still = {**at_rest, **dict(zip(equations.q, place, strict=True))}
    still |= dict(zip(equations.multipliers, loads, strict=True))
    loaded = forces - gradient.T * sp.Matrix(len(equations.rows), 1, list(equations.multipliers))
    damping = forces.jacobian(list(equations.u)).subs(still)
    stiffness = loaded.jacobian(list(equations.q)).subs(still)
    matrices = mass.subs(still), damping, stiffness, gradient.subs(still)
    if any(matrix.has(sp.Derivative, sp.Subs, sp.nan, sp.zoo) for matrix in matrices):
        return None
    mass, damping, stiffness, gradient = (_simple(matrix) for matrix in matrices)
    s, rolling = sp.Symbol("s"), any(row.position is None for row in equations.rows)
    polynomial = None
    if not rolling or all(row.position is None for row in equations.rows):
        polynomial = _polynomial(mass, damping, stiffness, s, gradient, s if rolling else sp.S.One)
    return SymbolicLinearization(
        place, values, mass, damping, stiffness, s, polynomial, gradient, loads, rolling and polynomial is not None
    )


def _can_be_linearized(mechanism: Mechanism, equations: SymbolicEquations) -> bool:
    kinds = [JOINT_KINDS[coordinate.type] for coordinate in equations.coordinates]
    lawful = all(one.law is not None and not one.states and not one.delay for one in equations.actuators)
    return lawful and not has_one_sided(mechanism) and all(kind.quaternion is None for kind in kinds)


def _with_actuators(equations: SymbolicEquations, forces: Any) -> Any:
    """The forces with the laws of the actuators in place of their efforts."""
    return forces.subs({actuator.effort: actuator.law for actuator in equations.actuators})


def _numbers(derived: Equations, equations: SymbolicEquations, found: Array) -> dict[Any, float]:
    """The values of parameters, coordinates, speeds and commands at rest in an equilibrium."""
    numbers = {one.symbol: one.value for one in equations.parameters}
    numbers |= dict(zip(equations.q, found.tolist(), strict=True)) | dict.fromkeys(equations.u, 0.0)
    commands = [symbol for actuator in equations.actuators for symbol in actuator.commands.values()]
    held = derived.inputs_without_commands[derived.inputs.commands].tolist()
    return numbers | dict(zip(commands, held, strict=True))


def _without_kinks(forces: Any, numbers: Mapping[Any, float]) -> Any | None:
    """The forces with |x|, sign x, least and greatest as they are near the equilibrium; None if they change there."""
    import sympy as sp

    kinds = (sp.Abs, sp.sign, sp.Min, sp.Max)
    while kinks := sorted(forces.atoms(*kinds), key=lambda kink: (kink.count_ops(), str(kink))):
        side = _side(kinks[0], numbers)
        if side is None:
            return None
        forces = forces.xreplace({kinks[0]: side})
    return forces


def _side(kink: Any, numbers: Mapping[Any, float]) -> Any | None:
    """What |x|, sign x, least or greatest is near these numbers; None if it changes there."""
    import sympy as sp

    values = [argument.subs(numbers) for argument in kink.args]
    if any(not value.is_number for value in values):
        return None
    if isinstance(kink, sp.Abs | sp.sign):
        (value,) = values
        return None if abs(value) < NEAR else sp.sign(value) * (kink.args[0] if isinstance(kink, sp.Abs) else 1)
    order = sorted(range(len(values)), key=lambda place: values[place], reverse=isinstance(kink, sp.Max))
    first, second = (values[place] for place in order[:2])
    return None if abs(first - second) < NEAR else kink.args[order[0]]


def _simple(matrix: Any) -> Any:
    import sympy as sp

    return matrix.applyfunc(lambda entry: sp.factor_terms(sp.expand_mul(entry)))


def _polynomial(mass: Any, damping: Any, stiffness: Any, s: Any, gradient: Any, factor: Any) -> Any | None:
    """det(M s² + C s + K), or that of the matrix bordered by -Gᵀ and by G times a factor, by powers of s."""
    import sympy as sp

    if mass.rows > MAX_POLYNOMIAL or gradient.rows > MAX_ROWS:
        return None
    matrix = mass * s**2 + damping * s + stiffness
    if gradient.rows:
        matrix = sp.BlockMatrix([[matrix, -gradient.T], [factor * gradient, sp.zeros(gradient.rows)]]).as_explicit()
    determinant = sp.expand(matrix.det(method="berkowitz"))
    result = sp.collect(determinant, s, sp.factor)
    return result if result.count_ops() <= MAX_OPERATIONS else None
