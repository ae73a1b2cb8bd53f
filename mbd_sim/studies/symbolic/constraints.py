"""Constraints and one-sided elements of a mechanism as simplified SymPy expressions.

Each of the independent constraints has its multiplier. One-sided elements have gaps, friction and restitution.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import sympy as sp

from mbd_sim.dynamics.constraints.rows import ConstraintRow
from mbd_sim.dynamics.contact.one_sided_equations import OneSidedEquations
from mbd_sim.dynamics.equations import Equations
from mbd_sim.studies.algebra.names import escaped


@dataclass(frozen=True, eq=False)
class SymbolicConstraint:
    """One row of G u + b = 0, whose `multiplier` λ adds Gᵀλ to the forces.

    `position` is Φ(q, t), which stays zero, or None for a nonholonomic row; `gradient` (nv,) is the row of G, and
    `drift` is b. The row belongs to `owner`: a joint that closes a loop if `closes`, else a constraint. `quantity` is
    the constrained quantity. `load` is the unit of the multiplier as LaTeX, or "" if it depends on the unit of an
    equation of the file.
    """

    owner: str
    quantity: str
    closes: bool
    position: Any | None
    gradient: tuple[Any, ...]
    drift: Any
    multiplier: Any
    load: str = "N"


def constraint_function(derived: Equations) -> ca.Function:
    """(t, q, u, efforts) -> Φ (m,), G (m, nv) and b (m,) of the independent rows; b is zero for holonomic rows.

    If the equations have symbolic parameters, their values are the last argument.
    """
    layout, kept = derived.layout, list(derived.start.independent)
    t, q = ca.SX.sym("t"), ca.SX.sym("q", layout.nq)
    u, efforts = ca.SX.sym("u", layout.nv), ca.SX.sym("e", layout.nv)
    others = ca.SX.zeros(derived.violation.size1_in(1) - layout.nq - layout.nv, 1)
    given, inputs = inputs_with_parameters(derived)
    both = derived.violation.call([t, ca.vertcat(q, u, others), *([inputs] if given else [])])[0]
    velocity = both[kept, 1]
    at_rest = ca.substitute(velocity, u, ca.SX.zeros(layout.nv, 1))
    at_rest[[row for row, index in enumerate(kept) if derived.rows[index].position is not None]] = 0
    outputs = [both[kept, 0], ca.jacobian(velocity, u), at_rest]
    return ca.Function("constraints", [t, q, u, efforts, *given], [ca.sparsify(output) for output in outputs])


def inputs_with_parameters(derived: Equations) -> tuple[list[ca.SX], ca.SX]:
    """The symbols of the parameters as a list of one vector, empty without any, and the inputs with these values."""
    inputs, span = ca.SX(ca.DM(derived.inputs_without_commands)), derived.inputs.values
    if not derived.inputs.value_count:
        return [], inputs
    symbols = ca.SX.sym("p", derived.inputs.value_count)
    inputs[span] = symbols
    return [symbols], inputs


def multipliers_of(rows: Sequence[ConstraintRow], names: dict[Any, str]) -> tuple[Any, ...]:
    """A symbol for each row, named after its owner, and numbered if the owner has several rows."""
    owners, made = [str(row.owner[1]) for row in rows], []
    for row, owner in enumerate(owners):
        several = owners.count(owner) > 1
        number = f",{owners[: row + 1].count(owner)}" if several else ""
        made.append(sp.Symbol(f"lambda_{owner}{number}", real=True))
        names[made[-1]] = rf"\lambda_{{\mathrm{{{escaped(owner)}}}{number}}}"
    return tuple(made)


def load_unit(row: ConstraintRow) -> str:
    """The unit of the multiplier of a row as LaTeX: N for a row in m or m/s, N m for a row in rad."""
    if row.unit == "m":
        return "N"
    return r"N\,m" if row.owner[0] == "joints" else ""


Matrix = list[list[Any]]


@dataclass(frozen=True, eq=False)
class SymbolicContact:
    """A gap with its friction, or dry friction alone.

    `gap` is the row of the gap, or None; of a `clutch` its rate is what cannot become negative. `restitution` is e.
    `slip` are the rows of friction, whose rates are the slip velocities. With a gap `sliding` and `static` are μ and
    μ_s, and without one the forces. Those of a `loaded` joint are times the force that it transmits across its axis.

    `name` is the LaTeX of the subscript that all symbols of the element have.
    """

    name: str
    gap: SymbolicConstraint | None
    clutch: bool = False
    restitution: Any = 0
    slip: tuple[SymbolicConstraint, ...] = ()
    sliding: Any = 0
    static: Any = 0
    loaded: str | None = None

    @property
    def rows(self) -> tuple[SymbolicConstraint, ...]:
        """All of its rows."""
        return (*(() if self.gap is None else (self.gap,)), *self.slip)


def contact_function(derived: Equations) -> ca.Function:
    """(t, q, u, efforts) -> gaps (gaps,), G (rows, nv), b (rows,), e (gaps,), and friction's sizes (frictions, 2)."""
    assert derived.one_sided is not None
    contact, layout = derived.one_sided, derived.layout
    gaps, rows = contact.equations.layout.gaps, contact.equations.layout.rows
    t, q = ca.SX.sym("t"), ca.SX.sym("q", layout.nq)
    u, efforts = ca.SX.sym("u", layout.nv), ca.SX.sym("e", layout.nv)
    y = ca.vertcat(q, u, ca.SX.zeros(derived.start_state.size - layout.nq - layout.nv))
    given, inputs = inputs_with_parameters(derived)
    readings = contact.read(t, y, inputs, ca.SX.zeros(rows, 1))
    velocity = readings[gaps : gaps + rows]
    at_rest = ca.substitute(velocity, u, ca.SX.zeros(layout.nv, 1))
    sizes = ca.reshape(
        contact.terms.call([t, y, inputs, contact.slots.values(t, y, inputs)])[2][rows:],
        len(contact.equations.frictions),
        2,
    )
    restitution = contact.restitution.call([inputs])[0]
    outputs = [readings[:gaps], ca.jacobian(velocity, u), at_rest, restitution, sizes]
    return ca.Function("contacts", [t, q, u, efforts, *given], [ca.sparsify(output) for output in outputs])


def symbolic_contacts(
    contacts: OneSidedEquations, matrices: Sequence[Matrix], names: dict[Any, str]
) -> tuple[SymbolicContact, ...]:
    """The elements, from the outputs of `contact_function` as expressions; `names` gets those of the multipliers."""
    positions, gradient, drift, restitution, sizes = matrices
    rows, found = contacts.equations.rows, []

    def row(index: int, subscript: str, position: Any) -> SymbolicConstraint:
        given: ConstraintRow = rows[index]
        return SymbolicConstraint(
            owner=str(given.owner[1]),
            quantity=given.quantity,
            closes=False,
            position=position,
            gradient=tuple(gradient[index]),
            drift=drift[index][0],
            multiplier=_multiplier(subscript, names),
            load=load_unit(given),
        )

    def friction(index: int, name: str) -> dict[str, Any]:
        element = contacts.frictions[index]
        several = len(element.rows) > 1
        subscripts = [f"{name},T{number if several else ''}" for number in range(1, len(element.rows) + 1)]
        slip = tuple(row(own, subscript, None) for own, subscript in zip(element.rows, subscripts, strict=True))
        loaded = None if element.joint is None else element.joint.name
        return {"slip": slip, "sliding": sizes[index][0], "static": sizes[index][1], "loaded": loaded}

    by_gap = {element.gap: index for index, element in enumerate(contacts.frictions) if element.gap is not None}
    owners = [str(gap.row.owner[1]) for gap in contacts.gaps]
    for index, gap in enumerate(contacts.gaps):
        number = f",{owners[: index + 1].count(owners[index])}" if owners.count(owners[index]) > 1 else ""
        name = rf"\mathrm{{{escaped(owners[index])}}}{number}"
        position = None if gap.clutch else positions[index][0]
        further = friction(by_gap[index], name) if index in by_gap else {}
        found.append(SymbolicContact(name, row(index, name, position), gap.clutch, restitution[index][0], **further))
    for index, element in enumerate(contacts.frictions):
        if element.gap is None:
            name = rf"\mathrm{{{escaped(str(rows[element.rows[0]].owner[1]))}}}"
            found.append(SymbolicContact(name, None, **friction(index, name)))
    return tuple(found)


def row_order(contacts: OneSidedEquations) -> list[int]:
    """The rows of the equations in the order of those of `symbolic_contacts`."""
    by_gap = {element.gap: element.rows for element in contacts.frictions if element.gap is not None}
    of_gaps = [row for gap in range(len(contacts.gaps)) for row in (gap, *by_gap.get(gap, ()))]
    return of_gaps + [row for element in contacts.frictions if element.gap is None for row in element.rows]


def _multiplier(subscript: str, names: dict[Any, str]) -> Any:
    symbol = sp.Symbol(f"lambda_{subscript}", real=True)
    names[symbol] = rf"\lambda_{{{subscript}}}"
    return symbol
