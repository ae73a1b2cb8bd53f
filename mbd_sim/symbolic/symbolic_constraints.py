"""The independent constraints of a mechanism as simplified SymPy expressions, each with its multiplier."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import casadi as ca

from mbd_sim.symbolic.latex_printer import escaped

if TYPE_CHECKING:
    from mbd_sim.dynamics.constraint_rows import ConstraintRow
    from mbd_sim.dynamics.equations import Equations


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
    import sympy as sp

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
