"""The equations M(q, t) u' + h(q, u, t) = Q + Gᵀλ and the constraints as simplified SymPy expressions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from mbd_sim.dynamics.equations import Equations, derive
from mbd_sim.dynamics.lagrange import lagrange_equations
from mbd_sim.dynamics.links import coordinate_layout
from mbd_sim.errors import MbdSimError, listed
from mbd_sim.mechanism.actuators import require_no_actuators
from mbd_sim.mechanism.contacts import Cam
from mbd_sim.mechanism.joint_types import JOINT_KINDS, JointType
from mbd_sim.mechanism.one_sided import has_one_sided
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.packages import require_packages
from mbd_sim.symbolic.latex_printer import escaped
from mbd_sim.symbolic.symbolic_constraints import (
    SymbolicConstraint,
    constraint_function,
    load_unit,
    multipliers_of,
)
from mbd_sim.symbolic.symbolic_contacts import SymbolicContact, contact_function, symbolic_contacts

if TYPE_CHECKING:
    from mbd_sim.symbolic.polynomial import Algebra

MAX_SPEEDS = 6
MAX_INSTRUCTIONS = 20_000
MAX_TERMS = 200  # of one entry before simplification
MAX_OPERATIONS = 400  # of one entry after simplification
MAX_TOTAL_OPERATIONS = 1500  # of all entries after simplification


@dataclass(frozen=True, eq=False)
class Coordinate:
    """The symbols of a joint: its coordinates, its speeds, their rates, and its efforts, in order."""

    joint: str
    type: JointType
    q: tuple[Any, ...]
    u: tuple[Any, ...]
    u_rates: tuple[Any, ...]
    efforts: tuple[Any, ...]


@dataclass(frozen=True, eq=False)
class SymbolicEquations:
    """The equations `mass` (nv, nv) · u' + `inertial` (nv,) = `forces` (nv,) + Gᵀλ of a mechanism, in SymPy.

    `names` has the LaTeX of each symbol. `constraints` are the independent rows of G, each with its λ; `left_out` names
    the redundant rows. One-sided elements are the `contacts`, which also have rows of G and multipliers. All numbers
    are in SI units.
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


def symbolic_equations(mechanism: Mechanism) -> SymbolicEquations:
    """Derive the equations of a small mechanism, with the numbers of its file.

    :raises MissingPackageError: SymPy is not installed.
    :raises MbdSimError: the equations are too long to be read, or the mechanism has no degree of freedom, or
        contacts with cams.
    """
    require_packages("sympy", purpose="Deriving equations as formulas")
    require_no_actuators(mechanism, "cannot be printed as formulas")
    _require_small(mechanism, coordinate_layout(mechanism).nv)
    _require_formulas(mechanism)
    functions = [lagrange_equations(mechanism).terms]
    one_sided = has_one_sided(mechanism)
    derived = derive(mechanism) if mechanism.closing or mechanism.constraints or one_sided else None
    if derived is not None:
        functions.append(constraint_function(derived))
    if derived is not None and derived.contact is not None:
        functions.append(contact_function(derived))
    operations = sum(function.n_instructions() for function in functions)
    if operations > MAX_INSTRUCTIONS:
        raise _too_large(mechanism, f"their derivation takes {operations} operations")
    import sympy as sp

    from mbd_sim.symbolic.polynomial import Algebra

    names: dict[Any, str] = {}
    coordinates = tuple(_coordinate(mechanism, name, names) for name in mechanism.joints)
    time = sp.Symbol("t", real=True)
    algebra = Algebra()
    symbols = [[symbol for c in coordinates for symbol in getattr(c, key)] for key in ("q", "u", "efforts")]
    inputs = [[algebra.symbol(symbol) for symbol in group] for group in ([time], *symbols)]
    for coordinate in coordinates:
        _define_unit_quaternion(algebra, coordinate)
    (mass, inertial, forces), *rows = (_simplified(mechanism, algebra, function, inputs) for function in functions)
    return SymbolicEquations(
        mechanism=mechanism.name,
        coordinates=tuple(c for c in coordinates if c.u),
        time=time,
        mass=tuple(tuple(row) for row in mass),
        inertial=tuple(row[0] for row in inertial),
        forces=tuple(row[0] for row in forces),
        names=names,
        constraints=_constraints(derived, rows[0], names, time) if derived else (),
        left_out=_left_out(derived) if derived else (),
        contacts=symbolic_contacts(derived.contact.contacts, rows[1], names) if derived and derived.contact else (),
    )


def _left_out(derived: Equations) -> tuple[str, ...]:
    return tuple(row.name for k, row in enumerate(derived.rows) if k not in derived.start.independent)


def _simplified(mechanism: Mechanism, algebra: Algebra, function: Any, inputs: list[Any]) -> list[list[list[Any]]]:
    """The outputs of a function of scalars, row by row, as short expressions."""
    import sympy as sp

    from mbd_sim.symbolic.exact_evaluation import evaluate
    from mbd_sim.symbolic.harmonics import shortest
    from mbd_sim.symbolic.polynomial import TooLargeError
    from mbd_sim.symbolic.polynomial_division import without_denominators

    try:
        outputs = evaluate(algebra, function, inputs)
        outputs = [[without_denominators(algebra, p) for p in output] for output in outputs]
    except TooLargeError as error:
        raise _too_large(mechanism, str(error)) from error
    longest = max((len(p) for output in outputs for p in output), default=0)
    if longest > MAX_TERMS:
        raise _too_large(mechanism, f"one of their entries has {longest} terms")
    matrices = []
    for number, values in enumerate(outputs):
        rows, columns = function.size_out(number)
        matrix = [[sp.S.Zero] * columns for _ in range(rows)]
        known: dict[frozenset[Any], Any] = {}  # equal entries, as in a symmetric matrix, are simplified once
        for row, column, p in _entries(function, number, values):
            key = frozenset(p.items())
            if key not in known:
                known[key] = shortest(algebra, p)
            matrix[row][column] = known[key]
        matrices.append(matrix)
    lengths = [int(entry.count_ops()) for matrix in matrices for row in matrix for entry in row]
    if (longest := max(lengths, default=0)) > MAX_OPERATIONS:
        raise _too_large(mechanism, f"one of their entries has {longest} operations")
    if sum(lengths) > MAX_TOTAL_OPERATIONS:
        raise _too_large(mechanism, f"their entries have {sum(lengths)} operations")
    return matrices


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
        raise _too_large(mechanism, f"it has {speeds} generalized speeds, more than {MAX_SPEEDS}")


def _require_formulas(mechanism: Mechanism) -> None:
    pairs = ((contact.name, (contact.first, contact.second)) for contact in mechanism.contacts)
    cams = list(dict.fromkeys(name for name, bodies in pairs if any(isinstance(body, Cam) for body in bodies)))
    if cams:
        raise MbdSimError(
            f"{mechanism.name}: the gap of {listed(cams)} has no formula, because the nearest point of a cam is found "
            "by iteration. Use shapes other than cams, or `on_surface` with a bound."
        )


def _too_large(mechanism: Mechanism, why: str) -> MbdSimError:
    return MbdSimError(
        f"{mechanism.name}: the equations of motion are too long to read: {why}. Use a smaller mechanism, or make "
        "some of its joints fixed or driven."
    )


def _entries(function: Any, output: int, values: list[Any]) -> list[tuple[int, int, Any]]:
    """The row, column and value of each nonzero entry of an output."""
    sparsity = function.sparsity_out(output)
    rows, columns = sparsity.get_triplet()
    return list(zip(rows, columns, values, strict=True))


def _coordinate(mechanism: Mechanism, name: str, names: dict[Any, str]) -> Coordinate:
    import sympy as sp

    joint = mechanism.joints[name]
    labels = joint.coordinate_names
    if not labels:
        return Coordinate(name, joint.type, (), (), (), ())
    quaternion = joint.kind.quaternion

    def symbols(letter: str, written: str, subscripts: list[str]) -> tuple[Any, ...]:
        made = tuple(sp.Symbol(f"{letter}_{subscript}", real=True) for subscript in subscripts)
        for symbol, subscript in zip(made, subscripts, strict=True):
            names[symbol] = f"{written}_{{\\mathrm{{{escaped(subscript)}}}}}"
        return made

    own = [label.replace(".", ",") for label in labels]
    if quaternion is None:
        q, u = symbols("q", "q", own), symbols("u", r"\dot{q}", own)
        return Coordinate(name, joint.type, q, u, symbols("du", r"\ddot{q}", own), symbols("e", r"\tau", own))
    subscripts = [f"{name},{axis}" for axis in "xyz"]
    turned = symbols("p", "p", [f"{name},{axis}" for axis in "wxyz"])
    omega, omega_rate = symbols("w", r"\omega", subscripts), symbols("dw", r"\dot{\omega}", subscripts)
    moments = symbols("m", r"\tau", subscripts)
    if quaternion == 0:
        return Coordinate(name, joint.type, turned, omega, omega_rate, moments)
    q, v, v_rate = symbols("q", "q", subscripts), symbols("v", "v", subscripts), symbols("dv", r"\dot{v}", subscripts)
    forces = symbols("f", "F", subscripts)
    return Coordinate(name, joint.type, q + turned, v + omega, v_rate + omega_rate, forces + moments)


def _define_unit_quaternion(algebra: Algebra, coordinate: Coordinate) -> None:
    """Define w² = 1 - x² - y² - z² in the algebra, for the quaternion of a joint."""
    from fractions import Fraction

    start = JOINT_KINDS[coordinate.type].quaternion
    if start is None or not coordinate.q:
        return
    w, *vector = (algebra.generator(symbol) for symbol in coordinate.q[start:])
    algebra.squares[w] = {(): Fraction(1)} | {((number, 2),): Fraction(-1) for number in vector}
