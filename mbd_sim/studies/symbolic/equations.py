"""The equations M(q, t) u' + h(q, u, t) = Q + Gᵀλ and the constraints in SymPy: as expressions, and as matrices."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from typing import Any

import casadi as ca
import sympy as sp

from mbd_sim.base.errors import MbdSimError, listed
from mbd_sim.base.interrupts import interruptible
from mbd_sim.base.short_repr import record
from mbd_sim.dynamics.constraints.start import given_start
from mbd_sim.dynamics.equations import Equations, derive
from mbd_sim.dynamics.lagrange import lagrange_equations
from mbd_sim.dynamics.layouts.vectors import coordinate_layout
from mbd_sim.mechanism.contents import expressions_of_forces, has_one_sided, require_no_commanded_drives
from mbd_sim.mechanism.elements.contacts import Ball, Cam
from mbd_sim.mechanism.mechanism import Mechanism, require_mechanism
from mbd_sim.mechanism.values.laws import Linear
from mbd_sim.studies.algebra.evaluation import polynomials
from mbd_sim.studies.algebra.polynomial import MAX_INSTRUCTIONS, Algebra, too_large
from mbd_sim.studies.algebra.samples import ParameterSymbol, SymbolicValues, as_in_textbooks, symbolic_values
from mbd_sim.studies.symbolic.actuators import SymbolicActuator, TracedActuators, symbolic_actuators, traced_actuators
from mbd_sim.studies.symbolic.constraints import (
    SymbolicConstraint,
    SymbolicContact,
    constraint_function,
    contact_function,
    load_unit,
    multipliers_of,
    symbolic_contacts,
)
from mbd_sim.studies.symbolic.coordinates import (
    Coordinate,
    SymbolicEnergies,
    define_unit_quaternion,
    energy_function,
    symbolic_coordinate,
)
from mbd_sim.studies.symbolic.sensors import SymbolicSensor, TracedSensors, symbolic_sensors, traced_sensors

MAX_SPEEDS = 6


@record
class SymbolicEquations:
    """The equations `mass` (nv, nv) · u' + `inertial` (nv,) = `forces` (nv,) + Gᵀλ of a mechanism, in SymPy.

    Lengths of springs on a line are |x|, right on both sides of zero. `sides` are these x with the sign that is
    positive at the start.

    `names` has the LaTeX of each symbol. `constraints` are the independent rows of G, each with its λ; `left_out` names
    the redundant rows. One-sided elements are the `contacts`, which also have rows of G and multipliers. All numbers
    are in SI units. The `forces` contain the symbols of the efforts of `actuators`. `energies` are None if they are too
    long to be read. `built_in` names parameters that stay numbers, with the reason. `sensors` are what is measured.
    """

    mechanism: str
    coordinates: tuple[Coordinate, ...]
    time: Any
    mass: tuple[tuple[Any, ...], ...]
    inertial: tuple[Any, ...]
    forces: tuple[Any, ...]
    names: dict[Any, str]
    constraints: tuple[SymbolicConstraint, ...] = ()
    left_out: tuple[str, ...] = ()
    contacts: tuple[SymbolicContact, ...] = ()
    energies: SymbolicEnergies | None = None
    actuators: tuple[SymbolicActuator, ...] = ()
    parameters: tuple[ParameterSymbol, ...] = ()
    built_in: Mapping[str, str] = field(default_factory=dict)
    sensors: tuple[SymbolicSensor, ...] = ()
    sides: tuple[Any, ...] = ()

    @property
    def q(self) -> tuple[Any, ...]:
        """All coordinates (nq,), in the order of the file."""
        return tuple(symbol for coordinate in self.coordinates for symbol in coordinate.q)

    @property
    def u(self) -> tuple[Any, ...]:
        """All speeds (nv,)."""
        return tuple(symbol for coordinate in self.coordinates for symbol in coordinate.u)

    @property
    def u_rates(self) -> tuple[Any, ...]:
        """Their derivatives (nv,)."""
        return tuple(symbol for coordinate in self.coordinates for symbol in coordinate.u_rates)

    @property
    def rows(self) -> tuple[SymbolicConstraint, ...]:
        """The rows of G (m,): those of the constraints, then those of the contacts."""
        return (*self.constraints, *(row for contact in self.contacts for row in contact.rows))

    @property
    def multipliers(self) -> tuple[Any, ...]:
        """The multiplier λ of each row (m,)."""
        return tuple(row.multiplier for row in self.rows)

    @property
    def efforts(self) -> tuple[Any, ...]:
        """The commanded efforts (nv,)."""
        return tuple(symbol for coordinate in self.coordinates for symbol in coordinate.efforts)


@interruptible()
def symbolic_equations(mechanism: Mechanism, parameters: Sequence[str] | None = ()) -> SymbolicEquations:
    """Derive the equations of a small mechanism.

    :param parameters: keys of numbers in its file that become symbols, as for live values, and with them the gravity;
        None for all parameters of the file. By default all numbers are those of the file.
    :raises MechanismError: there is no such key.
    :raises MbdSimError: the equations are too long to be read, or the mechanism has no degree of freedom, or
        contacts with cams.
    """
    require_no_commanded_drives(require_mechanism(mechanism), "cannot be printed as formulas")
    _require_small(mechanism, coordinate_layout(mechanism).nv)
    mechanism = _with_formulas(mechanism)
    mechanism = as_in_textbooks(mechanism)
    values = None
    if parameters is None or parameters:
        keys = list(mechanism.parameters) if parameters is None else parameters
        values = symbolic_values(mechanism, keys)
    return _expressions(mechanism, values, _traced(mechanism, values))


@dataclass(frozen=True, eq=False)
class _Traced:
    """The functions of (t, q, u, efforts) and perhaps parameters that are evaluated over polynomials."""

    terms: ca.Function
    energies: ca.Function
    derived: Equations | None
    others: list[ca.Function]
    actuators: TracedActuators | None
    sensors: TracedSensors | None


def _traced(mechanism: Mechanism, values: SymbolicValues | None) -> _Traced:
    numbers, moments = (None, None) if values is None else (values.numbers, values.moments)
    lagrange = lagrange_equations(mechanism, numbers, moments)
    one_sided = has_one_sided(mechanism)
    derived, others = None, []
    if mechanism.closures or mechanism.constraints or one_sided:
        derived = derive(mechanism, parameters=numbers)
        others.append(constraint_function(derived))
    if derived is not None and derived.one_sided is not None:
        others.append(contact_function(derived))
    operations = sum(function.n_instructions() for function in (lagrange.terms, *others))
    if operations > MAX_INSTRUCTIONS:
        raise too_large(mechanism, f"their derivation takes {operations} operations")
    actuators = traced_actuators(mechanism, numbers)
    sensors = traced_sensors(mechanism, values, derived) if mechanism.sensors else None
    return _Traced(lagrange.terms, energy_function(lagrange), derived, others, actuators, sensors)


def _expressions(mechanism: Mechanism, values: SymbolicValues | None, traced: _Traced) -> SymbolicEquations:
    from mbd_sim.studies.symbolic.expressions import energies_if_short, simplified

    names: dict[Any, str] = {}
    coordinates = tuple(symbolic_coordinate(mechanism, name, names) for name in mechanism.joints)
    time = sp.Symbol("t", real=True)
    algebra = Algebra()
    symbols = [[symbol for c in coordinates for symbol in getattr(c, key)] for key in ("q", "u", "efforts")]
    inputs = [[algebra.symbol(symbol) for symbol in group] for group in ([time], *symbols)]
    for coordinate in coordinates:
        define_unit_quaternion(algebra, coordinate)
    if values is not None:
        names |= {parameter.symbol: parameter.latex for parameter in values.symbols}
        inputs.append(polynomials(algebra, values))
    functions = [traced.terms, *traced.others]
    (mass, inertial, forces), *rows = (simplified(mechanism, algebra, function, inputs) for function in functions)
    energies = energies_if_short(mechanism, algebra, traced.energies, [*inputs[:3], *inputs[4:]])
    derived = traced.derived
    one_sided = None if derived is None else derived.one_sided
    kept = derived.start.independent if derived else ()
    left_out = tuple(row.name for k, row in enumerate(derived.rows if derived else ()) if k not in kept)
    actuators = symbolic_actuators(traced.actuators, algebra, inputs, names) if traced.actuators else ()
    equations = SymbolicEquations(
        mechanism=mechanism.name,
        coordinates=tuple(c for c in coordinates if c.u),
        time=time,
        mass=tuple(tuple(row) for row in mass),
        inertial=tuple(row[0] for row in inertial),
        forces=tuple(_with_actuators(row[0], number, actuators) for number, row in enumerate(forces)),
        names=names,
        constraints=_constraints(derived, rows[0], names, time) if derived else (),
        left_out=left_out,
        contacts=symbolic_contacts(one_sided.equations, rows[1], names) if one_sided else (),
        energies=energies,
        actuators=actuators,
        parameters=() if values is None else values.symbols,
        built_in={} if values is None else values.built_in,
    )
    equations = replace(equations, sides=_sides(mechanism, equations))
    if traced.sensors is None:
        return equations
    further = equations.u_rates, equations.multipliers
    return replace(equations, sensors=symbolic_sensors(traced.sensors, algebra, inputs, actuators, further))


def on_side(equations: SymbolicEquations) -> SymbolicEquations:
    """The equations without |x| and sign x of lengths: as they are where all `sides` are positive."""
    if not equations.sides:
        return equations
    pairs = [(one, side) for side in equations.sides for one in (side, -side)]
    values = {sp.Abs(one): side for one, side in pairs} | {sp.sign(side): sp.Integer(1) for side in equations.sides}
    values |= {sp.sign(-side): sp.Integer(-1) for side in equations.sides}

    def replaced(value: Any) -> Any:
        if isinstance(value, tuple):
            return tuple(map(replaced, value))
        if is_dataclass(value) and not isinstance(value, type):
            return replace(value, **{one.name: replaced(getattr(value, one.name)) for one in fields(value)})
        return sp.expand(value.xreplace(values)) if isinstance(value, sp.Basic) and value.has(*values) else value

    changed = {one.name: replaced(getattr(equations, one.name)) for one in fields(equations) if one.name != "sides"}
    return replace(equations, **changed)


def _sides(mechanism: Mechanism, equations: SymbolicEquations) -> tuple[Any, ...]:
    """The lengths of springs on lines in the equations, with their signs at the start.

    None if laws and forces of the file may have absolute values of their own, which mean both sides.
    """
    laws = [*(one.law for one in mechanism.springs), *(joint.spring for joint in mechanism.joints.values())]
    if any(not isinstance(law, Linear | None) for law in laws) or any(True for _ in expressions_of_forces(mechanism)):
        return ()
    numbers = {one.symbol: one.value for one in equations.parameters}
    q = given_start(mechanism, coordinate_layout(mechanism))[0]
    numbers |= dict(zip(equations.q, q.tolist(), strict=False))
    written = sp.Tuple(*equations.forces, *([] if equations.energies is None else [equations.energies.potential]))
    found: dict[Any, None] = {}
    for size in sorted(written.atoms(sp.Abs, sp.sign), key=str):
        (x,) = size.args
        value = x.subs(numbers)
        if value.is_number and value != 0 and x.free_symbols & {*equations.q}:
            found[x if value > 0 else sp.expand(-x)] = None
    return tuple(found)


def _with_actuators(force: Any, row: int, actuators: Sequence[SymbolicActuator]) -> Any:
    return sum((actuator.along[row] * actuator.effort for actuator in actuators), force)


def _constraints(
    derived: Equations, matrices: list[list[list[Any]]], names: dict[Any, str], time: Any
) -> tuple[SymbolicConstraint, ...]:
    rows = [derived.rows[index] for index in derived.start.independent]
    return tuple(
        SymbolicConstraint(
            owner=str(row.owner[1]),
            quantity=row.quantity,
            closes=row.owner[0] == "joints",
            position=None if row.position is None else position,
            gradient=tuple(gradient),
            drift=drift if row.position is None else position.diff(time),
            multiplier=multiplier,
            load=load_unit(row),
        )
        for row, (position,), gradient, (drift,), multiplier in zip(
            rows, *matrices, multipliers_of(rows, names), strict=True
        )
    )


def _require_small(mechanism: Mechanism, speeds: int) -> None:
    if not speeds:
        raise MbdSimError(f"{mechanism.name} has no degree of freedom, so there are no equations of motion.")
    if speeds > MAX_SPEEDS:
        raise too_large(mechanism, f"it has {speeds} generalized speeds, more than {MAX_SPEEDS}")


def _with_formulas(mechanism: Mechanism) -> Mechanism:
    """The mechanism with one row for all that a ball touches of a cylinder.

    :raises MbdSimError: a contact has no formula.
    """
    contacts = [replace(each, slots=0) if isinstance(each.first, Ball) else each for each in mechanism.contacts]
    mechanism = replace(mechanism, contacts=tuple(contacts))
    pairs = ((contact.name, (contact.first, contact.second)) for contact in mechanism.contacts)
    cams = list(dict.fromkeys(name for name, bodies in pairs if any(isinstance(body, Cam) for body in bodies)))
    if cams:
        raise MbdSimError(
            f"{mechanism.name}: the gap of {listed(cams)} has no formula, because the nearest point of a cam is found "
            "by iteration",
            "Use shapes other than cams, or `on_surface` with a bound.",
        )
    if slots := [contact.name for contact in mechanism.contacts if contact.slots]:
        raise MbdSimError(
            f"{mechanism.name}: the gap of {listed(list(dict.fromkeys(slots)))} has no formula, because the features "
            "that touch change",
            "Use spheres, or planes.",
        )
    return mechanism


@record
class SympyModel:
    """M u' + h = Q + Gᵀ λ, with q' = N(q) u, in SymPy; SI units.

    - `t`, `q` (nq, 1), `u` (nv, 1), `u_rates` (nv, 1), `efforts` (nv, 1), `multipliers` (m, 1): symbols. Their names
      are those of the joints after `q_`, `u_`, `du_`, `e_`; u is q' except for spherical and free joints, see
      `equations.coordinates`.
    - `parameters`: the value of each symbol that is a number in SI units.
    - `T`, `V`: kinetic and potential energy in J; `D`: Rayleigh's dissipation function in W; None if too long.
    - `M` (nv, nv), `h` (nv, 1), `Q` (nv, 1): mass matrix, inertial terms, and all forces but those of constraints.
      Efforts of actuators are symbols, whose laws are in `equations.actuators`.
    - `Phi` (m, 1): positions of the constraints, which stay zero; of a nonholonomic row NaN.
    - `G` (m, nv), `b` (m, 1): the rates G u + b of the constraints. The rows of one-sided elements come last.
    - `sensors`: by the name of each sensor that has a formula, the matrix of each quantity, see `SymbolicSensor`.
    """

    equations: SymbolicEquations
    t: Any
    q: Any
    u: Any
    u_rates: Any
    efforts: Any
    multipliers: Any
    parameters: Mapping[Any, float]
    T: Any
    V: Any
    D: Any
    M: Any
    h: Any
    Q: Any
    Phi: Any
    G: Any
    b: Any
    sensors: Mapping[str, Mapping[str, Any]]

    @property
    def L(self) -> Any:  # noqa: N802
        """The Lagrangian T - V in J."""
        return self.T - self.V

    @property
    def residual(self) -> Any:
        """M u' + h - Q - Gᵀ λ (nv, 1), zero along a motion."""
        return self.M * self.u_rates + self.h - self.Q - self.G.T * self.multipliers


def sympy(mechanism: Mechanism, parameters: Sequence[str] | None = None) -> SympyModel:
    """The energies, equations and constraints of a small mechanism as SymPy expressions.

    >>> model = sympy(load_mechanism("rod_pendulum"))
    >>> model.M
    Matrix([[l**2*m/3]])

    :param parameters: keys of the numbers of its file that become symbols, as for live values, and with them the
        gravity; () for none. By default all parameters of the file.
    :raises MechanismError: there is no such key.
    :raises MbdSimError: the equations are too long to be read, or cannot be written as formulas.
    """
    equations = symbolic_equations(mechanism, parameters)
    rows, energies, nv = equations.rows, equations.energies, len(equations.u)
    return SympyModel(
        equations=equations,
        t=equations.time,
        q=_column(equations.q),
        u=_column(equations.u),
        u_rates=_column(equations.u_rates),
        efforts=_column(equations.efforts),
        multipliers=_column(equations.multipliers),
        parameters={one.symbol: one.value for one in equations.parameters},
        T=None if energies is None else energies.kinetic,
        V=None if energies is None else energies.potential,
        D=None if energies is None else energies.dissipation,
        M=sp.Matrix(nv, nv, [entry for row in equations.mass for entry in row]),
        h=_column(equations.inertial),
        Q=_column(equations.forces),
        Phi=_column([sp.nan if row.position is None else row.position for row in rows]),
        G=sp.Matrix(len(rows), nv, [entry for row in rows for entry in row.gradient]),
        b=_column([row.drift for row in rows]),
        sensors={one.sensor.name: one.values for one in equations.sensors if not one.reason},
    )


def _column(entries: Sequence[Any]) -> Any:
    return sp.Matrix(len(entries), 1, list(entries))
